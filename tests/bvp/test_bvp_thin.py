"""The boundary-value problem on real belts: thin ones, short contacts, drives next to their limits, budgets, errors."""

import re
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import bvp
from belt_fenicsx.bvp import newton as bvp_collocation
from belt_fenicsx.bvp.newton import Work
from belt_fenicsx.bvp.reading import FIELDS, changes
from belt_fenicsx.bvp.run import Run
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.drives import solve_driven
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import SolveError, Status

pytestmark = pytest.mark.serial


def chapter(**pulley):
    return Scene(pulleys=(Pulley(**pulley),))


def steel(thickness, length=1.0448):
    belt = Belt(length=length, youngs_modulus=210e9, poisson_ratio=0.3, thickness=thickness, width=0.05)
    return Scene(belt=belt, pulleys=(Pulley(radius=0.2, center=(0.0, -0.05), friction=0.15),))


FLAT = Scene(
    belt=Belt(length=0.396, youngs_modulus=5e8, poisson_ratio=0.4, thickness=1.2e-3, width=0.03),
    pulleys=(Pulley(radius=0.06, center=(0.0, -0.01), friction=0.3, x_trans=0.0),),
    span=0.4,
    transport_rate=10.0,
)
LONG_SPAN = Scene(
    belt=Belt(length=1.492 / 1.0253, youngs_modulus=4.6e8, poisson_ratio=0.4, thickness=0.00077),
    pulleys=(Pulley(radius=0.0424, center=(0.0, 0.1052), friction=0.373),),
    span=1.492,
)
# Scene, omega, torque; those of the first four from meshes whose maps differ in width by factors of three.
THIN = {
    "steel, 1 mm": (steel(1e-3), 5.006565865506, 133.8654881),
    "steel, 0.1 mm": (steel(1e-4), 5.005012036239, 10.02933092),
    "flat belt": (FLAT, 173.4203458141, 3.514324172),
    "long span": (LONG_SPAN, 24.61325413556, 5.00012755),
    "hardly any strain": (Scene(belt=Belt(thickness=0.0007, length=1.03)), 1.436206236275, 0.8441578069),
}


@pytest.mark.parametrize(("scene", "omega", "torque"), THIN.values(), ids=THIN.keys())
def test_thin_belts(scene, omega, torque):
    solution = bvp.solve(scene)
    tension = np.max(np.abs(solution.fields.Q[:, 0]))
    assert solution.omega == pytest.approx(omega, rel=1e-8)
    assert solution.contacts[0].torque == pytest.approx(torque, abs=2e-6 * tension * scene.pulleys[0].radius)
    assert set(solution.field_errors) == {*FIELDS, "M"}
    assert max(solution.field_errors.values()) <= 1e-4


