"""Scene files, plain data and paths: round trips, and an error that names the field for everything else."""

import math
from pathlib import Path

import pytest

from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import (
    left_out,
    load_scene,
    parse_assignment,
    read_data,
    scene_from_dict,
    scene_to_dict,
    with_values,
)
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

pytestmark = pytest.mark.serial

DEMOS = Path(__file__).parents[2] / "demos"
STIFF = StiffnessBelt(length=1.1, bending_stiffness=5.0, extensional_stiffness=2e5, shear_stiffness=9e4)

SCENES = [
    Scene(),
    Scene(span=0.9, transport_rate=2.5, belt=Belt(thickness=0.01)),
    Scene(belt=STIFF),
    Scene(pulleys=(Pulley(omega=1.48),)),
    Scene(pulleys=(Pulley(torque=-3.0, center=(0.1, -0.6)),)),
    Scene(pulleys=(Pulley(x_trans="run-off", slip="backward", friction=0),)),
]


LOOP = """
closed = true
elongation = 0.03
gravity = [0.0, -9.81]

[belt]
thickness = 0.01
density = 1200.0
contact_offset = 0.005

[[pulleys]]
radius = 0.1
center = [0.0, 0.0]
friction = 0.5
omega = 10

[[pulleys]]
radius = 0.1
center = [0.4, 0.0]
friction = 0.5
torque = 20
drag = 0.5

[[pulleys]]
radius = 0.04
center = [0.2, -0.06]
friction = 0.3
side = "left"
slip_angle = 0.1
slip = "backward"
"""
TENSIONER = """
closed = true
transport_rate = 2.0

[belt]
length = 1.5
bending_stiffness = 0.4
extensional_stiffness = 5e4
shear_stiffness = 2e4
line_density = 0.5
rotary_inertia = 1e-6

[[pulleys]]
radius = 0.1
center = [0.0, 0.0]
friction = 0.5

[[pulleys]]
radius = 0.1
center = [0.4, 0.0]
friction = 0.5
torque = 20.0
take_up = [1, 0.0]
force = 500
"""
CLAMPS = """
clamps = [[-0.5, 0.0, 0.1], [0.5, 0, 0]]
tension = 1000.0

[[pulleys]]
radius = 0.25
center = [-0.22, -0.2]
friction = 0.2
x_trans = "run-off"
slip = "forward"

[[pulleys]]
radius = 0.25
center = [0.22, 0.2]
friction = 0.2
side = "left"
torque = 0.0
"""


def write(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_demo_scene_is_the_published_one():
    assert load_scene(DEMOS / "one_pulley.toml") == Scene()


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.pulleys[0].drive.kind)
def test_round_trip(scene):
    data = scene_to_dict(scene)
    assert scene_from_dict(data) == scene
    assert with_values(scene, {}) == scene


@pytest.mark.parametrize("text", [LOOP, TENSIONER, CLAMPS], ids=["loop", "tensioner", "clamps"])
def test_round_trip_of_general_drives(text, tmp_path):
    data = read_data(write(tmp_path, text))
    scene = scene_from_dict(data)
    # Nothing is said that was not given, and nothing is forgotten.
    said = scene_to_dict(scene)
    assert all(said[name] == value for name, value in data.items() if name not in ("belt", "pulleys"))
    assert said["pulleys"] == data["pulleys"]
    assert {**said["belt"], **data.get("belt", {})} == said["belt"]
    assert scene_from_dict(said) == scene
    assert with_values(scene, {}) == scene
    dimensionless, _ = scene.dimensionless()
    assert scene_from_dict(scene_to_dict(dimensionless)) == dimensionless


def test_names_that_the_published_scene_does_not_need_are_not_said():
    assert set(scene_to_dict(Scene())) == {"belt", "pulleys", "span", "transport_rate"}


def test_an_empty_file_is_the_published_scene(tmp_path):
    assert load_scene(write(tmp_path, "")) == Scene()


def test_stiffnesses_from_a_file(tmp_path):
    text = "[belt]\nlength = 1.1\nbending_stiffness = 5\nextensional_stiffness = 2e5\nshear_stiffness = 9e4\n"
    assert load_scene(str(write(tmp_path, text))).belt == STIFF


