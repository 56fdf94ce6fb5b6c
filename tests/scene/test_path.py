"""The path of the taut middle line: closed formulas, a real drive, and what it must not depend on."""

import math
import random
from dataclasses import replace

import pytest

from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.path import taut_path
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

pytestmark = pytest.mark.serial

FULL_TURN = 2.0 * math.pi
THIN = StiffnessBelt(bending_stiffness=0.002, extensional_stiffness=1.1e5, shear_stiffness=4e4)


def loop(*pulleys, offset=0.0, **given):
    """A loop over pulleys, each by its radius, its centre and perhaps its side; the first one drives."""
    drives = [{"omega": 10.0}, *({"torque": 0.0} for _ in pulleys[1:])]
    made = [
        Pulley(radius=radius, center=center, side=side[0] if side else "right", **drive)
        for (radius, center, *side), drive in zip(pulleys, drives, strict=True)
    ]
    given = {"elongation": 0.01} | given
    return Scene(belt=replace(THIN, contact_offset=offset), pulleys=tuple(made), closed=True, **given)


@pytest.mark.parametrize("offset", [0.0, 0.01])
@pytest.mark.parametrize("side", ["right", "left"])
def test_open_belt(offset, side):
    r, R, d = 0.06 + offset, 0.12 + offset, 0.35
    path = taut_path(loop((0.06, (0.0, 0.0), side), (0.12, (0.0, d), side), offset=offset))
    angle = math.asin((R - r) / d)
    assert path.length == pytest.approx(2 * d * math.cos(angle) + math.pi * (r + R) + 2 * (R - r) * angle, rel=1e-15)
    assert [arc.wrap for arc in path.arcs] == pytest.approx([math.pi - 2 * angle, math.pi + 2 * angle], rel=1e-15)
    assert [arc.radius for arc in path.arcs] == [r, R]


@pytest.mark.parametrize("offset", [0.0, 0.01])
@pytest.mark.parametrize("sides", [("right", "left"), ("left", "right")])
def test_crossed_belt(offset, sides):
    r, R, d = 0.06 + offset, 0.12 + offset, 0.35
    path = taut_path(loop((0.06, (0.0, 0.0), sides[0]), (0.12, (d, 0.0), sides[1]), offset=offset))
    angle = math.asin((r + R) / d)
    assert path.length == pytest.approx(2 * d * math.cos(angle) + (r + R) * (math.pi + 2 * angle), rel=1e-15)
    assert [arc.wrap for arc in path.arcs] == pytest.approx([math.pi + 2 * angle] * 2, rel=1e-15)


def test_serpentine():
    # Two idlers on the back of the belt, the second one wrapped by 10 degrees at rest.
    scene = loop(
        (0.09, (0.0, 0.0)),
        (0.04, (-0.215, 0.035), "left"),
        (0.03, (-0.39, 0.13)),
        (0.04, (-0.2, 0.15), "left"),
        elongation=0.012,
    )
    assert scene.belt.length == pytest.approx(1.2157057370362427, rel=1e-14)
    path = taut_path(scene)
    assert math.degrees(path.arcs[3].wrap) == pytest.approx(9.95, abs=0.01)
    assert path.arcs[3].end - path.arcs[0].start == pytest.approx(-FULL_TURN, rel=1e-15)


def test_published_scene():
    path = taut_path(Scene())
    # Symmetric: half a span, its tangent to the pulley, half of the arc.
    half, beta = math.hypot(0.5, 0.575), math.atan2(0.5, 0.575)
    wrap = 2 * (beta - math.acos(0.7 / half))
    assert path.length == pytest.approx(2 * math.sqrt(half**2 - 0.7**2) + 0.7 * wrap, rel=1e-15)
    assert [line.angle for line in path.lines] == pytest.approx([wrap / 2, -wrap / 2], rel=1e-14)
    assert (path.lines[0].start, path.lines[1].end) == ((-0.5, 0.0), (0.5, 0.0))
    assert not path.closed


def test_a_belt_clear_of_its_pulley_has_no_path():
    with pytest.raises(SceneError, match=r"`pulleys\.0\.side` must .* straight from the first clamp to the last clamp"):
        taut_path(Scene(pulleys=(Pulley(center=(0.0, -0.71)),)))


def random_loops(count):
    """Loops of two to five pulleys on either side of the belt that make sense."""
    rng, found = random.Random(12), []
    while len(found) < count:
        number = rng.randint(2, 5)
        pulleys = [
            (rng.uniform(0.03, 0.12), (rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)), rng.choice(["right", "left"]))
            for _ in range(number)
        ]
        try:
            found.append(loop(*pulleys, offset=rng.choice([0.0, 0.004])))
        except SceneError as error:
            assert error.field.startswith("pulleys.")
    return found


LOOPS = random_loops(40)


def numbers(scene):
    path = taut_path(scene)
    parts = [(arc.wrap, arc.length, line.length) for arc, line in zip(path.arcs, path.lines, strict=True)]
    return [[path.length, scene.belt.length], *parts]


def moved(scene, move, mirrored=False):
    """The scene with its pulleys at other places."""
    other = {"right": "left", "left": "right"}
    pulleys = (replace(p, center=move(*p.center), side=other[p.side] if mirrored else p.side) for p in scene.pulleys)
    return replace(scene, pulleys=tuple(pulleys))


