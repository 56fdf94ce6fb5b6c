"""Scenes: what they accept, what they refuse, and that their dimensionless form does not depend on units."""

import math
import pickle
from dataclasses import replace

import pytest

from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import scene_to_dict
from belt_fenicsx.scene.pulley import Drive, Pulley
from belt_fenicsx.scene.scene import Scene

pytestmark = pytest.mark.serial

NAN, INF = math.nan, math.inf


def test_defaults_are_the_published_scene():
    scene = Scene()
    assert scene.belt == Belt(length=1.0, youngs_modulus=5e7, poisson_ratio=0.45, thickness=0.05, width=0.1)
    assert scene.pulleys == (Pulley(radius=0.7, center=(0.0, -0.575), friction=0.2, x_trans=0.0, slip="forward"),)
    assert (scene.span, scene.transport_rate) == (1.0, 1.0)


def test_derived_stiffnesses():
    belt = Belt(youngs_modulus=12.0, thickness=2.0, width=3.0, poisson_ratio=0.5)
    assert belt.bending_stiffness == pytest.approx(24.0, rel=1e-15)
    assert belt.extensional_stiffness == pytest.approx(72.0, rel=1e-15)
    assert belt.shear_stiffness == pytest.approx(24.0, rel=1e-15)


def test_frozen():
    with pytest.raises(AttributeError):
        Scene().span = 2.0


def test_keyword_only():
    with pytest.raises(TypeError):
        Belt(1.0)


@pytest.mark.parametrize(
    ("drive", "value"), [("x_trans", 0.1), ("x_trans", "run-up"), ("omega", 1.48), ("torque", 0.0)]
)
def test_drive(drive, value):
    pulley = Pulley(**{drive: value})
    slip = "forward" if drive == "x_trans" else None
    assert pulley.drive == Drive(drive, value, slip)
    assert (getattr(pulley, drive), pulley.slip) == (value, slip)
    assert "drive" not in repr(pulley)
    assert pickle.loads(pickle.dumps(pulley)).drive == pulley.drive
    assert replace(pulley, radius=0.6).drive == pulley.drive
    with pytest.raises(TypeError):
        Pulley(drive=pulley.drive)


