"""The boundary-value problem: reference values, invariances, limits, accuracy on demand, and refusals."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import bvp, solve
from belt_fenicsx.bvp.reading import FIELDS, changes
from belt_fenicsx.bvp.run import Run
from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.status import SolveError, Status

OMEGA = 1.4807092526223  # of the source's scene


def scene(
    *, span=1.0, transport_rate=1.0, radius=0.7, center=(0.0, -0.575), friction=0.2, x_trans=0.0, slip=None, **belt
):
    pulley = Pulley(radius=radius, center=center, friction=friction, x_trans=x_trans, slip=slip)
    return Scene(belt=Belt(**belt), pulleys=(pulley,), span=span, transport_rate=transport_rate)


@pytest.fixture(scope="module")
def tight():
    """The source's scene, as accurate as can be."""
    return bvp.solve(Scene(), rtol=1e-12)


REFERENCES = {
    "forward": ({}, 1.4807092526223, -0.2373388667, 0.2360980112, 610.315737),
    "backward": ({"slip": "backward"}, 1.4841983139747, -0.2364358360, 0.2375975288, -553.722116),
    "pure stick": ({"x_trans": "run-off"}, 1.4825151024971, -0.2368628975, 0.2368628975, 0.0),
    "pure forward slip": ({"x_trans": "run-up"}, 1.4779052879917, -0.2380946437, 0.2356934661, 1162.868190),
    "pure backward slip": (
        {"x_trans": "run-up", "slip": "backward"}, 1.4874009496195, -0.2356934661, 0.2380946437, -1162.868190,
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "omega", "x_up", "x_off", "torque"), REFERENCES.values(), ids=REFERENCES.keys())
def test_reference_values(change, omega, x_up, x_off, torque):
    solution = bvp.solve(scene(**change), rtol=1e-11)
    contact = solution.contacts[0]
    assert solution.success
    assert contact.omega == pytest.approx(omega, rel=2e-11)
    assert contact.x_up == pytest.approx(x_up, abs=1e-10)
    assert contact.x_off == pytest.approx(x_off, abs=1e-10)
    assert contact.torque == pytest.approx(torque, abs=1e-6)


def test_tractions_and_stretch_at_the_borders(tight):
    assert tight.omega == pytest.approx(OMEGA, rel=1e-12)
    fields = tight.fields
    stick, slip = (np.flatnonzero(fields.zone == zone)[[0, -1]] for zone in (1, 2))
    np.testing.assert_allclose(fields.p[stick], [49538.39977, 13501.14983], rtol=1e-9)
    np.testing.assert_allclose(fields.p[slip], [13501.15831, 50996.57215], rtol=1e-9)
    np.testing.assert_allclose(fields.f[slip], [-2700.23166, -10199.31443], rtol=2e-9)
    assert fields.f[stick[0]] == pytest.approx(-1786.75, abs=5e-3)
    np.testing.assert_allclose(fields.D[[*stick, *slip]], [*[1.0364964768] * 3, 1.0399850951], rtol=1e-10)
    assert tight.contacts[0].zones[0].x[1] == pytest.approx(0.0, abs=1e-14)


THIN_OR_EXTREME = {
    "h = 0.005": ({"thickness": 0.005}, 1.478489840725, -0.2132399418),
    "h = 0.002": ({"thickness": 0.002}, 1.478236163997, None),
    "mu = 1": ({"friction": 1.0}, 1.473890161990, None),
    "nu = 0": ({"poisson_ratio": 0.0}, 1.481024986520, None),
}


@pytest.mark.parametrize(("change", "omega", "x_up"), THIN_OR_EXTREME.values(), ids=THIN_OR_EXTREME.keys())
def test_other_scenes(change, omega, x_up):
    solution = bvp.solve(scene(**change), rtol=1e-11)
    assert solution.omega == pytest.approx(omega, rel=1e-11)
    if x_up is not None:
        assert solution.contacts[0].x_up == pytest.approx(x_up, abs=1e-10)


