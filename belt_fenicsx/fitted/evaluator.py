"""What a solution of the fitted method keeps to know its fields between points: arrays that a file can hold."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from belt_fenicsx.fitted.cells import meshed
from belt_fenicsx.fitted.dofs import terms_of, width
from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.layout.kind import Part
from belt_fenicsx.layout.posed import ordered
from belt_fenicsx.scene.checks import SceneError, Verbatim
from belt_fenicsx.scene.scene import Scene
from belt_fenicsx.scene.units import Units
from belt_fenicsx.solution.contact import Zone
from belt_fenicsx.solution.fields import Fields

if TYPE_CHECKING:
    from belt_fenicsx.fitted.state import State


# Names of the arrays, and the kinds of their numbers.
ARRAYS = {"degree": "i", "counts": "i", "cells": "f", "ends": "f", "chords": "f", "values": "f"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluator:
    """Fields of a fitted solution at any points.

    Attributes:
        scene: The scene, in its own units.
        zones: All zones of the belt.
        degree: Degree k ``()``.
        counts: Number of cells of each zone ``(z,)``.
        cells: As in a state ``(n, 2)``.
        ends: As in a state ``(z + 1,)``.
        chords: As in a state ``(n, 4)``.
        values: As in a state ``(n, dofs)``.
    """

    scene: Scene
    zones: tuple[Zone, ...]
    degree: Array
    counts: Array
    cells: Array
    ends: Array
    chords: Array
    values: Array

    @classmethod
    def of(cls, scene: Scene, zones: tuple[Zone, ...], state: State) -> Evaluator:
        """What is kept of a state."""
        return cls(
            scene=scene, zones=zones, degree=np.array(state.degree), counts=np.array(state.mesh.counts),
            cells=state.cells, ends=state.ends, chords=state.chords, values=state.values,
        )  # fmt: skip

    @classmethod
    def from_arrays(cls, scene: Scene, zones: tuple[Zone, ...], arrays: Mapping[str, Array]) -> Evaluator:
        """The evaluator whose `arrays` were kept in a file.

        Raises:
            SceneError: An array is missing, or has another shape or kind than it must have.
        """
        if set(arrays) != set(ARRAYS):
            raise SceneError("evaluator", f"have {', '.join(ARRAYS)}", Verbatim(", ".join(sorted(arrays))))
        cells, dofs = len(arrays["cells"]), width(int(arrays["degree"]), terms_of(scene).loads)
        shapes = (), (len(zones),), (cells, 2), (len(zones) + 1,), (cells, 4), (cells, dofs)
        for (name, kind), shape in zip(ARRAYS.items(), shapes, strict=True):
            if arrays[name].shape != shape or arrays[name].dtype.kind != kind:
                found = Verbatim(f"{arrays[name].dtype} of shape {arrays[name].shape}")
                raise SceneError(f"evaluator.{name}", f"hold numbers of shape {shape}", found)
        if arrays["counts"].min() < 1 or arrays["counts"].sum() != cells:
            raise SceneError("evaluator", f"have the cells of {len(zones)} zones", Verbatim("others"))
        return cls(scene=scene, zones=zones, **arrays)

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays, by name."""
        return {name: getattr(self, name) for name in ARRAYS}

    def __call__(self, sigma: Array, before: bool) -> Fields:
        """Fields at points ``(m,)`` [m].

        Args:
            sigma: Coordinates in the belt ``(m,)`` [m].
            before: Whether a joint between zones belongs to the zone before it instead of the zone after it.
        """
        # It loads UFL and Basix, which a file is read without.
        from belt_fenicsx.fitted.reading import fields_at

        state, units = self._dimensionless
        return fields_at(state.scene, state, sigma / units.length, before).in_units(units)

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @functools.cached_property
    def _dimensionless(self) -> tuple[State, Units]:
        """The state, and the units of its scene."""
        from belt_fenicsx.fitted.state import State

        plain, units = self.scene.dimensionless()
        touching = [Part(zone.kind, zone.slip, zone.pulley) for zone in self.zones if zone.pulley is not None]
        layout = ordered(plain, touching)
        mesh = meshed(layout, tuple(self.counts.tolist()))
        return State(plain, mesh, self.cells, int(self.degree), self.ends, self.chords, self.values), units
