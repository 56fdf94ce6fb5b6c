"""The search, handed a method that is made up: what it does with revisions, refinements and failures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from belt_fenicsx.layout.kind import STICK, Part
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.layout.revision import Resultants, Sample, Samples, Tolerances
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.search.divided import divide_stick, place_transition, slides_both_ways
from belt_fenicsx.search.find import attempt, find, settle
from belt_fenicsx.search.limits import meets
from belt_fenicsx.solution.stages import Stages, Stopped
from belt_fenicsx.solution.status import Status

X = np.linspace(-0.2, 0.2, 401)
FORWARD = Part("slip", "forward")
BOUND = 0.2


def scene(**drive):
    return Scene(pulleys=(Pulley(friction=BOUND, **drive),))


@dataclass(frozen=True)
class State:
    layout: Layout
    ends: np.ndarray
    degree: int = 0


@dataclass
class Method:
    """Friction in stick is x + 0.15: it breaks its bound 0.2 behind x = 0.05. A state is refined three times."""

    scene: Scene
    diverges: bool = False
    stages: Stages = field(default_factory=Stages)

    def transfer(self, state, layout, ends):
        return State(layout, ends, state.degree)

    def converge(self, start, stage, why):
        self.stages.ran(stage, why, 1)
        if self.diverges:
            raise Stopped(Status.NEWTON_DIVERGED, "")
        return start

    def sharpen(self, state, why):
        return state

    def is_plausible(self, state):
        return True

    def samples(self, state):
        return samples(state.layout, state.ends)

    def tolerances(self, state):
        return Tolerances(shrunk=0.0, bound=1e-8, sense=1e-8)

    def refine(self, state):
        return None if state.degree == 3 else State(state.layout, state.ends, state.degree + 1)


def samples(layout, ends):
    parts = [None] * len(layout.parts)
    for i in layout.on(0):
        sigma = np.linspace(ends[i], ends[i + 1], X.size)
        sticks = layout.parts[i].kind == "stick"
        f = sigma + 0.15 if sticks else -BOUND * layout.parts[i].sense * np.ones(X.size)
        parts[i] = Sample(sigma, sigma, np.ones(X.size), f, 1.04 + 0.01 * (sigma - sigma[0]) * (not sticks), f.copy)
    friction = sum(float(np.mean(part.f) * np.ptp(part.sigma)) for part in parts if part is not None)
    return Samples(np.asarray(ends), tuple(parts), (Resultants(1.04, float(ends[2]), 0.4, friction),))


def stick(asked):
    layout = ordered(asked, [STICK])
    return State(layout, np.array([-0.5, -0.2, 0.2, 0.5]))


def test_rows_are_settled_and_states_refined_until_nothing_changes():
    method = Method(scene(x_trans="run-off"))
    found = find(method, stick(method.scene))
    assert (str(found.layout), found.degree) == ("stick | forward slip", 3)
    assert found.ends[2] == pytest.approx(0.05, abs=0.002)
    assert [stage.name for stage in method.stages if stage.iterations] == ["zone order"]


def test_where_revised_rows_lead_nowhere_a_finer_state_goes_on():
    method = Method(scene(x_trans="run-off"), diverges=True)
    found = find(method, stick(method.scene))
    assert (str(found.layout), found.degree) == ("stick", 3)
    assert sum(stage.name == "zone order" for stage in method.stages) == 3


def test_a_failure_that_says_more_than_no_convergence_is_passed_on():
    def lost():
        raise Stopped(Status.CONTACT_LOST, "")

    def spent():
        raise Stopped(Status.NEWTON_DIVERGED, "", final=True)

    def diverged():
        raise Stopped(Status.NEWTON_DIVERGED, "")

    assert attempt(diverged) is None
    for way in (lost, spent):
        with pytest.raises(Stopped):
            attempt(way)


def test_a_layout_that_comes_back_ends_the_revisions():
    class Again(Method):
        def transfer(self, state, layout, ends):
            return stick(self.scene)

    method = Again(scene(x_trans="run-off"))
    assert str(settle(method, stick(method.scene)).layout) == "stick"
    assert len(method.stages) == 1


def test_a_transition_is_placed_in_pure_stick():
    asked = scene(x_trans=0.1, slip="backward")
    pure = stick(asked)
    layout, ends = divide_stick(asked, pure.layout, samples(pure.layout, pure.ends), 0.05)
    assert (str(layout), ends.tolist()) == ("stick | backward slip", pytest.approx([-0.5, -0.2, 0.1, 0.2, 0.5]))
    beyond = scene(x_trans=0.3)
    _, ends = divide_stick(beyond, pure.layout, samples(pure.layout, pure.ends), 0.05)
    assert ends[2] == pytest.approx(0.18)


def test_friction_of_the_given_torque_tells_where_stick_ends():
    """From x on, sliding forward has the friction -0.2 in the place of x + 0.15."""
    asked = scene(torque=1e-4)
    pure = stick(asked)
    seen = samples(pure.layout, pure.ends)
    for wanted in (0.19, 0.195):
        changed = -sum((x + 0.35) * (0.2 - wanted) for x in np.linspace(wanted, 0.2, 101)) / 101
        given = scene(torque=-0.7 * (seen.pulleys[0].friction + changed))
        parts, ends = place_transition(given, pure.layout, seen, 0)
        assert parts == [STICK, FORWARD]
        assert ends.tolist() == [-0.2, pytest.approx(wanted, abs=3e-4), 0.2]


def test_a_torque_for_which_nothing_is_to_stick():
    asked = scene(torque=1.0)
    pure = stick(asked)
    parts, ends = place_transition(asked, pure.layout, samples(pure.layout, pure.ends), 0)
    assert (parts, ends.tolist()) == ([FORWARD], [-0.2, 0.2])


@pytest.mark.parametrize("part", [0.25, 0.5])
def test_sliding_both_ways_turns_where_the_belt_has_the_given_speed(part):
    """The stretch grows along the contact: the belt is slower than the pulley before that place."""
    ends = np.array([-0.5, -0.2, 0.2, 0.5])
    asked = scene(omega=(1.04 + 0.01 * 0.4 * part) / 0.7)
    layout = ordered(asked, [FORWARD])
    parts, ends = slides_both_ways(asked, layout, samples(layout, ends), 0)
    assert parts == [FORWARD.turned, FORWARD]
    assert ends.tolist() == [-0.2, pytest.approx(-0.2 + 0.4 * part, abs=1e-3), 0.2]


@pytest.mark.parametrize(
    ("contact", "drive", "met"),
    [
        ([STICK], {"omega": 1.04 / 0.7}, True),
        ([STICK], {"omega": 1.05 / 0.7}, False),
        ([STICK, FORWARD], {"omega": 9.0}, True),
        ([FORWARD], {"omega": 1.03 / 0.7}, True),
        ([FORWARD], {"omega": 1.05 / 0.7}, False),
        ([FORWARD], {"torque": 0.01}, False),
        ([FORWARD], {"x_trans": 0.0}, True),
    ],
)
def test_drives_that_are_met(contact, drive, met):
    method = Method(scene(**drive))
    layout = ordered(method.scene, contact)
    ends = np.array([-0.5, *np.linspace(-0.2, 0.2, len(contact) + 1), 0.5])
    assert meets(method, State(layout, ends)) is met


def test_a_torque_beyond_that_of_sliding_all_along():
    method = Method(scene(torque=1.0))
    method.units = method.scene.dimensionless()[1]
    state = State(ordered(method.scene, [FORWARD]), np.array([-0.5, -0.2, 0.2, 0.5]))
    with pytest.raises(Stopped, match="Sliding all along, the belt transmits .* N m") as stopped:
        meets(method, state)
    assert stopped.value.status is Status.CAPACITY_EXCEEDED


def test_a_transition_where_stick_cannot_end_is_refused_by_comparison_with_the_limits():
    class Between(Method):
        def at(self, other):
            return Between(other)

        def start(self, near=None):
            return State(posed(self.scene), np.array([-0.5, -0.2, 0.2, 0.5]))

        def samples(self, state):
            seen = samples(state.layout, state.ends)
            (on_pulley,), sticks = seen.pulleys, state.layout.contact[0] == STICK
            place = 0.05 if sticks else -0.2
            return Samples(seen.ends, seen.parts, (Resultants(1.04, place, 0.4, on_pulley.friction),))

        def tolerances(self, state):
            return None if len(state.layout.contact) == 1 else super().tolerances(state)

    for x_trans, refused in ((0.1, True), (0.0, False)):
        method = Between(scene(x_trans=x_trans))
        method.units = method.scene.dimensionless()[1]
        state = State(posed(method.scene), np.array([-0.5, -0.2, 0.1, 0.2, 0.5]))
        if refused:
            with pytest.raises(SceneError, match=r"where stick can end .* \(-0.2, 0.05\)"):
                settle(method, state)
        else:
            assert settle(method, state) is state