BAD = [
    (Belt, {"length": 0.0}, "length", "positive [m]"),
    (Belt, {"youngs_modulus": -1.0}, "youngs_modulus", "positive [Pa]"),
    (Belt, {"youngs_modulus": NAN}, "youngs_modulus", "finite number [Pa]"),
    (Belt, {"poisson_ratio": 0.51}, "poisson_ratio", "(-1, 0.5]"),
    (Belt, {"poisson_ratio": -1.0}, "poisson_ratio", "(-1, 0.5]"),
    (Belt, {"thickness": -0.05}, "thickness", "positive [m]"),
    (Belt, {"thickness": 1e90}, "bending_stiffness", "at most 1e+100"),
    (Belt, {"thickness": 1e-90}, "bending_stiffness", "at least 1e-100"),
    (Belt, {"thickness": 1e-200}, "thickness", "at least 1e-100 [m]"),
    (Belt, {"width": True}, "width", "finite number [m]"),
    (Belt, {"width": "0.1"}, "width", "finite number [m]"),
    (Belt, {"width": 10**400}, "width", "finite number [m]"),
    (
        StiffnessBelt,
        dict(bending_stiffness=NAN, extensional_stiffness=1, shear_stiffness=1),
        "bending_stiffness",
        "N m^2",
    ),
    (
        StiffnessBelt,
        dict(bending_stiffness=1, extensional_stiffness=-1, shear_stiffness=1),
        "extensional_stiffness",
        "[N]",
    ),
    (StiffnessBelt, dict(bending_stiffness=1, extensional_stiffness=1, shear_stiffness=0), "shear_stiffness", "[N]"),
    (Pulley, {"radius": 0}, "radius", "positive [m]"),
    (Pulley, {"radius": INF}, "radius", "finite number [m]"),
    (Pulley, {"center": 0.0}, "center", "pair"),
    (Pulley, {"center": (0.0,)}, "center", "pair"),
    (Pulley, {"center": "ab"}, "center", "pair"),
    (Pulley, {"center": {"x": 0, "y": 1}}, "center", "pair"),
    (Pulley, {"center": {0.0, 1.0}}, "center", "pair"),
    (Pulley, {"center": (0.0, NAN)}, "center.1", "finite number [m]"),
    (Pulley, {"friction": -0.1}, "friction", "zero or positive"),
    (Pulley, {"friction": None}, "friction", "finite number [-]"),
    (Pulley, {"x_trans": "middle"}, "x_trans", '"run-up" or "run-off"'),
    (Pulley, {"x_trans": 0.7}, "x_trans", "(-0.7, 0.7) [m]"),
    (Pulley, {"x_trans": NAN}, "x_trans", "finite number [m]"),
    (Pulley, {"slip": "sideways"}, "slip", '"forward" or "backward"'),
    (Pulley, {"slip": ["forward"]}, "slip", '"forward" or "backward"'),
    (Pulley, {"omega": 1.0, "slip": "forward"}, "slip", "left out with `omega`"),
    (Pulley, {"omega": 1.0, "torque": 1.0}, "torque", "only drive"),
    (Pulley, {"x_trans": 0.0, "omega": 1.0}, "omega", "only drive"),
    (Pulley, {"omega": INF}, "omega", "finite number [rad/s]"),
    (Pulley, {"torque": "x"}, "torque", "finite number [N m]"),
    (Scene, {"belt": None}, "belt", "Belt"),
    (Scene, {"pulleys": Pulley()}, "pulleys", "tuple of Pulley"),
    (Scene, {"pulleys": ()}, "pulleys", "at least one"),
    (Scene, {"pulleys": (Pulley(), Pulley())}, "pulleys.0", "have a drive"),
    (Scene, {"span": -1.0}, "span", "positive [m]"),
    (Scene, {"transport_rate": 0.0}, "transport_rate", "positive [m/s]"),
    (Scene, {"pulleys": (Pulley(radius=2.0, center=(0.0, -1.9)),)}, "pulleys.0.radius", "left clamp"),
    (Scene, {"pulleys": (Pulley(center=(0.4, -0.575)),)}, "pulleys.0.radius", "right clamp"),
]


@pytest.mark.parametrize(("kind", "values", "field", "expected"), BAD)
def test_refused(kind, values, field, expected):
    with pytest.raises(SceneError) as caught:
        kind(**values)
    error = caught.value
    assert error.field == field
    assert expected in error.expected
    assert str(error).startswith(f"`{field}` must ")
    assert len(str(error)) < 400


def test_message():
    with pytest.raises(SceneError, match=r"^`thickness` must be positive \[m\], got -0\.05\.$"):
        Belt(thickness=-0.05)


def scaled(*, length=1.0, modulus=1.0, width=1.0, rate=1.0):
    """The published scene with all lengths but the width, E, w and c scaled."""
    belt = Belt(length=length, youngs_modulus=5e7 * modulus, thickness=0.05 * length, width=0.1 * width)
    pulley = Pulley(radius=0.7 * length, center=(0.05 * length, -0.575 * length), x_trans=0.01 * length)
    return Scene(belt=belt, pulleys=(pulley,), span=length, transport_rate=rate)


@pytest.mark.parametrize(
    "scales",
    [
        {"length": 1e-4},
        {"length": 1e4},
        {"modulus": 2e-8},
        {"modulus": 2e4},
        {"width": 30.0},
        {"rate": 1e-6},
        {"rate": 1e6},
    ],
    ids=str,
)
def test_dimensionless_scene_does_not_depend_on_units(scales):
    scene, _ = scaled(**scales).dimensionless()
    reference, _ = scaled().dimensionless()
    assert flat(scene) == pytest.approx(flat(reference), rel=1e-14)