@pytest.mark.parametrize(
    ("change", "factor"),
    [({"youngs_modulus": 2.1e11}, 1.0), ({"width": 3.0}, 1.0), ({"transport_rate": 25.0}, 25.0)],
    ids=["E", "w", "c"],
)
def test_units_do_not_matter(change, factor, tight):
    other = bvp.solve(scene(**change), rtol=1e-12)
    assert other.omega == pytest.approx(factor * tight.omega, rel=1e-12)
    np.testing.assert_allclose(other.fields.r, tight.fields.r, atol=1e-10)
    np.testing.assert_allclose(other.fields.eps, tight.fields.eps, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-3, 40.0])
def test_common_scale_of_lengths(scale, tight):
    other = bvp.solve(
        scene(length=scale, span=scale, radius=0.7 * scale, center=(0.0, -0.575 * scale), thickness=0.05 * scale),
        rtol=1e-12,
    )
    assert other.omega * scale == pytest.approx(tight.omega, rel=1e-11)
    assert other.contacts[0].x_up / scale == pytest.approx(tight.contacts[0].x_up, rel=1e-9)
    assert other.contacts[0].wrap_angle == pytest.approx(tight.contacts[0].wrap_angle, rel=1e-9)


def test_mirror_with_reversed_travel():
    forward = bvp.solve(scene(center=(0.06, -0.575), x_trans="run-up"), rtol=1e-11)
    backward = bvp.solve(scene(center=(-0.06, -0.575), x_trans="run-up", slip="backward"), rtol=1e-11)
    one, other = forward.contacts[0], backward.contacts[0]
    assert (other.x_up, other.x_off) == pytest.approx((-one.x_off, -one.x_up), abs=1e-10)
    assert other.torque == pytest.approx(-one.torque, rel=1e-9)
    for one_end, other_end in ((0, -1), (-1, 0)):
        p_one = forward.fields.p[forward.fields.zone == 1][one_end]
        assert backward.fields.p[backward.fields.zone == 1][other_end] == pytest.approx(p_one, rel=1e-7)


def test_string_limit():
    thicknesses = np.array([0.004, 0.003, 0.002, 0.001])
    omegas = np.array([bvp.solve(scene(thickness=h), rtol=1e-9).omega for h in thicknesses])
    limit = solve(Scene(), method="string").omega
    assert limit == pytest.approx(1.47806, abs=5e-6)
    assert np.polyval(np.polyfit(thicknesses, omegas, 3), 0.0) == pytest.approx(limit, abs=2e-6)
    order = np.polyfit(np.log(thicknesses), np.log(omegas - limit), 1)[0]
    assert order == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7, 1e-9, 1e-11])
def test_wanted_accuracy_is_reached_and_the_estimate_is_honest(rtol, tight):
    solution = bvp.solve(Scene(), rtol=rtol)
    error = abs(solution.omega / tight.omega - 1.0)
    assert error <= solution.error_estimate <= min(rtol, 3.0 * error + 1e-12)


def test_orders_of_collocation():
    """The speed, which ends of cells tell, is of order eight at last; fields between the ends of order five."""
    belt = Belt(length=0.396, thickness=1.2e-3, width=0.03, youngs_modulus=5e8, poisson_ratio=0.4)
    dimensionless, units = Scene(
        belt=belt, span=0.4, pulleys=(Pulley(radius=0.06, center=(0.0, -0.01)),)
    ).dimensionless()
    run = Run(dimensionless, units)
    state = run.start()

    def on(cells):
        return run.work.newton(state.problem, state.discrete.on(state.problem, cells), 1e-13, "test")

    finest, cells = on(64), np.array([8, 11, 16, 22])
    errors = np.array([changes(dimensionless, state.layout, state.problem, on(m), finest) for m in cells])
    speed, *fields = [-np.polyfit(np.log(cells), np.log(error), 1)[0] for error in errors.T]
    assert 7.0 < speed < 9.5
    for name, order in zip(FIELDS, fields, strict=True):
        assert order > 4.5, name


