"""States on a layout from the fields of another solution, whose joints may lie elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from belt_fenicsx.fitted.cells import divided
from belt_fenicsx.fitted.dofs import local, terms_of, width
from belt_fenicsx.fitted.elements import points
from belt_fenicsx.fitted.nodes import on_chords, sum_error
from belt_fenicsx.fitted.state import State
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.hermite import interpolate
from belt_fenicsx.layout.layers import bending_layer, shear_layer
from belt_fenicsx.layout.layout import Layout
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.solution.fields import Fields
from belt_fenicsx.solution.stages import Stopped
from belt_fenicsx.solution.status import Status


class Driven(NamedTuple):
    """Elongation D - 1 in stick of each pulley ``(pulleys,)``, transport rate, displacement of each ``(pulleys,)``."""

    elongations: Array
    rate: float
    moves: Array


def blank(scene: Scene, layout: Layout, ends: Array, strain: float, degree: int, elements: int | None) -> State:
    """Layout divided into cells, without fields."""
    layers = {"bending": bending_layer(scene, strain), "shear": shear_layer(scene, strain)}
    mesh, cells = divided(layout, ends, **layers, elements=elements)
    values = np.zeros((len(cells), width(degree, terms_of(scene).loads)))
    values[:, local(degree).sigma.stop - 1] = (ends[1:] - ends[:-1])[mesh.zone] * (cells[:, 1] - cells[:, 0])
    return State(scene, mesh, cells, degree, ends, np.zeros((len(cells), 4)), values)


def drive(state: State, driven: Driven) -> None:
    """Sets the scalars that are no joints."""
    at, pulley, rate = local(state.degree), state.mesh.pulley, state.scene.transport_rate
    state.values[:, at.D] = driven.elongations[pulley, None]
    if state.terms.loads:
        state.values[:, at.rate] = driven.rate if rate is None else rate
        state.values[:, at.move] = driven.moves[pulley, None]


def placed(state: State, r: Array, theta: Array) -> State:
    """Puts the nodes to ``r``, in the complex plane, and ``theta`` ``(n, k + 1)``, and the ends where they belong."""
    theta[:-1, 1] = theta[1:, 0]
    if state.layout.closed:
        turn = 2.0 * math.pi * round((theta[-1, 1] - theta[0, 0]) / (2.0 * math.pi))
        r[-1, 1], theta[-1, 1] = r[0, 0], theta[0, 0] + turn
    else:
        for (x, y, angle), end in zip(state.scene.ends, ((0, 0), (-1, 1)), strict=True):
            r[end], theta[end] = complex(x, y), angle
    state.values[:, local(state.degree).theta] = theta
    arm, chords, deviation = r - state.center[:, None], state.complex_chords, state.deviation
    same = state.mesh.pulley[1:] == state.mesh.pulley[:-1]
    arm[1:, 0][same] = arm[:-1, 1][same]
    left, right = arm[:, 0], arm[:, 1]
    chords[:, 0], chords[:, 1] = left, right - left
    deviation[:] = arm - on_chords(chords, points(state.degree)[0])
    deviation[:, 0], deviation[:, 1] = 0.0, sum_error(right, -left, right - left)
    return state


def from_fields(
    scene: Scene,
    old: Fields | State,
    layout: Layout,
    ends: Array,
    degree: int,
    elements: int | None = None,
    driven: Driven | None = None,
) -> State:
    """The fields of another solution on other zones, for a scene that may be another one.

    Args:
        scene: The dimensionless scene.
        old: The dimensionless fields of the other solution; its state where it is one of this method, so that nothing
            is lost between points.
        layout: The zones.
        ends: Ends of the zones ``(z + 1,)``.
        degree: Degree k.
        elements: Number of cells; by default, as many as the layers call for.
        driven: What there is to know of the pulleys besides the fields; that of a state is known.

    Raises:
        Stopped: A zone has no length.
    """
    if np.any(np.diff(ends) <= 0.0):
        raise Stopped(Status.NEWTON_DIVERGED, f"In {layout}, there is a zone of no length.")
    if driven is None:
        assert isinstance(old, State), "fields alone do not tell how the pulleys turn"
        driven = Driven(old.stretches - 1.0, old.rate, old.moves)
    state = blank(scene, layout, ends, float(np.mean(driven.elongations)), degree, elements)
    if isinstance(old, State) and (old.mesh, old.terms) == (state.mesh, state.terms) and np.array_equal(old.ends, ends):
        kept = old.of_degree(degree)
        state = replace(kept, scene=scene, ends=ends, chords=kept.chords.copy(), values=kept.values.copy())
        r, theta, p, f = state.at_nodes
    else:
        nodes, gauss = (state.sigma[:, :1] + state.length[:, None] * inside for inside in points(degree))
        (r, theta), (p, f) = _read(old, nodes, gauss)
    at, mesh = local(degree), state.mesh
    state.values[:, at.p] = mesh.touches[:, None] * p
    slides = -(mesh.senses * state.pulleys[1])[:, None] * p
    state.values[:, at.f] = np.where(mesh.sticks[:, None], f, slides)
    drive(state, driven)
    return placed(state, r, theta)


def _read(old: Fields | State, nodes: Array, gauss: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """r in the complex plane and theta at the nodes ``(n, k + 1)``, p and f at the Gauss points ``(n, k)``."""
    if isinstance(old, State):
        r, theta = old.at(*old.located(nodes.ravel()))
        p, f = old.tractions_at(*old.located(gauss.ravel()))
        return (r.reshape(nodes.shape), theta.reshape(nodes.shape)), (
            p.reshape(gauss.shape),
            f.reshape(gauss.shape),
        )
    # By its slopes, too, the middle line is known as well between the points as the strains are at them.
    values = np.column_stack([old.r, old.theta])
    strained = (1.0 + old.eps + 1j * old.Gamma) * np.exp(1j * old.theta)
    slopes = np.column_stack([strained.real, strained.imag, old.kappa])
    x, y, theta = interpolate(nodes.ravel(), old.sigma, values, slopes)[0].T.reshape(3, *nodes.shape)
    p, f = (np.interp(gauss, old.sigma, field) for field in (old.p, old.f))
    return (x + 1j * y, theta), (p, f)
