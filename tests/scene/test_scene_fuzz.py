"""Whatever plain data or text comes in: a scene, or a `SceneError` that can be shown."""

from dataclasses import fields

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import parse_assignment, scene_from_dict, scene_to_dict, with_values
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

pytestmark = pytest.mark.serial

# Derandomised, so that all runs see the same data.
fuzzed = settings(derandomize=True, max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))

numbers = st.floats() | st.integers() | st.sampled_from([0, 1, 0.05, 0.2, 0.7, -0.575, 1e-320, 1e308, 10**400])
words = st.text(max_size=6) | st.sampled_from(["run-up", "run-off", "forward", "backward"])
leaves = numbers | words | st.booleans() | st.dates() | st.none()
values = st.recursive(
    leaves, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3), max_leaves=6
)


def tables(*kinds):
    """Tables with the names of dataclasses, mostly with numbers that could be meant."""
    names = sorted({f.name for kind in kinds for f in fields(kind)})
    sensible = st.floats(1e-3, 1e3) | st.sampled_from([[0.0, -0.575], "run-off", 0.1])
    return st.dictionaries(st.sampled_from(names) | words, sensible | values, max_size=6)


scenes = st.fixed_dictionaries(
    {},
    optional={
        "belt": tables(Belt) | tables(StiffnessBelt) | values,
        "pulleys": st.lists(tables(Pulley) | values, max_size=2) | values,
        "span": numbers | values,
        "transport_rate": numbers | values,
        "clamps": values,
        "closed": st.booleans() | values,
        "gravity": values,
        "elongation": numbers | values,
        "tension": numbers | values,
    },
)


def scene_or_error(make):
    """The scene, or None after an error that can be shown in a few lines."""
    try:
        return make()
    except SceneError as error:
        assert isinstance(error.field, str)
        assert len(str(error)) < 1000
        return None


@fuzzed
@given(data=scenes | values)
def test_any_data(data):
    scene = scene_or_error(lambda: scene_from_dict(data))
    if scene is not None:
        assert scene_from_dict(scene_to_dict(scene)) == scene
        scene_or_error(scene.dimensionless)


# Mostly numbers with which pulleys and a belt can come together.
likely = st.floats(-1.0, 1.0) | st.floats(-1.0, 1.0) | st.floats(-1.0, 1.0) | numbers
places = st.lists(likely, min_size=2, max_size=2)
pulleys = st.builds(
    lambda place, name, value, more: place | {name: value} | more,
    st.fixed_dictionaries(
        {"radius": st.floats(0.02, 0.2), "center": places, "side": st.sampled_from(["right", "left"])}
    ),
    st.sampled_from(["omega", "torque", "slip_angle", "x_trans"]),
    st.sampled_from([1.0, 0.0]) | likely,
    st.just({}) | st.just({}) | st.fixed_dictionaries({"take_up": places, "force": likely}),
)
drives = st.fixed_dictionaries(
    {"pulleys": st.lists(pulleys, min_size=1, max_size=4), "closed": st.booleans()},
    optional={
        "belt": st.fixed_dictionaries({}, optional={"length": likely, "contact_offset": st.just(0.01) | likely}),
        "clamps": st.lists(st.lists(likely, min_size=3, max_size=3), min_size=2, max_size=2),
        "elongation": likely,
        "transport_rate": likely,
    },
)


@fuzzed
@given(data=drives)
def test_any_drive(data):
    scene = scene_or_error(lambda: scene_from_dict(data))
    if scene is not None:
        assert scene_from_dict(scene_to_dict(scene)) == scene
        scene_or_error(scene.dimensionless)


@fuzzed
@given(data=tables(Belt))
def test_any_belt(data):
    scene = scene_or_error(lambda: scene_from_dict({"belt": data}))
    if scene is not None:
        assert scene.belt.shear_stiffness > 0.0
        scene_or_error(scene.dimensionless)


@fuzzed
@given(
    path=st.lists(st.sampled_from(["belt", "pulleys", "0", "1", "center", "span", "omega", "slip", "width", "x"]))
    | st.lists(words),
    value=values,
)
def test_any_path(path, value):
    scene_or_error(lambda: with_values(Scene(), {".".join(path): value}))


@fuzzed
@given(text=st.text() | st.builds("{}={}".format, st.sampled_from(["span", "belt.width", "pulleys.0"]), st.text()))
def test_any_assignment(text):
    scene_or_error(lambda: with_values(Scene(), dict([parse_assignment(text)])))