@pytest.mark.parametrize("strain", [3e-2, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("slenderness", [1e-2, 1e-3, 5e-4, 2.5e-4, 1e-4])
def test_thin_belts_of_any_strain(slenderness, strain):
    scene = steel(0.2 * slenderness, tangent_path(steel(1e-3)).length / (1.0 + strain))
    solution = bvp.solve(scene, throw=False)
    assert solution.success
    assert solution.error_estimate <= 1e-8


SHORT = {
    # From the fitted method.
    "thick": (
        Belt(length=1.0044461032478906, poisson_ratio=-0.16402973665107268, thickness=0.014088557503635071),
        {"radius": 0.2208682827931443, "center": (0.09669450497679993, -0.17442113032908813)},
        (0.10672118581, 0.10691762895),
    ),
    "thin": (
        Belt(length=0.995, poisson_ratio=0.28, thickness=0.001343, width=0.05),
        {"radius": 0.0975, "center": (0.0953, -0.0918)},
        None,
    ),
}


@pytest.mark.parametrize(("belt", "place", "ends"), SHORT.values(), ids=SHORT.keys())
def test_contact_that_is_nearly_a_point(belt, place, ends):
    """A belt that gives way in shear touches the pulley along an arc, however short; no length below zero is one."""
    scene = Scene(belt=belt, pulleys=(Pulley(friction=0.3, x_trans="run-off", **place),))
    contact = bvp.solve(scene, rtol=1e-10).contacts[0]
    assert 0.0 < contact.x_off - contact.x_up < 1e-2
    if ends is not None:
        assert (contact.x_up, contact.x_off) == pytest.approx(ends, abs=1e-9)


def test_wrap_of_more_than_a_half_turn():
    scene = Scene(belt=Belt(length=3.8, thickness=0.01), pulleys=(Pulley(radius=0.7, center=(0.0, 1.0)),))
    assert bvp.solve(scene).contacts[0].wrap_angle == pytest.approx(3.58269, abs=5e-6)


DRIVEN = {
    "little friction": ({"friction": 1e-3, "torque": 0.0}, 1.4823968214, 0.0),
    "slight torque": ({"torque": 1e-3}, 1.482515100271, 1e-3),
    "slighter torque": ({"torque": 1e-5}, 1.482515102475, 1e-5),
    "hardly any friction": ({"friction": 1e-8, "torque": 0.0}, 1.482388621, 0.0),
    "friction of one millionth": ({"friction": 1e-6}, 1.482382469643, 0.005810026636),
    "past the run-up of pure stick": ({"friction": 1.0, "x_trans": -0.2442}, 1.4602505905, None),
    "next to the run-off": ({"x_trans": 0.2368628975 - 1e-7}, 1.482515100591, None),
    "nearly at the run-off": ({"x_trans": 0.2368628975 - 1e-9}, 1.482515102436, None),
    "next to the run-up": ({"x_trans": -0.2380946437 + 1e-7}, 1.477905291423, None),
    "pulley at rest, no friction": ({"friction": 0.0, "omega": 0.0}, 0.0, 0.0),
    "pulley at rest": ({"omega": 0.0}, 0.0, 1162.868190),
    "pulley turning backward": ({"omega": -1.0}, -1.0, 1162.868190),
    "nearly pure slip": ({"torque": 1162.868190 * (1.0 - 1e-6)}, 1.4779052948, 1162.867027),
}


@pytest.mark.parametrize(("pulley", "omega", "torque"), DRIVEN.values(), ids=DRIVEN.keys())
def test_drives_next_to_their_limits(pulley, omega, torque):
    solution = bvp.solve(chapter(**pulley), rtol=1e-10)
    assert solution.omega == pytest.approx(omega, rel=2e-10, abs=1e-12)
    if torque is not None:
        assert solution.contacts[0].torque == pytest.approx(torque, rel=1e-6, abs=1e-9)


def test_transition_behind_the_vertical():
    belt = Belt(length=1.3106, poisson_ratio=0.3, thickness=0.0034)
    pulley = Pulley(radius=0.27, center=(-0.22, 0.08), friction=0.3, x_trans=-0.489)
    assert bvp.solve(Scene(belt=belt, pulleys=(pulley,))).omega == pytest.approx(3.71623022, rel=1e-8)


@pytest.mark.parametrize("part", [1e-3, 1e-4, 1e-5, 1e-6, 1e-8])
@pytest.mark.parametrize("friction", [0.2, 0.02])
def test_torque_of_a_part_of_the_capacity(friction, part):
    given = 5814.34095 * friction * part
    solution = bvp.solve(chapter(friction=friction, torque=given))
    assert solution.contacts[0].torque == pytest.approx(given, rel=1e-2 if part == 1e-8 else 1e-5)


@pytest.mark.parametrize("part", [1e-2, 3e-5, 1e-6, 1e-8])
def test_speed_next_to_pure_slip(part):
    limits = 1.4779052879917, 1.4825151024971
    solution = bvp.solve(chapter(omega=limits[0] * (1.0 - part) + limits[1] * part), rtol=1e-10)
    kinds = [zone.kind for zone in solution.contacts[0].zones]
    assert kinds == ["stick", "slip"]
    assert solution.contacts[0].torque == pytest.approx(1162.868190 * (1.0 - 0.677 * part), rel=1e-4 * part**0.5 + 1e-8)


def test_torque_just_beyond_the_capacity():
    solution = bvp.solve(chapter(torque=1162.868190 * (1.0 + 1e-6)), throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert "transmits 1162.87 N m, which the given torque exceeds by 0.0001 %" in solution.message


@pytest.mark.parametrize("friction", [200.0, 1e3, 1e9])
def test_friction_that_leaves_no_tension(friction):
    solution = bvp.solve(chapter(friction=friction), throw=False)
    assert solution.status is Status.CONTACT_LOST
    assert "the belt is slack at one end of the contact" in solution.message


def test_interval_of_transitions_is_printed_in_order():
    with pytest.raises(SceneError, match=r"in \(-0\.238094644, 0\.23686289[78]\) \[m\]"):
        bvp.solve(chapter(x_trans=0.2368628975 + 1e-8))


@pytest.mark.parametrize("drive", [{"omega": 1.4822}, {"omega": 1.48}, {"omega": 1.4}, {"torque": 300.0}, {}])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_error_of_what_is_asked_for(drive, rtol):
    rough, exact = (bvp.solve(chapter(**drive), rtol=tolerance) for tolerance in (rtol, 1e-12))
    if "omega" in drive:
        tension = float(np.max(np.abs(exact.fields.Q[exact.fields.zone == 0, 0])))
        error = abs(rough.contacts[0].torque - exact.contacts[0].torque) / (0.7 * tension)
    else:
        error = abs(rough.omega / exact.omega - 1.0)
    assert error <= rough.error_estimate * (1.0 + 1e-3) + 1e-12
    assert rough.error_estimate <= rtol


@pytest.mark.parametrize("scene", [Scene(), FLAT, steel(1e-3)], ids=["chapter", "flat", "steel"])
@pytest.mark.parametrize("rtol", [1e-7, 1e-9])
def test_errors_of_fields(scene, rtol):
    rough, exact = bvp.solve(scene, rtol=rtol), bvp.solve(scene, rtol=1e-12)
    layout, problem = exact.state.layout, exact.state.problem
    _, *true = changes(scene.dimensionless()[0], layout, problem, rough.state.discrete, exact.state.discrete)
    estimates = [rough.field_errors[name] for name in FIELDS]
    assert np.all(np.array(true) <= estimates)
    assert np.all(np.array(estimates) <= 100.0 * np.array(true))
    assert max(estimates) <= 1e4 * rtol


def test_accuracy_that_no_mesh_reaches(monkeypatch):
    monkeypatch.setattr(bvp_collocation, "FINEST", 16)
    solution = bvp.solve(Scene(), rtol=1e-12, throw=False)
    assert solution.status is Status.ACCURACY_NOT_REACHED
    assert re.match("On 16 cells, [a-z]+ has a relative error of [0-9e-]+, 1e-08 is wanted.", solution.message)
    assert solution.omega == pytest.approx(1.4807092526223, rel=solution.error_estimate)
    with pytest.raises(SolveError, match="has a relative error"):
        bvp.solve(Scene(), rtol=1e-12)


@pytest.mark.parametrize("thickness", [0.05, 1e-3, 1e-4])
def test_tightest_tolerance(thickness):
    scene = Scene(belt=Belt(thickness=thickness))
    tightest, tight = (bvp.solve(scene, rtol=rtol) for rtol in (1e-13, 1e-12))
    assert tightest.omega == pytest.approx(tight.omega, rel=1.1e-12)


def test_budget_of_newton_iterations():
    dimensionless, units = chapter(torque=600.0).dimensionless()
    with pytest.raises(Stopped, match="After 1 Newton iterations, .* stage `continuation` has no answer yet") as caught:
        solve_driven(Run(dimensionless, units, work=Work(left=1.0)))
    assert caught.value.status is Status.NEWTON_DIVERGED
    assert "`initial`" in caught.value.message


@pytest.mark.parametrize("pulley", [{"x_trans": 0.05}, {"omega": 1.48}, {"torque": 300.0}])
def test_start_from_the_fields_of_another_method(pulley):
    other = replace(bvp.solve(Scene()), state=None)
    warm, cold = bvp.solve(chapter(**pulley), initial=other), bvp.solve(chapter(**pulley))
    assert "warm start" in warm.timings
    assert warm.contacts[0].x_trans == pytest.approx(cold.contacts[0].x_trans, abs=1e-6)
    assert warm.omega == pytest.approx(cold.omega, rel=1e-8)


@pytest.mark.parametrize(("field", "arguments"), [("scene", (3, None)), ("initial", (Scene(), "a.npz"))])
def test_arguments_of_a_wrong_kind(field, arguments):
    with pytest.raises(SceneError) as caught:
        bvp.solve(arguments[0], initial=arguments[1])
    assert caught.value.field == field


def test_clear_belt_has_fields():
    solution = bvp.solve(chapter(center=(0.0, -0.75)), throw=False)
    assert solution.status is Status.NO_CONTACT
    assert np.all(solution.fields.p == 0.0)