# What a file may get wrong: its text, the field that the error names, and part of what it expects.
BAD_FILES = [
    ("span = ", "scene.toml", "valid TOML"),
    ("span = 1\nspan = 2", "scene.toml", "valid TOML"),
    ("[belt\nlength = 1", "scene.toml", "valid TOML"),
    ("span = 1" + "0" * 5000, "scene.toml", "valid TOML"),
    ("span = " + "[" * 5000, "scene.toml", "valid TOML"),
    ("spam = 1", "spam", "perhaps `span`"),
    ("qqq = 1", "qqq", "one of `belt`"),
    ("span = '1'", "span", "finite number [m]"),
    ("span = true", "span", "finite number [m]"),
    ("span = nan", "span", "finite number [m]"),
    ("span = 0xf" + "0" * 5000, "span", "finite number [m]"),
    ("span = 2020-01-01", "span", "finite number [m]"),
    ("transport_rate = -1", "transport_rate", "positive [m/s]"),
    ("belt = 3", "belt", "table"),
    ("[[belt]]\nlength = 1", "belt", "table"),
    ("[belt]\nthicknes = 0.05", "belt.thicknes", "perhaps `thickness`"),
    ("[belt]\nyoungs_modulus = -5e7", "belt.youngs_modulus", "positive [Pa]"),
    ("[belt]\nwidth = inf", "belt.width", "finite number [m]"),
    ("[belt]\nbending_stiffness = 1", "belt.extensional_stiffness", "given beside `belt.bending_stiffness` [N]"),
    ("[belt]\nshear_stiffness = 1\nwidth = 0.1", "belt.width", "left out beside `belt.shear_stiffness`"),
    ("pulleys = 1", "pulleys", "array of tables"),
    ("[pulleys]\nradius = 1", "pulleys", "array of tables"),
    ("pulleys = []", "pulleys", "at least one"),
    ("pulleys = [1]", "pulleys.0", "table"),
    ("[[pulleys]]\n[[pulleys]]", "pulleys.0", "have a drive"),
    ("[[pulleys]]\nradius = 0", "pulleys.0.radius", "positive [m]"),
    ("[[pulleys]]\nraduis = 1", "pulleys.0.raduis", "perhaps `radius`"),
    ("[[pulleys]]\ncenter = [0.0]", "pulleys.0.center", "pair"),
    ("[[pulleys]]\ncenter = [0.0, 'low']", "pulleys.0.center.1", "finite number [m]"),
    ("[[pulleys]]\ncenter = {x = 0, y = 1}", "pulleys.0.center", "pair"),
    ("[[pulleys]]\nfriction = -0.2", "pulleys.0.friction", "zero or positive"),
    ("[[pulleys]]\nx_trans = 'runoff'", "pulleys.0.x_trans", '"run-off"'),
    ("[[pulleys]]\nx_trans = 5", "pulleys.0.x_trans", "(-0.7, 0.7) [m]"),
    ("[[pulleys]]\nslip = 1", "pulleys.0.slip", '"forward" or "backward"'),
    ("[[pulleys]]\nomega = 1\ntorque = 1", "pulleys.0.torque", "only drive"),
    ("[[pulleys]]\nradius = 2.0\ncenter = [0, -1.9]", "pulleys.0.radius", "clamp"),
]


@pytest.mark.parametrize(("text", "field", "expected"), BAD_FILES, ids=lambda text: text[:40])
def test_bad_file(tmp_path, text, field, expected):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, text))
    assert Path(caught.value.field).name == field
    assert expected in caught.value.expected
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_byte_order_mark_is_no_part_of_the_file(encoding, tmp_path):
    (tmp_path / "scene.toml").write_text("span = 0.9", encoding=encoding)
    assert load_scene(tmp_path / "scene.toml") == Scene(span=0.9)


@pytest.mark.parametrize("text", ["span = 0,9", "[belt]\nlength = 1,5 # [m]\n", "span = -1,0\ntransport_rate = 1"])
def test_a_decimal_comma_is_named(text, tmp_path):
    with pytest.raises(SceneError, match="decimal points"):
        load_scene(write(tmp_path, text))


def test_names_cannot_talk_to_the_terminal(tmp_path):
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, '"\\u001b[31m" = 1'))
    assert str(caught.value).startswith(r"`\x1b[31m` must be one of")


