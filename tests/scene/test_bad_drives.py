"""Drives that cannot be meant: each is refused before anything is solved, with a sentence that names what to mend."""

import copy

import pytest

from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import scene_from_dict, scene_to_dict

pytestmark = pytest.mark.serial

TWO = {
    "belt": {"thickness": 0.01},
    "closed": True,
    "elongation": 0.03,
    "pulleys": [
        {"radius": 0.1, "center": [0.0, 0.0], "friction": 0.5, "omega": 10.0},
        {"radius": 0.1, "center": [0.4, 0.0], "friction": 0.5, "torque": 20.0},
    ],
}
# The third one presses on the back of the lower span.
THREE = TWO | {
    "pulleys": [
        *TWO["pulleys"],
        {"radius": 0.04, "center": [0.2, -0.06], "friction": 0.5, "side": "left", "torque": 0.0},
    ]
}
# From clamp to clamp over one pulley and under the next.
OPEN = {
    "belt": {"thickness": 0.01},
    "elongation": 0.03,
    "pulleys": [
        {"radius": 0.25, "center": [-0.22, -0.2], "x_trans": -0.2},
        {"radius": 0.25, "center": [0.22, 0.2], "side": "left", "torque": 0.0},
    ],
}
LEFT_OUT = object()


def changed(drive, values):
    """The data of a drive with other values by their paths."""
    data = copy.deepcopy(drive)
    for path, value in values.items():
        *parts, name = path.split(".")
        here = data
        for part in parts:
            here = here[int(part)] if isinstance(here, list) else here.setdefault(part, {})
        if value is LEFT_OUT:
            here.pop(int(name) if isinstance(here, list) else name)
        elif isinstance(here, list) and int(name) == len(here):
            here.append(value)
        else:
            here[int(name) if isinstance(here, list) else name] = value
    return data


def test_the_good_ones():
    for drive in (TWO, THREE, OPEN):
        scene = scene_from_dict(drive)
        assert scene_from_dict(scene_to_dict(scene)) == scene


TAKEN_UP = {"elongation": LEFT_OUT, "belt.length": 1.6}
UP, DOWN = {"pulleys.2.take_up": [0.0, 1.0]}, {"pulleys.2.take_up": [0.0, -1.0]}
PUSH = {"pulleys.2.force": 100.0}
UNDRIVEN = {"pulleys.0.omega": LEFT_OUT, "pulleys.1.torque": LEFT_OUT}

