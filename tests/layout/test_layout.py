"""Zones as data, and the cells inside of them. No finite elements."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from belt_fenicsx.fitted.cells import divided
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.layers import bending_layer, graded, shear_layer
from belt_fenicsx.layout.layout import AFTER, BEFORE, Joint, Layout, Speed
from belt_fenicsx.layout.posed import ordered, posed
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene


def kinds(**pulley):
    return [part.kind for part in posed(Scene(pulleys=(Pulley(**pulley),))).parts]


def test_zones_of_each_drive():
    assert kinds(x_trans=0.0) == ["free", "stick", "slip", "free"]
    assert kinds(omega=1.48) == ["free", "stick", "slip", "free"]
    assert kinds(x_trans="run-off") == ["free", "stick", "free"]
    assert kinds(x_trans="run-up") == ["free", "slip", "free"]
    assert kinds(friction=0.0) == ["free", "slip", "free"]


def test_senses_of_sliding():
    backward = posed(Scene(pulleys=(Pulley(slip="backward"),)))
    assert [part.sense for part in backward.parts] == [0.0, 0.0, -1.0, 0.0]
    given = posed(Scene(pulleys=(Pulley(omega=1.48),)), "backward")
    assert given.parts[2].slip == "backward"


def test_conditions_at_the_borders():
    layout = posed(Scene())
    assert layout.joints == (Joint("tangent", BEFORE), Joint("x", AFTER), Joint("tangent", AFTER))
    assert layout.speeds == (Speed("stretch", 0),)
    entered = ordered(Scene(), [Part("slip", "backward"), *layout.contact])
    assert entered.parts[1] == Part("slip", "backward")
    assert entered.joints[1] == Joint("coulomb", AFTER)
    assert entered.speeds == (Speed("stretch", 1),)
    assert str(entered) == "backward slip | stick | forward slip"


def test_as_many_equations_as_unknowns():
    layout = posed(Scene())
    for missing in ({"joints": layout.joints[1:]}, {"speeds": ()}, {"parts": layout.parts[:-1]}):
        with pytest.raises(AssertionError, match="as many equations as unknowns"):
            replace(layout, **missing)
    assert ordered(Scene(), []) == Layout((Part("free"),), (), ())


def test_parts_of_several_pulleys_get_their_own_rows():
    scene = SimpleNamespace(pulleys=(Pulley(x_trans=0.0), Pulley(torque=1.0)), closed=False, transport_rate=1.0)
    contact = [Part("stick"), Part("slip", "forward"), Part("stick", pulley=1), Part("slip", "backward", 1)]
    layout = ordered(scene, contact)
    assert [part.kind for part in layout.parts] == ["free", "stick", "slip", "free", "stick", "slip", "free"]
    assert layout.speeds == (Speed("stretch", 0), Speed("torque", 3))
    assert (layout.on(1), layout.transition(1), layout.slides_behind(1)) == (range(4, 6), 4, True)


def test_a_loop_that_only_turns_is_closed_by_no_joint():
    def loop(contact, *drives, rate=None):
        pulleys = tuple(Pulley(**drive) for drive in drives)
        return ordered(SimpleNamespace(pulleys=pulleys, closed=True, transport_rate=rate), contact)

    stick, other, slip = Part("stick"), Part("stick", pulley=1), Part("slip", "forward")
    turns = loop([stick, other], {"torque": 0.0}, {"omega": 1.0})
    assert [joint.equation for joint in turns.joints] == ["tangent"] * 4
    assert turns.speeds == (Speed("stretch", -1), Speed("loop", 1))
    assert turns.closes == 1
    assert loop([stick, other], {"omega": 1.0}, {"omega": 2.0}).closes == 0
    assert loop([slip, other], {"omega": 1.0}, {"omega": 2.0}).closes == 1
    slides = loop([stick, slip, other], {"omega": 1.0}, {"torque": 0.0})
    assert slides.closes is None and slides.joints[0].equation == "speed"
    assert loop([stick, other], {"torque": 0.0}, {}, rate=1.0).closes == 1


def test_conditions_of_each_drive_and_order():
    stick, forward, backward = Part("stick"), Part("slip", "forward"), Part("slip", "backward")

    def conditions(contact, **pulley):
        layout = ordered(Scene(pulleys=(Pulley(**pulley),)), contact)
        by_torque = [speed.equation == "torque" for speed in layout.speeds]
        return [(joint.equation, joint.side) for joint in layout.joints[1:-1]], *by_torque

    assert conditions([stick, forward], omega=1.48) == ([("speed", AFTER)], False)
    assert conditions([stick, forward], torque=600.0) == ([("stretch", AFTER)], True)
    assert conditions([stick, forward], x_trans="run-off") == ([("coulomb", BEFORE)], False)
    assert conditions([forward, stick, backward, forward], x_trans=0.0) == (
        [("coulomb", AFTER), ("x", AFTER), ("stretch", BEFORE)],
        False,
    )


def test_layers_of_the_sources_scene():
    scene = Scene()
    assert shear_layer(scene, 0.0365) == pytest.approx(0.025, rel=0.02)
    assert bending_layer(scene, 0.0365) == pytest.approx(0.076, rel=0.02)


@pytest.mark.parametrize("first", [1e-4, 1e-2, 0.2, 5.0])
@pytest.mark.parametrize("count", [2, 3, 8, 15])
def test_cells_grow_from_both_ends(first, count):
    nodes = np.array(graded(first, 2.0, count))
    sizes = np.diff(nodes)
    assert nodes.shape == (count + 1,)
    assert (nodes[0], nodes[-1]) == (0.0, 1.0)
    assert np.all(sizes > 0.0)
    np.testing.assert_allclose(sizes, sizes[::-1], rtol=1e-9)
    half = sizes[: (count + 1) // 2]
    assert np.all(np.diff(half) > 0.0)


def test_first_cell_has_the_asked_length_where_the_count_follows_from_it():
    # Cells of lengths 1, 2, 4, 8 from each side.
    nodes = graded(1.0 / 30.0, 2.0, 8)
    np.testing.assert_allclose(np.diff(nodes)[:4] * 30.0, 2.0 ** np.arange(4), rtol=1e-12)


def test_thinner_layers_get_more_cells_and_elements_can_be_asked_for():
    zones, ends = posed(Scene()), np.array([-0.5, -0.2, 0.0, 0.2, 0.5])
    thick, _ = divided(zones, ends, bending=0.08, shear=0.025)
    thin, cells = divided(zones, ends, bending=0.008, shear=0.0025)
    assert all(a < b for a, b in zip(thick.counts, thin.counts, strict=True))
    assert cells.shape == (sum(thin.counts), 2)
    assert np.all(cells[:, 0] < cells[:, 1])
    asked, _ = divided(zones, ends, bending=0.08, shear=0.025, elements=40)
    assert sum(asked.counts) == pytest.approx(40, abs=2)


def test_mesh_knows_its_zones():
    mesh, _ = divided(posed(Scene()), [-0.5, -0.2, 0.0, 0.2, 0.5], bending=0.08, shear=0.025)
    assert mesh.zone.size == sum(mesh.counts)
    assert list(mesh.ends) == list(np.cumsum(mesh.counts)[:-1])
    assert list(mesh.touches) == [zone in (1, 2) for zone in mesh.zone]