@pytest.mark.parametrize(
    ("text", "given", "names"),
    [
        ((DEMOS / "one_pulley.toml").read_text(), (), []),
        ("", ("belt", "pulleys", "span"), ["transport_rate"]),
        ("span = 1\n[belt]\nlength = 1\nwidth = 0.2", ("pulleys.0",), [
            "belt.youngs_modulus", "belt.poisson_ratio", "belt.thickness", "transport_rate"]),
        ("[[pulleys]]\nradius = 0.6\nomega = 1.4", ("belt", "span", "transport_rate"), [
            "pulleys.0.center", "pulleys.0.friction"]),
        ("[[pulleys]]\ncenter = [0, -0.6]", ("belt", "span", "transport_rate", "pulleys.0.center.0"), [
            "pulleys.0.radius", "pulleys.0.friction", "pulleys.0.x_trans", "pulleys.0.slip"]),
        (LOOP, (), ["belt.youngs_modulus", "belt.poisson_ratio", "belt.width"]),
        (LOOP.replace("density = 1200.0", "").replace("friction = 0.3", ""), ("belt",), ["pulleys.2.friction"]),
        (TENSIONER, (), []),
        (CLAMPS, ("belt",), ["transport_rate"]),
        ("clamps = [[-0.5, 0, 0], [0.5, 0, 0]]\n[[pulleys]]\nradius = 0.7\ncenter = [0, -0.575]", ("belt",), [
            "transport_rate", "pulleys.0.friction", "pulleys.0.x_trans", "pulleys.0.slip"]),
    ],
)  # fmt: skip
def test_what_a_file_leaves_out(text, given, names, tmp_path):
    data = read_data(write(tmp_path, text))
    scene = scene_from_dict(data)
    assert set(left_out(scene, data, given)) == set(names)
    assert all(with_values(scene, {name: value}) == scene for name, value in left_out(scene, data, given).items())


def test_invalid_toml_names_the_line(tmp_path):
    with pytest.raises(SceneError, match="line 2"):
        load_scene(write(tmp_path, "span = 1\nspan = = 2\n"))


@pytest.mark.parametrize(("name", "reason"), [("missing.toml", "No such file"), (".", "directory")])
def test_unreadable_file(tmp_path, name, reason):
    with pytest.raises(SceneError, match=reason):
        load_scene(tmp_path / name)


def test_file_that_is_not_text(tmp_path):
    (tmp_path / "scene.toml").write_bytes(b"span = \xff")
    with pytest.raises(SceneError, match="UTF-8"):
        load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("span=0.9", "span", 0.9),
        (" span = 1_0 ", "span", 10),
        ("pulleys.0.x_trans=run-off", "pulleys.0.x_trans", "run-off"),
        ("pulleys.0.slip='backward'", "pulleys.0.slip", "backward"),
        ("pulleys.0.center=[0.0, -0.6]", "pulleys.0.center", [0.0, -0.6]),
        ("belt={thickness=0.1}", "belt", {"thickness": 0.1}),
    ],
)
def test_assignment(text, path, value):
    assert parse_assignment(text) == (path, value)


BAD_ASSIGNMENTS = [
    ("", "--set", "PATH=VALUE"),
    ("span", "--set", "PATH=VALUE"),
    ("span=", "--set", "PATH=VALUE"),
    ("=1", "--set", "PATH=VALUE"),
    ("pulleys..friction=1", "--set", "PATH=VALUE"),
    ("pulleys[0].friction=1", "--set", "PATH=VALUE"),
    ("span=1 2", "span", "TOML value"),
    ("span=[1", "span", "TOML value"),
    ("span=1\nbelt=2", "span", "TOML value"),
    ("span=0.1.2", "span", "TOML value"),
    ("spam=1", "spam", "perhaps `span`"),
    ("span=wide", "span", "finite number [m]"),
    ("span.x=1", "span.x", "single value"),
    ("belt.thickness.x=1", "belt.thickness.x", "single value"),
    ("belts.thickness=1", "belts.thickness", "perhaps `belt`"),
    ("belt.thickness=-1", "belt.thickness", "positive [m]"),
    ("belt.thick=1", "belt.thick", "perhaps `thickness`"),
    ("pulleys.1.friction=1", "pulleys.1.friction", "one of `0`"),
    ("pulleys.-1=1", "--set", "PATH=VALUE"),
    ("pulleys.first.friction=1", "pulleys.first.friction", "one of `0`"),
    ("pulleys.friction=1", "pulleys.friction", "one of `0`"),
    ("pulleys.0.center.2=1", "pulleys.0.center.2", "one of `0`, `1`"),
    ("pulleys.0=1", "pulleys.0", "table"),
    ("pulleys.0.friction=true", "pulleys.0.friction", "finite number [-]"),
    ("belt.bending_stiffness=1", "belt.extensional_stiffness", "given beside"),
]


@pytest.mark.parametrize(("text", "field", "expected"), BAD_ASSIGNMENTS)
def test_bad_assignment(text, field, expected):
    with pytest.raises(SceneError) as caught:
        with_values(Scene(), dict([parse_assignment(text)]))
    assert caught.value.field == field
    assert expected in caught.value.expected