def test_torque_is_the_moment_of_the_friction(tight):
    fields = tight.fields
    assert -0.7 * (fields.weight @ fields.f) == pytest.approx(tight.contacts[0].torque, rel=1e-12)


def test_low_friction_is_not_admissible():
    solution = bvp.solve(scene(friction=0.02), find_zones=False, throw=False)
    assert solution.status is Status.NOT_ADMISSIBLE
    assert not solution.success
    assert any("Coulomb" in violation for violation in solution.violations)
    with pytest.raises(SolveError, match="Coulomb"):
        bvp.solve(scene(friction=0.02), find_zones=False)


@pytest.mark.parametrize("drive", [{"omega": 4.5, "x_trans": None}, {"torque": 0.0, "x_trans": None}, {"x_trans": 0.0}])
def test_without_friction_there_is_no_transition_to_be_checked(drive):
    belt = Belt(length=1.016843946703355, thickness=0.03713582676250412)
    pulley = {"radius": 0.2394963404000744, "center": (0.06018175419704566, -0.13887652607644677), "friction": 0.0}
    solution = bvp.solve(Scene(belt=belt, pulleys=(Pulley(**pulley, **drive),)))
    assert solution.contacts[0].wrap_angle == pytest.approx(0.0447955, rel=1e-5)
    assert solution.omega == pytest.approx(drive.get("omega", 4.20184385), rel=1e-8)


def test_frictionless_belt_slides_freely():
    solution = bvp.solve(scene(friction=0.0))
    assert [zone.kind for zone in solution.zones] == ["free", "slip", "free"]
    assert solution.contacts[0].torque == pytest.approx(0.0, abs=1e-6)
    assert np.max(np.abs(solution.fields.f)) < 1e-9 * np.max(solution.fields.p)


def test_transition_outside_of_the_contact():
    for x_trans in (-0.3, 0.26):
        with pytest.raises(SceneError, match="contact zone") as caught:
            bvp.solve(scene(x_trans=x_trans))
        assert caught.value.field == "pulleys.0.x_trans"


def test_belt_clear_of_the_pulley():
    solution = bvp.solve(scene(center=(0.0, -0.75)), throw=False)
    assert solution.status is Status.NO_CONTACT
    assert solution.contacts == ()
    with pytest.raises(SolveError, match="does not touch the pulley"):
        bvp.solve(scene(center=(0.0, -0.75)))


@pytest.mark.parametrize("rtol", [0.0, 1e-14, 0.2, -1.0, float("nan"), "tight", None])
def test_bad_tolerance(rtol):
    with pytest.raises(SceneError, match="rtol"):
        bvp.solve(Scene(), rtol=rtol)


DRIVES = {
    "omega": ({"omega": 1.48}, "forward", 1.48, -0.08622586, 772.890001),
    "omega, backward": ({"omega": 1.4841983139747}, "backward", 1.4841983139747, 0.0, -553.722116),
    "torque": ({"torque": 610.315737}, "forward", 1.4807092526, 0.0, 610.315737),
    "torque, backward": ({"torque": -553.722116}, "backward", 1.4841983139747, 0.0, -553.722116),
}


@pytest.mark.parametrize(("drive", "sense", "omega", "x_trans", "torque"), DRIVES.values(), ids=DRIVES.keys())
def test_given_speed_or_torque(drive, sense, omega, x_trans, torque):
    solution = bvp.solve(Scene(pulleys=(Pulley(**drive),)), rtol=1e-10)
    contact = solution.contacts[0]
    assert contact.zones[-1].slip == sense
    assert contact.omega == pytest.approx(omega, rel=1e-10)
    assert contact.x_trans == pytest.approx(x_trans, abs=1e-8)
    assert contact.torque == pytest.approx(torque, abs=1e-5)
    assert set(solution.timings) == {"limits", "pure stick", "refinement"}