BAD = {
    # Pulleys and their places
    "no pulleys": (TWO, {"pulleys": []}, "pulleys", "hold at least one pulley, got none"),
    "one pulley in a loop": (TWO, {"pulleys.1": LEFT_OUT}, "pulleys", "be at least two in a loop, got one"),
    "overlap": (TWO, {"pulleys.1.center": [0.15, 0.0]}, "pulleys.1.center", "more than 0.2 [m], both radii, away"),
    "the same place": (TWO, {"pulleys.1.center": [0.0, 0.0]}, "pulleys.1.center", "they overlap), got 0 [m]"),
    "contact": (TWO, {"pulleys.1.center": [0.2, 0.0]}, "pulleys.1.center", "they overlap"),
    "overlap of others": (THREE, {"pulleys.2.center": [0.1, -0.06]}, "pulleys.2.center", "away from that of pulleys.0"),
    "overlap between clamps": (OPEN, {"pulleys.1.center": [0.1, 0.0]}, "pulleys.1.center", "both radii"),
    "inside of another": (TWO, {"pulleys.0.radius": 1.0}, "pulleys.1.center", "they overlap"),
    "no room between": (
        TWO,
        {"pulleys.1.side": "left", "pulleys.1.center": [0.205, 0.0], "belt.contact_offset": 0.005},
        "pulleys.1.center",
        "be more than 0.21 [m] away from that of pulleys.0, for the belt to run between them, got 0.205 [m]",
    ),
    "no room behind": (
        THREE,
        {
            "belt.contact_offset": 0.005,
            "pulleys.2.center": [0.1025, -0.1025],
            "pulleys.3": {"radius": 0.1, "center": [0.0, -0.4], "torque": 0.0},
        },
        "pulleys.0.center",
        "be at least 0.15 [m] away from that of `pulleys.2`, for the belt on it, got 0.144957 [m]",
    ),
    "a span crosses a pulley": (
        TWO,
        {"pulleys.2": {"radius": 0.05, "center": [0.8, 0.0], "torque": 0.0}},
        "pulleys.1.center",
        "be at least 0.1 [m] away from span 2, which crosses the pulley, got 0.075 [m]",
    ),
    "a span crosses a pulley between clamps": (
        {},
        {"pulleys": [{"radius": 0.1, "center": place, "torque": 0.0} for place in ([0.3, -0.1], [-0.3, -0.4])]},
        "pulleys.0.center",
        "be at least 0.1 [m] away from span 2",
    ),
    "a wrap of zero outside": (
        THREE,
        {"pulleys.2.center": [0.2, -0.3]},
        "pulleys.2.side",
        "it passes at 0.16 [m], straight from pulleys.1 to pulleys.0: a wrap of zero), got 'left'",
    ),
    "a wrap of zero inside": (
        THREE,
        {"pulleys.2.center": [0.2, 0.0], "pulleys.2.side": "right"},
        "pulleys.2.side",
        "it passes at 0.06 [m]",
    ),
    "a wrap of zero, just": (THREE, {"pulleys.2.center": [0.2, -0.14]}, "pulleys.2.side", "it passes at 0 [m]"),
    "the wrong side": (THREE, {"pulleys.2.side": "right"}, "pulleys.2.side", "be where the taut belt touches"),
    "a wrap of zero between clamps": (
        OPEN,
        {"pulleys.1.center": [0.22, 0.28]},
        "pulleys.1.side",
        "straight from pulleys.0 to the last clamp",
    ),
    "not in the order of travel": (
        THREE,
        {"pulleys.3": {"radius": 0.04, "center": [0.2, 0.12], "torque": 0.0}},
        "pulleys.2.side",
        "a wrap of zero",
    ),
    # Clamps
    "clamps in a loop": (TWO, {"clamps": [[0, 0, 0], [1, 0, 0]]}, "clamps", "be left out in a loop"),
    "one clamp": (OPEN, {"clamps": [[-0.5, 0, 0]]}, "clamps", "be two triples (x, y, angle) [m, m, rad]"),
    "no angle": (OPEN, {"clamps": [[-0.5, 0], [0.5, 0, 0]]}, "clamps", "be two triples (x, y, angle)"),
    "no number": (OPEN, {"clamps": [[-0.5, 0, "up"], [0.5, 0, 0]]}, "clamps.0.2", "finite number [rad], got 'up'"),
    "a clamp inside": (OPEN, {"clamps": [[-0.3, -0.1, 0], [0.5, 0, 0]]}, "pulleys.0.radius", "from the first clamp"),
    "a clamp at the middle line": (
        OPEN,
        {"clamps": [[-0.5, 0, 0], [0.22, -0.06, 0]], "belt.contact_offset": 0.02},
        "pulleys.1.radius",
        "be below 0.24 [m], the distance of the centre from the last clamp",
    ),
    "span in a loop": (TWO, {"span": 0.9}, "span", "be left out in a loop"),
    "span beside clamps": (OPEN, {"span": 0.9, "clamps": [[-0.5, 0, 0], [0.5, 0, 0]]}, "span", "beside `clamps`"),
    # What drives them
    "closed is a word": (TWO, {"closed": "yes"}, "closed", "be true or false, got 'yes'"),
    "an unknown side": (TWO, {"pulleys.1.side": "outside"}, "pulleys.1.side", 'be "right" or "left", got \'outside\''),
    "two drives of a pulley": (TWO, {"pulleys.0.torque": 1.0}, "pulleys.0.torque", "be the only drive of"),
    "too few": (
        TWO,
        {"pulleys.1.torque": LEFT_OUT},
        "pulleys.1",
        "a loop of 2 needs 2 drives, or 1 beside `transport_rate`, got none at pulleys.1",
    ),
    "none": (TWO, UNDRIVEN, "pulleys.0", "`torque`, which is 0 for a free idler, `slip_angle` or `x_trans`)"),
    "too many": (TWO, {"transport_rate": 1.0}, "transport_rate", "be left out, or one of 2 drives"),
    "too few beside a rate": (
        TWO,
        {"transport_rate": 1.0, **UNDRIVEN},
        "pulleys.1",
        "beside `transport_rate`, one pulley of a loop stays without, got none at pulleys.0, pulleys.1",
    ),
    "too few between clamps": (
        OPEN,
        {"pulleys.1.torque": LEFT_OUT},
        "pulleys.1",
        "as each pulley between clamps, got none at pulleys.1",
    ),
    "torques alone": (
        TWO,
        {"pulleys.0.omega": LEFT_OUT, "pulleys.0.torque": -20.0},
        "pulleys.0.omega",
        "nothing else says how fast the loop runs (or give `transport_rate`",
    ),
    "slip angles alone": (
        TWO,
        {
            "pulleys.0.omega": LEFT_OUT,
            "pulleys.0.slip_angle": 1.0,
            "pulleys.1.torque": LEFT_OUT,
            "pulleys.1.slip_angle": 1.0,
        },
        "pulleys.0.omega",
        "got nothing but slip_angle, slip_angle",
    ),
    "standing": (TWO, {"pulleys.0.omega": 0.0}, "pulleys.0.omega", "be positive [rad/s]"),
    "backwards": (TWO, {"pulleys.0.omega": -10.0}, "pulleys.0.omega", "list them in order of travel), got -10.0"),
    "backwards at a rate": (
        TWO,
        {"transport_rate": 1.0, "pulleys.0.omega": -10.0, "pulleys.1.torque": LEFT_OUT},
        "pulleys.0.omega",
        "be positive [rad/s]",
    ),
    "a speed without friction": (TWO, {"pulleys.0.friction": 0.0}, "pulleys.0.friction", "be positive [-] on a pulley"),
    "no friction where the rest acts": (
        TWO,
        {"transport_rate": 1.0, "pulleys.1.torque": LEFT_OUT, "pulleys.1.friction": 0.0},
        "pulleys.1.friction",
        "be positive [-] where no drive is given",
    ),
    "a sense of no sliding": (
        TWO,
        {"transport_rate": 1.0, "pulleys.1.torque": LEFT_OUT, "pulleys.1.slip": "forward"},
        "pulleys.1.slip",
        "be left out without a drive",
    ),
    "no rate": (TWO, {"transport_rate": -1.0, "pulleys.1.torque": LEFT_OUT}, "transport_rate", "be positive [m/s]"),
    "drag without torque": (TWO, {"pulleys.0.drag": 2.0}, "pulleys.0.drag", "be left out without `torque`"),
    "slip_angle beyond the wrap": (
        TWO,
        {"pulleys.1.torque": LEFT_OUT, "pulleys.1.slip_angle": 3.2},
        "pulleys.1.slip_angle",
        "be at most 3.14159265 [rad], the wrap, got 3.2",
    ),
    "slip_angle below zero": (
        TWO,
        {"pulleys.1.torque": LEFT_OUT, "pulleys.1.slip_angle": -0.1},
        "pulleys.1.slip_angle",
        "be zero or positive [rad]",
    ),
    "x_trans on half a turn": (
        TWO,
        {"pulleys.1.torque": LEFT_OUT, "pulleys.1.x_trans": 0.45},
        "pulleys.1.x_trans",
        "a place is not unique; say `slip_angle` [rad]",
    ),
    "x_trans past the vertical": (
        TWO,
        {
            "pulleys.1.torque": LEFT_OUT,
            "pulleys.1.x_trans": 0.45,
            "pulleys.2": {"radius": 0.1, "center": [0.2, -0.3], "torque": 0.0},
        },
        "pulleys.1.x_trans",
        "turns by 2.15",
    ),
    # Take-ups
    "take_up without force": (
        THREE,
        {**TAKEN_UP, **UP},
        "pulleys.2.force",
        "be given beside `take_up` [N], got nothing",
    ),
    "force without take_up": (THREE, {**TAKEN_UP, **PUSH}, "pulleys.2.force", "be left out without `take_up`"),
    "a force that pulls": (
        THREE,
        {**TAKEN_UP, **UP, "pulleys.2.force": -1.0},
        "pulleys.2.force",
        "be positive [N], got -1.0",
    ),
    "take_up without a direction": (
        THREE,
        {**TAKEN_UP, **PUSH, "pulleys.2.take_up": [0.0, 0.0]},
        "pulleys.2.take_up",
        "be a direction other than (0, 0) [-]",
    ),
    "take_up of one number": (
        THREE,
        {**TAKEN_UP, **PUSH, "pulleys.2.take_up": 1.0},
        "pulleys.2.take_up",
        "be a pair of finite numbers (dx, dy) [-]",
    ),
    "take_up away from the belt": (
        THREE,
        {**TAKEN_UP, **PUSH, **DOWN},
        "pulleys.2.take_up",
        "push the pulley into the belt, which pulls it along (0, -0.85802) [-]",
    ),
    "take_up that comes to its end": (
        THREE,
        {**TAKEN_UP, **PUSH, **UP, "belt.length": 5.0},
        "pulleys.2.take_up",
        "lead to where the belt is no longer slack by 3.53769 [m]: after 1.82491 [m], `pulleys.0.side` would have to",
    ),
    "take_up that leads into a pulley": (
        THREE,
        {**TAKEN_UP, **PUSH, "belt.length": 2.0, "pulleys.2.take_up": [1.0, 0.1]},
        "pulleys.2.take_up",
        "`pulleys.2.center` would have to be more than 0.14 [m]",
    ),
    # The belt
    "slack": (
        TWO,
        {"elongation": LEFT_OUT, "belt.length": 1.5},
        "belt.length",
        "be below 1.42831853 [m], the path of the taut belt (it is slack by 0.0716815 [m]), got 1.5",
    ),
    "slack between clamps": (
        OPEN,
        {"elongation": LEFT_OUT, "belt.length": 1.1},
        "belt.length",
        "slack by 0.0782395 [m]",
    ),
    "elongation and length": (
        TWO,
        {"belt.length": 1.4},
        "belt.length",
        "be left out beside `elongation`, which fits it",
    ),
    "tension and length": (
        TWO,
        {"elongation": LEFT_OUT, "tension": 100.0, "belt.length": 1.4},
        "belt.length",
        "be left out beside `tension`",
    ),
    "elongation and tension": (TWO, {"tension": 100.0}, "tension", "be left out beside `elongation`"),
    "elongation of nothing": (TWO, {"elongation": 0.0}, "elongation", "be positive [-], got 0.0"),
    "elongation below zero": (OPEN, {"elongation": -0.1}, "elongation", "be positive [-]"),
    "tension below zero": (TWO, {"elongation": LEFT_OUT, "tension": -5.0}, "tension", "be positive [N], got -5.0"),
    "elongation beside a take_up": (
        THREE,
        {**PUSH, **UP},
        "elongation",
        "be left out beside `pulleys.2.take_up`, whose force makes the tension",
    ),
    "tension beside a take_up": (
        THREE,
        {**PUSH, **UP, "elongation": LEFT_OUT, "tension": 9.0},
        "tension",
        "whose force",
    ),
    "density beside stiffnesses": (
        TWO,
        {"belt": {"density": 1.0, "bending_stiffness": 1.0, "extensional_stiffness": 1e5, "shear_stiffness": 1e5}},
        "belt.density",
        "be left out beside `belt.bending_stiffness`",
    ),
    "line density of a cross-section": (
        TWO,
        {"belt": {"line_density": 1.0}},
        "belt.bending_stiffness",
        "be given beside `belt.line_density` [N m^2]",
    ),
    "an offset below zero": (TWO, {"belt.contact_offset": -0.01}, "belt.contact_offset", "be zero or positive [m]"),
    "no gravity": (TWO, {"gravity": -9.81}, "gravity", "be a pair of finite numbers (gx, gy) [m/s^2]"),
}


@pytest.mark.parametrize(("drive", "values", "field", "sentence"), BAD.values(), ids=BAD)
def test_refused(drive, values, field, sentence):
    with pytest.raises(SceneError) as caught:
        scene_from_dict(changed(drive, values))
    assert caught.value.field == field
    assert sentence in str(caught.value)
    assert str(caught.value).startswith(f"`{field}` must ")
    assert len(str(caught.value)) < 400
