"""The order of the zones that the boundary-value problem finds, and the drives that depend on it."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import bvp
from belt_fenicsx.scene.belt import Belt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.status import Status

pytestmark = pytest.mark.serial


def scene(*, radius=0.7, center=(0.0, -0.575), friction=0.2, span=1.0, belt=None, **drive):
    pulley = Pulley(radius=radius, center=center, friction=friction, **drive)
    return Scene(belt=Belt(**(belt or {})), pulleys=(pulley,), span=span)


def zones(solution):
    return " | ".join(zone.slip or zone.kind for zone in solution.contacts[0].zones)


def ends(solution, zone):
    """Values of p, f and D at both ends of a zone on the pulley."""
    where = np.flatnonzero(solution.fields.zone == zone + 1)[[0, -1]]
    return tuple(getattr(solution.fields, name)[where] for name in ("p", "f", "D"))


ENTRY = {
    0.03: (1.482185403515, -0.2287401336),
    0.02: (1.482261967364, -0.2115616953),
    0.001: (1.482379065653, -0.1230078604),
}


@pytest.mark.parametrize(("friction", "omega", "border"), [(mu, *values) for mu, values in ENTRY.items()])
def test_sliding_before_stick(friction, omega, border):
    solution = bvp.solve(scene(friction=friction), rtol=1e-12)
    assert zones(solution) == "forward | stick | forward"
    assert solution.omega == pytest.approx(omega, rel=1e-12)
    assert solution.contacts[0].zones[0].x[1] == pytest.approx(border, abs=2e-10)
    assert any("where stick begins" in stage.why for stage in solution.stages if stage.name == "zone order")


def test_friction_is_continuous_where_stick_begins():
    solution = bvp.solve(scene(friction=0.02), rtol=1e-11)
    (_, before, _), (p, after, _) = ends(solution, 0), ends(solution, 1)
    assert before[1] == pytest.approx(after[0], rel=1e-7)
    assert abs(after[0]) == pytest.approx(0.02 * p[0], rel=1e-7)
    assert after[0] < 0.0


@pytest.mark.parametrize("friction", [0.03, 0.02, 0.001])
def test_longest_stick_ends_where_friction_reaches_its_bound(friction):
    solution = bvp.solve(scene(friction=friction, x_trans="run-off"), rtol=1e-10)
    p, f, _ = ends(solution, 1)
    assert zones(solution) == "forward | stick | forward"
    assert f / p == pytest.approx([-friction, friction], rel=1e-5)
    # D rises whatever the friction there, so that the belt slides forward and friction turns round.
    p, f, D = ends(solution, 2)
    assert f[0] == pytest.approx(-friction * p[0], rel=1e-9)
    assert D[1] > D[0]


@pytest.mark.parametrize("friction", [0.03, 0.02, 0.01, 0.001, 1e-4])
def test_free_pulley_with_little_friction(friction):
    solution = bvp.solve(scene(friction=friction, torque=0.0))
    assert solution.contacts[0].torque == pytest.approx(0.0, abs=1e-9)
    assert zones(solution) in ("forward | stick | backward | forward", "forward | backward | forward")


def test_sliding_turns_next_to_the_run_off():
    solution = bvp.solve(scene(friction=0.03, x_trans=0.22, slip="backward"), rtol=1e-9)
    assert zones(solution) == "forward | stick | backward | forward"
    stretch = ends(solution, 1)[2][0]
    assert ends(solution, 2)[2] == pytest.approx([stretch, stretch], rel=1e-9)


def test_transition_before_stick_can_begin():
    solution = bvp.solve(scene(friction=0.02, x_trans=-0.22, slip="backward"), rtol=1e-9)
    assert zones(solution) == "forward | backward"
    assert solution.contacts[0].x_trans == pytest.approx(-0.22, abs=1e-12)
    given = bvp.solve(scene(friction=0.02, omega=solution.omega), rtol=1e-9)
    assert zones(given) == "forward | backward"
    assert given.contacts[0].x_trans == pytest.approx(-0.22, abs=1e-6)


def test_pure_slip_turns_the_pulley_slower_than_any_part_of_the_belt():
    solution = bvp.solve(scene(friction=0.02, x_trans="run-up"), rtol=1e-9)
    inside = solution.fields.D[solution.fields.zone == 1]
    assert solution.omega == pytest.approx(np.min(inside) / 0.7, rel=1e-6)
    assert np.min(inside) < inside[0]


OUTSIDE = {
    "just behind the run-off": {"x_trans": 0.23687},
    "a little behind the run-off": {"x_trans": 0.2378},
    "just before the run-up": {"x_trans": -0.23810},
    "before the run-up of backward slip": {"x_trans": -0.2365, "slip": "backward"},
    "where stick has ended": {"friction": 0.02, "x_trans": 0.22},
    "where stick has ended, backward": {"friction": 0.02, "x_trans": 0.22, "slip": "backward"},
    "before stick begins": {"friction": 0.02, "x_trans": -0.22},
}


@pytest.mark.parametrize("change", OUTSIDE.values(), ids=OUTSIDE.keys())
def test_transition_where_stick_cannot_end(change):
    with pytest.raises(SceneError, match="contact zone") as caught:
        bvp.solve(scene(**change))
    assert caught.value.field == "pulleys.0.x_trans"


@pytest.mark.parametrize("x_trans", [-0.2380, 0.2368])
def test_transition_just_inside_of_the_contact(x_trans):
    assert bvp.solve(scene(x_trans=x_trans)).contacts[0].x_trans == pytest.approx(x_trans, abs=1e-12)


@pytest.mark.parametrize("drive", ["omega", "torque"])
@pytest.mark.parametrize("friction", [0.2, 0.02])
@pytest.mark.parametrize(
    ("x_trans", "slip"), [(-0.2, "forward"), (0.2, "forward"), (-0.1, "backward"), (0.1, "backward")]
)
def test_drives_lead_to_the_same_answer(drive, friction, x_trans, slip):
    placed = bvp.solve(scene(friction=friction, x_trans=x_trans, slip=slip), rtol=1e-10)
    wanted = placed.contacts[0]
    given = bvp.solve(scene(friction=friction, **{drive: getattr(wanted, drive)}), rtol=1e-10)
    found = given.contacts[0]
    assert zones(given) == zones(placed)
    assert found.omega == pytest.approx(wanted.omega, rel=1e-9)
    assert found.torque == pytest.approx(wanted.torque, abs=1e-4)
    assert found.x_trans == pytest.approx(wanted.x_trans, abs=2e-6)


def test_speeds_that_a_coarse_mesh_does_not_tell_apart():
    slippery = scene(friction=1e-4, x_trans=-0.05, belt={"length": 1.02, "thickness": 0.01})
    placed = bvp.solve(slippery, rtol=1e-9)
    pulley = replace(slippery.pulleys[0], x_trans=None, slip=None, omega=placed.omega)
    given = bvp.solve(replace(slippery, pulleys=(pulley,)), rtol=1e-9)
    assert zones(given) == zones(placed)
    assert given.contacts[0].x_trans == pytest.approx(-0.05, abs=1e-3)


@pytest.mark.parametrize("drive", ["omega", "torque"])
@pytest.mark.parametrize("friction", [0.2, 0.02])
@pytest.mark.parametrize("part", [1e-7, 1e-4, 1e-2, 0.99, 0.9999])
@pytest.mark.parametrize("slip", ["forward", "backward"])
def test_drives_next_to_pure_stick_and_pure_slip(drive, friction, part, slip):
    stick, slid = (
        bvp.solve(scene(friction=friction, x_trans=x_trans, slip=slip)).contacts[0] for x_trans in ("run-off", "run-up")
    )
    given = getattr(stick, drive) + part * (getattr(slid, drive) - getattr(stick, drive))
    solution = bvp.solve(scene(friction=friction, **{drive: given}))
    assert getattr(solution.contacts[0], drive) == pytest.approx(given, rel=0.0, abs=1e-6 * abs(getattr(slid, drive)))
    sticks = [number + 1 for number, zone in enumerate(solution.contacts[0].zones) if zone.kind == "stick"]
    assert np.max(np.abs(solution.fields.v_rel[np.isin(solution.fields.zone, sticks)]), initial=0.0) < 1e-7


@pytest.mark.parametrize("drive", ["omega", "torque"])
def test_pure_stick_tells_where_sliding_turns(drive):
    """Next to the run-off, sliding turns: the first guess has all zones already."""
    placed = bvp.solve(scene(friction=0.02, x_trans=0.195, slip="backward"), rtol=1e-10)
    given = bvp.solve(scene(friction=0.02, **{drive: getattr(placed.contacts[0], drive)}), rtol=1e-10)
    assert zones(given) == zones(placed) == "forward | stick | backward | forward"
    assert set(given.timings) == {"limits", "pure stick", "refinement"}
    assert given.contacts[0].x_trans == pytest.approx(0.195, abs=1e-6)


@pytest.mark.parametrize("drive", ["omega", "torque"])
def test_sliding_that_turns_without_stick(drive):
    """Between pure backward slip and the first stick, sliding turns next to the run-off."""
    base = scene(
        radius=0.3936,
        center=(0.0996, 0.2171 - 0.3936),
        friction=0.025,
        x_trans="run-up",
        slip="backward",
        belt={"length": 1.0997, "thickness": 0.0453, "poisson_ratio": 0.4742},
    )
    limit = bvp.solve(base).contacts[0]
    near = replace(base.pulleys[0], x_trans=limit.x_up + 1e-3)
    turned = bvp.solve(replace(base, pulleys=(near,))).contacts[0]
    middle = (getattr(limit, drive) + getattr(turned, drive)) / 2
    given = replace(near, x_trans=None, slip=None, **{drive: middle})
    solution = bvp.solve(replace(base, pulleys=(given,)))
    assert zones(solution) == "backward | forward"
    assert getattr(solution.contacts[0], drive) == pytest.approx(middle, rel=1e-9)


@pytest.mark.parametrize(
    ("friction", "torque", "capacity"), [(0.2, 1200.0, "1162.87"), (0.2, -1e9, "-1162.87"), (0.0, 1.0, "0")]
)
def test_torque_beyond_the_capacity(friction, torque, capacity):
    solution = bvp.solve(scene(friction=friction, torque=torque), throw=False)
    assert solution.status is Status.CAPACITY_EXCEEDED
    assert f"{capacity} N m" in solution.message


@pytest.mark.parametrize("friction", [0.2, 0.02])
@pytest.mark.parametrize("drive", ["omega", "torque"])
def test_warm_start_needs_no_limits(drive, friction):
    first = bvp.solve(scene(friction=friction))
    near = bvp.solve(scene(friction=friction, x_trans=0.01)).contacts[0]
    given = scene(friction=friction, **{drive: getattr(near, drive)})
    warm = bvp.solve(given, initial=first)
    assert "limits" not in warm.timings
    assert "taut string" not in warm.timings
    assert warm.contacts[0].x_trans == pytest.approx(0.01, abs=1e-5)


def test_warm_start_that_turns_the_sliding_round():
    first = bvp.solve(scene(torque=20.0))
    solution = bvp.solve(scene(torque=-20.0), initial=first)
    assert zones(solution) == "stick | backward"
    assert solution.contacts[0].torque == pytest.approx(-20.0, rel=1e-9)


def test_contact_that_is_not_one_arc():
    solution = bvp.solve(scene(belt={"length": 1.05}), throw=False)
    assert solution.status is Status.NOT_ADMISSIBLE
    assert "lift off inside of the contact" in solution.message


def test_contact_next_to_a_clamp():
    stretched = scene(
        radius=0.8336,
        center=(-0.04611, -0.70299),
        friction=0.03775,
        x_trans=-0.1921,
        belt={"length": 1.02793, "thickness": 0.02039, "poisson_ratio": 0.2754},
    )
    solution = bvp.solve(stretched, rtol=1e-10)
    assert zones(solution) == "forward | stick | forward"
    # As by the fitted method.
    assert solution.omega == pytest.approx(1.21761597263, rel=1e-10)
    assert solution.contacts[0].x_up == pytest.approx(-0.4838998481, abs=1e-9)


def test_steep_layer_where_stick_begins():
    """The new border has to start close to its place: layers are a hundredth of the contact here."""
    steep = scene(
        radius=1.0671,
        center=(-0.0686, -0.9772),
        friction=0.0159,
        x_trans=0.0041,
        slip="backward",
        belt={"length": 0.98987, "thickness": 0.01407, "poisson_ratio": 0.0385},
    )
    solution = bvp.solve(steep)
    assert zones(solution) == "forward | stick | backward"
    assert "continuation" not in solution.timings


def random_scenes(number, seed):
    """Belts over pulleys of all sizes, their strain from 0.5 to 8 %, stick ending in the middle of the wrap."""
    rng = np.random.default_rng(seed)
    while number:
        radius, top, x = rng.uniform(0.25, 2.0), rng.uniform(0.03, 0.35), rng.uniform(-0.1, 0.1)
        friction, thickness = np.exp(rng.uniform(np.log([0.01, 0.004]), np.log([1.0, 0.08])))
        angles, path = [], 0.0
        for clamp in (-0.5, 0.5):
            away = np.array([clamp - x, radius - top])
            distance = np.hypot(*away)
            if distance <= 1.05 * radius:
                break
            angles.append(np.arctan2(away[0], away[1]) - np.sign(clamp) * np.arccos(radius / distance))
            path += np.sqrt(distance**2 - radius**2)
        if len(angles) < 2 or angles[1] - angles[0] < 0.2:
            continue
        number -= 1
        length = (path + radius * (angles[1] - angles[0])) / (1.0 + rng.uniform(0.005, 0.08))
        yield scene(
            radius=radius,
            center=(x, top - radius),
            friction=float(friction),
            x_trans=float(x + radius * np.sin(np.mean(angles))),
            slip=("forward", "backward")[rng.integers(2)],
            belt={"length": float(length), "thickness": float(thickness), "poisson_ratio": rng.uniform(0.0, 0.49)},
        )


def test_random_scenes_are_solved_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outside, failed = [], []
        for index, random in enumerate(random_scenes(20, seed=5)):
            try:
                solution = bvp.solve(random, rtol=1e-6, throw=False)
            except SceneError as error:  # The contact of a stiff belt is shorter than that of a string.
                outside.append((index, error.field))
            else:
                failed += [] if solution.success else [(index, solution.status, solution.message)]
    assert failed == []
    assert outside == [(12, "pulleys.0.x_trans")]