def flat(scene):
    pulley = scene.pulleys[0]
    belt = (
        scene.belt.length,
        scene.belt.bending_stiffness,
        scene.belt.extensional_stiffness,
        scene.belt.shear_stiffness,
    )
    return [*belt, pulley.radius, *pulley.center, pulley.friction, pulley.x_trans, scene.span, scene.transport_rate]


def test_dimensionless_is_idempotent():
    scene, _ = scaled(length=3.0, rate=2.0).dimensionless()
    again, units = scene.dimensionless()
    assert again == scene
    assert units.of(length=3, force=-2, rate=1) == 1.0


@pytest.mark.parametrize(
    ("drive", "value", "expected"), [("omega", 1.5, 1.5 * 2.0 / 4.0), ("torque", 250.0, 250.0 / (2.0 * 2.5e5))]
)
def test_dimensionless_drives(drive, value, expected):
    belt = Belt(length=2.0)
    scene, units = Scene(belt=belt, pulleys=(Pulley(**{drive: value}),), transport_rate=4.0).dimensionless()
    assert units.force == pytest.approx(2.5e5, rel=1e-15)
    assert getattr(scene.pulleys[0], drive) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("x_trans", ["run-up", "run-off"])
def test_dimensionless_keeps_the_limits(x_trans):
    scene, _ = Scene(belt=Belt(length=2.0), pulleys=(Pulley(x_trans=x_trans, slip="backward"),)).dimensionless()
    assert (scene.pulleys[0].x_trans, scene.pulleys[0].slip) == (x_trans, "backward")


def drive(*, length=1.0, force=1.0, time=1.0):
    """A loop with all that has a dimension, in other units."""
    mass = force * time**2 / length
    belt = StiffnessBelt(
        bending_stiffness=0.4 * force * length**2,
        extensional_stiffness=5e4 * force,
        shear_stiffness=2e4 * force,
        line_density=1.0 * mass / length,
        rotary_inertia=1e-5 * mass * length,
        contact_offset=0.005 * length,
        length=1.4 * length,
    )
    pulleys = (
        Pulley(radius=0.1 * length, center=(0.0, 0.0), omega=10.0 / time),
        Pulley(
            radius=0.1 * length,
            center=(0.4 * length, 0.0),
            torque=9.0 * force * length,
            drag=2.0 * force * length * time,
        ),
        Pulley(
            radius=0.04 * length,
            center=(0.2 * length, -0.06 * length),
            side="left",
            slip_angle=0.1,
            take_up=(0.0, 3.0),
            force=50.0 * force,
        ),
    )
    return Scene(belt=belt, pulleys=pulleys, closed=True, gravity=(0.0, -9.81 * length / time**2))


@pytest.mark.parametrize("units", [{"length": 1e-3}, {"force": 1e4}, {"time": 60.0}], ids=str)
def test_dimensionless_loop_does_not_depend_on_units(units):
    scene, _ = drive(**units).dimensionless()
    reference, _ = drive().dimensionless()
    assert leaves(scene) == pytest.approx(leaves(reference), rel=1e-14)
    # The unit of the rate, which is to be found, is the surface speed of the pulley whose speed is given.
    assert scene.pulleys[0].omega * scene.pulleys[0].radius == pytest.approx(1.0, rel=1e-15)
    assert (scene.transport_rate, scene.belt.length, scene.belt.extensional_stiffness) == (None, 1.0, 1.0)


def leaves(scene):
    """All numbers of a scene by their places."""
    found, rest = {}, [("", scene_to_dict(scene))]
    while rest:
        path, value = rest.pop()
        if isinstance(value, dict | list):
            rest += [(f"{path}.{k}", v) for k, v in (value.items() if isinstance(value, dict) else enumerate(value))]
        elif isinstance(value, float):
            found[path] = value
    return found