def test_values_are_replaced_together():
    # Neither the radius nor the centre alone leaves the clamps outside of the pulley.
    values = {"pulleys.0.radius": 2.0, "pulleys.0.center.1": -2.2, "span": 0.8, "belt.length": 0.8}
    scene = with_values(Scene(), values)
    assert (scene.pulleys[0].radius, scene.pulleys[0].center, scene.span) == (2.0, (0.0, -2.2), 0.8)


def test_a_drive_replaces_the_former_one():
    scene = with_values(Scene(), {"pulleys.0.omega": 1.48})
    assert scene.pulleys[0] == Pulley(omega=1.48)
    scene = with_values(scene, {"pulleys.0.torque": 10.0})
    assert scene.pulleys[0] == Pulley(torque=10.0)
    scene = with_values(scene, {"pulleys.0.slip": "backward", "pulleys.0.x_trans": 0.1})
    assert scene.pulleys[0] == Pulley(x_trans=0.1, slip="backward")


DRIVE = {"x_trans": 0.2, "omega": 9.9, "torque": 1.0, "slip_angle": 0.2}


@pytest.mark.parametrize("former", DRIVE)
@pytest.mark.parametrize("later", DRIVE)
def test_each_drive_of_a_loop_replaces_each_other(former, later, tmp_path):
    scene = with_values(load_scene(write(tmp_path, LOOP)), {f"pulleys.2.{former}": DRIVE[former]})
    scene = with_values(scene, {"pulleys.2.drag": 0.1} if former == "torque" else {})
    pulley = with_values(scene, {f"pulleys.2.{later}": DRIVE[later]}).pulleys[2]
    assert (pulley.drive.kind, pulley.drive.value) == (later, DRIVE[later])
    # A drag stays with a torque, a sense of sliding with what places it.
    assert pulley.drag == (0.1 if (former, later) == ("torque", "torque") else 0.0)


@pytest.mark.parametrize(
    ("values", "length"),
    [
        ({"elongation": 0.05}, (0.8 + 0.2 * math.pi) / 1.05),
        ({"tension": 2500.0}, (0.8 + 0.2 * math.pi) / 1.05),
        ({"belt.length": 1.4}, 1.4),
        ({"belt.length": 1.4, "pulleys.1.center.0": 0.5}, 1.4),
        ({"pulleys.1.center.0": 0.5}, (1.0 + 0.2 * math.pi) / 1.03),
    ],
    ids=str,
)
def test_length_elongation_and_tension_replace_each_other(values, length):
    pulleys = (Pulley(radius=0.1, center=(0, 0), omega=1), Pulley(radius=0.1, center=(0.4, 0), torque=0))
    belt = StiffnessBelt(bending_stiffness=0.4, extensional_stiffness=5e4, shear_stiffness=2e4)
    scene = with_values(Scene(belt=belt, pulleys=pulleys, closed=True, elongation=0.03), values)
    assert scene.belt.length == pytest.approx(length, rel=1e-15)
    assert with_values(scene, {"tension": 100.0}).tension == 100.0


def test_clamps_replace_the_span_and_the_other_way_round():
    clamps = [[-0.4, 0.0, 0.0], [0.5, 0.0, 0.0]]
    scene = with_values(Scene(span=0.9), {"clamps": clamps})
    assert scene.ends == ((-0.4, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert with_values(scene, {"clamps.0.0": -0.45, "gravity.1": -9.81}).ends[0] == (-0.45, 0.0, 0.0)
    assert with_values(scene, {"span": 0.9}) == Scene(span=0.9)


def test_two_drives_at_once_are_refused():
    with pytest.raises(SceneError, match="only drive"):
        with_values(Scene(), {"pulleys.0.omega": 1.48, "pulleys.0.torque": 1.0})


def test_stiffnesses_replace_the_cross_section():
    values = {"belt.bending_stiffness": 5, "belt.extensional_stiffness": 2e5, "belt.shear_stiffness": 9e4}
    assert with_values(Scene(), {"belt.length": 1.1, **values}).belt == STIFF


def test_a_cross_section_does_not_replace_stiffnesses():
    with pytest.raises(SceneError, match="left out beside"):
        with_values(Scene(belt=STIFF), {"belt.thickness": 0.1})


def test_the_scene_stays_as_it_is():
    scene = Scene()
    with_values(scene, {"pulleys.0.center.0": 0.01, "span": 0.9})
    assert scene == Scene()