@pytest.mark.parametrize(("omega", "sense", "torque"), [(1.4, "forward", 1162.868190), (1.6, "backward", -1162.868190)])
def test_speed_beyond_pure_slip(omega, sense, torque):
    solution = bvp.solve(Scene(pulleys=(Pulley(omega=omega),)), rtol=1e-10)
    contact = solution.contacts[0]
    assert [(zone.kind, zone.slip) for zone in contact.zones] == [("slip", sense)]
    assert (contact.omega, contact.torque) == pytest.approx((omega, torque), abs=1e-5)
    assert np.min(np.abs(solution.fields.v_rel[solution.fields.zone == 1])) > 0.05


def test_torque_beyond_pure_slip():
    solution = bvp.solve(Scene(pulleys=(Pulley(torque=1200.0),)), throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert "1162.87 N m" in solution.message


def test_no_torque_is_pure_stick():
    solution = bvp.solve(Scene(pulleys=(Pulley(torque=0.0),)), rtol=1e-10)
    assert [zone.kind for zone in solution.contacts[0].zones] == ["stick"]
    assert solution.omega == pytest.approx(1.4825151024971, rel=1e-10)


def test_warm_start(tight):
    near = scene(x_trans=0.05)
    warm, cold = bvp.solve(near, initial=tight), bvp.solve(near)
    assert warm.omega == pytest.approx(cold.omega, rel=2e-8)
    skipped = {stage.name for stage in warm.stages if stage.iterations is None}
    assert skipped == {"taut string", "continuation", "zone order"}
    assert {stage.name for stage in cold.stages if stage.iterations is None} == {
        "warm start",
        "continuation",
        "zone order",
    }


def test_warm_start_with_other_zones_is_a_cold_start(tight):
    solution = bvp.solve(scene(x_trans="run-off"), initial=tight)
    assert solution.omega == pytest.approx(1.4825151024971, rel=1e-8)
    assert "taut string" in solution.timings


def test_continuation_where_the_string_does_not_suffice():
    short = scene(
        radius=0.38568,
        center=(0.2452, -0.370717),
        friction=0.0026876,
        x_trans="run-up",
        slip="backward",
        length=0.99972,
        thickness=0.01536,
        poisson_ratio=-0.1184,
    )
    solution = bvp.solve(short)
    assert solution.success
    assert "continuation" in solution.timings


def test_fields_are_sorted_and_in_balance(tight):
    fields = tight.fields
    assert np.all(np.diff(fields.sigma) >= 0.0)
    assert [np.sum(fields.sigma == border) for border in tight.zones[1].sigma] == [2, 2]
    assert np.unique(fields.zone).tolist() == [0, 1, 2, 3]
    at_border = np.flatnonzero(np.diff(fields.sigma) == 0.0)
    for name in ("r", "theta", "phi", "D", "kappa", "Q", "M"):
        values = getattr(fields, name)
        scale = np.max(np.abs(values))
        np.testing.assert_allclose(values[at_border], values[at_border + 1], atol=1e-9 * scale, err_msg=name)


def test_stiffnesses_given_directly(tight):
    belt = Belt()
    direct = StiffnessBelt(
        bending_stiffness=belt.bending_stiffness,
        extensional_stiffness=belt.extensional_stiffness,
        shear_stiffness=belt.shear_stiffness,
    )
    assert bvp.solve(replace(Scene(), belt=direct), rtol=1e-12).omega == tight.omega


def test_no_finite_elements_are_loaded():
    code = (
        "import sys; from belt_fenicsx import Scene, bvp; bvp.solve(Scene(), rtol=1e-6);"
        "print([m for m in ('dolfinx', 'petsc4py', 'mpi4py', 'ufl', 'basix', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert done.stderr == ""