@pytest.mark.parametrize("scene", LOOPS[:20], ids=lambda scene: str(len(scene.pulleys)))
def test_what_the_path_does_not_depend_on(scene):
    expected = [pytest.approx(row, rel=1e-11, abs=1e-12) for row in numbers(scene)]
    c, s = math.cos(1.1), math.sin(1.1)
    assert numbers(moved(scene, lambda x, y: (x * c - y * s, x * s + y * c))) == expected
    assert numbers(moved(scene, lambda x, y: (x - 3.0, y + 2.0))) == expected
    assert numbers(moved(scene, lambda x, y: (x, -y), mirrored=True)) == expected
    for shift in range(1, len(scene.pulleys)):
        turned = replace(scene, pulleys=scene.pulleys[shift:] + scene.pulleys[:shift])
        assert numbers(turned) == [expected[0], *expected[1 + shift :], *expected[1 : 1 + shift]]


@pytest.mark.parametrize("scene", LOOPS, ids=lambda scene: str(len(scene.pulleys)))
def test_parts_fit_together(scene):
    path = taut_path(scene)
    assert -math.pi < path.arcs[0].start <= math.pi + 1e-8
    for index, (arc, line) in enumerate(zip(path.arcs, path.lines, strict=True)):
        before = path.lines[index - 1]
        assert arc.pulley == index
        assert arc.at(arc.start) == pytest.approx(before.end, abs=1e-14)
        assert arc.at(arc.end) == pytest.approx(line.start, abs=1e-14)
        assert (arc.end, 0.0 < arc.wrap < FULL_TURN) == (line.angle, True)
        assert index == 0 or arc.start == path.arcs[index - 1].end
        x, y = line.start
        end = (x + line.length * math.cos(line.angle), y + line.length * math.sin(line.angle))
        assert line.end == pytest.approx(end, abs=1e-14)
    turns = (path.arcs[0].start - path.arcs[-1].end) / FULL_TURN
    assert turns == pytest.approx(round(turns), abs=1e-14)


@pytest.mark.parametrize("scene", LOOPS[:20], ids=lambda scene: str(len(scene.pulleys)))
def test_a_pulley_makes_the_path_longer_against_its_pull(scene):
    path, step = taut_path(scene), 1e-6
    for arc in path.arcs:
        for axis in (0, 1):
            lengths = []
            for sign in (1, -1):
                centers = [list(pulley.center) for pulley in scene.pulleys]
                centers[arc.pulley][axis] += sign * step
                lengths.append(taut_path(scene, [tuple(center) for center in centers]).length)
            assert (lengths[0] - lengths[1]) / (2 * step) == pytest.approx(-arc.pull[axis], abs=1e-7)


def test_angles_of_equal_pulleys_begin_at_half_a_turn():
    # Whatever rounding makes of the direction, it is pi, and not minus pi.
    for turn in range(16):
        c, s = 0.4 * math.cos(turn / 7e16), 0.4 * math.sin(turn / 7e16)
        path = taut_path(loop((0.1, (0.0, 0.0)), (0.1, (c, -s))))
        assert [path.arcs[0].start, path.arcs[1].end] == pytest.approx([math.pi, -math.pi], rel=1e-14)


OPEN = (
    Pulley(radius=0.25, center=(-0.22, -0.2), x_trans=-0.2),
    Pulley(radius=0.25, center=(0.22, 0.2), side="left", x_trans=0.2),
)


@pytest.mark.parametrize("turns", [(0, 0), (1, 0), (-1, 2)])
def test_angles_of_clamps_are_counted_on_along_the_belt(turns):
    first, last = ((x, 0.0, FULL_TURN * count) for x, count in zip((-0.5, 0.5), turns, strict=True))
    scene = Scene(belt=THIN, pulleys=OPEN, clamps=(first, last), elongation=0.03)
    assert scene.ends == ((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert scene.belt.length == pytest.approx(0.9920005151666081, rel=1e-14)


def test_a_belt_that_turns_round_ends_a_turn_later():
    pulleys = (
        Pulley(radius=0.02, center=(0.3, -0.02), torque=0.0),
        Pulley(radius=0.1, center=(-0.3, -0.4), torque=0.0),
    )
    scene = Scene(belt=THIN, pulleys=pulleys, elongation=0.01)
    assert [angle for _, _, angle in scene.ends] == pytest.approx([0.0, -FULL_TURN], abs=1e-14)
    assert taut_path(scene).lines[-1].angle == pytest.approx(-FULL_TURN, abs=math.pi / 2)


def test_elongation_and_tension_fit_the_belt():
    scene = loop((0.1, (0.0, 0.0)), (0.1, (0.4, 0.0)), elongation=0.03)
    path = 0.8 + 0.2 * math.pi
    assert scene.belt.length == pytest.approx(path / 1.03, rel=1e-15)
    assert replace(scene, elongation=None, tension=0.03 * 1.1e5).belt.length == pytest.approx(path / 1.03, rel=1e-15)
    # Fitted anew to other pulleys.
    moved_apart = replace(scene, pulleys=(scene.pulleys[0], replace(scene.pulleys[1], center=(0.5, 0.0))))
    assert moved_apart.belt.length == pytest.approx((path + 0.2) / 1.03, rel=1e-15)
    assert Scene(belt=Belt(), elongation=0.03).belt.length == pytest.approx(taut_path(Scene()).length / 1.03, rel=1e-15)


def test_a_slack_belt_can_be_taken_up():
    pulleys = (
        Pulley(radius=0.1, center=(0.0, 0.0), omega=10.0),
        Pulley(radius=0.1, center=(0.4, 0.0), torque=0.0, take_up=(2.0, 0.0), force=100.0),
    )
    scene = Scene(belt=replace(THIN, length=1.6), pulleys=pulleys, closed=True)
    way = (1.6 - taut_path(scene).length) / 2
    assert taut_path(scene, [(0.0, 0.0), (0.4 + way, 0.0)]).length == pytest.approx(1.6, rel=1e-15)
