"""Chords and nodes in C: as exact as long doubles are, and nothing lost where nodes move."""

import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from drives import drive

from belt_fenicsx import Scene, solve
from belt_fenicsx.fitted import geometry
from belt_fenicsx.fitted.dofs import local
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.forms import CHORD
from belt_fenicsx.fitted.geometry import Geometry

DEGREE = 8


def test_data_have_the_same_places_as_in_the_forms():
    code = Path(geometry.__file__).with_suffix(".c").read_text()
    (names,) = re.findall(r"enum \{ (.*) \};", code)
    assert names.lower().split(", ") == list(CHORD)


@pytest.fixture(params=["chapter", "two-gravity"])
def loaded(request):
    """The nodes of a state in the data of the forms, and these."""
    scene = Scene() if request.param == "chapter" else drive(request.param)
    state = solve(scene, method="fitted").state.of_degree(DEGREE)
    data = np.zeros((len(state.cells), state.values.shape[1] + len(CHORD)))
    data[:, : state.values.shape[1]] = state.values
    nodes = Geometry(state.mesh, DEGREE, state.terms.loads, data, state.values.shape[1])
    nodes.load(state.scene, state)
    return nodes, data, state


def named(data):
    """Data of chords by name."""
    return dict(zip(CHORD, data[:, -len(CHORD) :].T, strict=True))


def test_differences_of_squares_are_exact(loaded):
    _, data, state = loaded
    chords = named(data)
    radius = state.pulleys[0] + state.scene.belt.contact_offset
    rows = zip(radius, *(chords[name] for name in ("x", "y", "excess_left")), strict=True)
    for R, x, y, excess in rows:
        exact = float(Fraction(R) ** 2 - Fraction(x) ** 2 - Fraction(y) ** 2)
        assert excess == pytest.approx(exact, rel=1e-15, abs=1e-18)


def test_strains_of_chords_are_those_in_the_frame(loaded):
    _, data, _ = loaded
    chords = named(data)
    turned = (chords["along_x"] + 1j * chords["along_y"]) * (chords["cos"] - 1j * chords["sin"]) / chords["length"]
    np.testing.assert_allclose(chords["q1"] + 1j * chords["q2"], turned - 1.0, atol=1e-15)
    np.testing.assert_allclose(np.hypot(chords["cos"], chords["sin"]), 1.0, rtol=1e-15)


def test_a_state_comes_back_as_it_was(loaded):
    nodes, data, state = loaded
    values = data[:, : state.values.shape[1]].copy()
    np.testing.assert_array_equal(nodes.put_together(values), state.chords)
    np.testing.assert_allclose(values, state.values, atol=1e-15)


def test_nodes_move_without_loss(loaded):
    """A node is at chord and deviation, which are exact together as far as a sum of both can be."""
    nodes, data, _ = loaded
    rng = np.random.default_rng(3)
    way = 1e-3 * (rng.standard_normal((len(data), DEGREE + 1, 2)) @ [1.0, 1j])
    ends, before = [0, 1], _places(nodes.chords, data)
    nodes.move(way, np.zeros((len(data), 1)), bent=False)
    after = _places(nodes.chords, data)
    lost = [
        abs(float(end - start - Fraction(step)))
        for cell, steps in enumerate(way)
        for node in ends
        for axis, step in enumerate((steps[node].real, steps[node].imag))
        for start, end in [(before[cell][node][axis], after[cell][node][axis])]
    ]
    assert max(lost) < 1e-19
    moved = [[[float(end - start) for start, end in zip(*pair, strict=True)] for pair in zip(*both, strict=True)]
             for both in zip(before, after, strict=True)]  # fmt: skip
    np.testing.assert_allclose(np.array(moved) @ [1.0, 1j], way, atol=1e-16)


def _places(chords, data):
    """Exact places of all nodes, by cell and axis."""
    xi = [Fraction(at) for at in points(DEGREE)[0]]
    deviations = data[:, local(DEGREE).r].reshape(len(data), -1, 2)
    return [
        [
            [Fraction(left) + at * Fraction(along) + Fraction(off) for left, along, off in zip(*row, node, strict=True)]
            for at, node in zip(xi, deviation, strict=True)
        ]
        for row, deviation in zip(chords.view(float).reshape(-1, 2, 2), deviations, strict=True)
    ]
