"""The mixed (r, theta) space of cubic Hermite elements, its nodal values, and data at the Gauss points.

Hermite's slope dofs are reference derivatives and DOLFINx does not interpolate into them, so nodal values are
set here, by number, on a mesh of unit cells (see `belt_fenicsx.lagrangian.mesh`).
"""

from __future__ import annotations

from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

from belt_fenicsx.backend import compat
from belt_fenicsx.lagrangian.mesh import unit_cells
from belt_fenicsx.layout.arrays import Array

# A cell has these local dofs of x, y and theta: value and slope at its left node, then at its right one.
X_DOFS, Y_DOFS, THETA_DOFS = (0, 2, 4, 6), (1, 3, 5, 7), (8, 9, 10, 11)
VALUES, SLOPES = (0, 2), (1, 3)

# Contact is integrated with two Gauss points, which this degree takes: as many conditions in a cell as it has dofs of
# normal (and tangential) motion. The circle is then collocated to rounding; a third point leaves a penetration that no
# multiplier can close.
CONTACT_DEGREE = 3

# The mesh's unit cells have this tag.
BELT = 1


class HermiteSpace:
    """Cubic Hermite functions (r, theta) of eta on unit cells, and the C1 map sigma(eta).

    Attributes:
        comm: The communicator.
        mesh: Mesh of unit cells, and of some that lead past others.
        w: The function (r, theta).
        deviation: What w has moved by since its state was set; Newton's unknown, see `Problem`.
        sigma: The map to the material-length coordinate.
        clamped: Local dofs of x, y and theta at the two clamps.
        weights: Gauss weights of a unit cell ``(points,)``.
        first: Number of this rank's first node.
        points: Gauss points of a unit cell ``(points, 1)``.
        gauss: Space of coefficients with one value for each Gauss point.
        eta: Coordinates of the owned cells' Gauss points ``(cells, points)``, from left to right.
    """

    def __init__(self, elements: int, comm: MPI.Comm, *, closed: bool = False) -> None:
        self.comm = comm
        self.mesh, self._cells = unit_cells(elements, comm, closed=closed)
        scalar = compat.function_space(self.mesh, compat.hermite())
        mixed = compat.function_space(self.mesh, compat.mixed(compat.hermite(size=2), compat.hermite()))
        self.gauss = compat.function_space(self.mesh, compat.quadrature(CONTACT_DEGREE))
        self.w, self.deviation, self.sigma = fem.Function(mixed), fem.Function(mixed), fem.Function(scalar)
        self._values, self._deviations = self.w.x.array, self.deviation.x.array
        self._start = self._values.copy()
        self._dofs, self._sigma_dofs, self._gauss_dofs = (
            compat.table(space.dofmap.list)[self._cells] for space in (mixed, scalar, self.gauss)
        )
        dofs = self._dofs[:, np.array([X_DOFS, Y_DOFS, THETA_DOFS])]
        self._nodal_dofs = np.concatenate([dofs[:, :, :2], dofs[-1:, :, 2:]]).transpose(2, 0, 1).copy()
        nodes = compat.nodes(self.mesh)[self._cells]
        self.first = round(nodes[0, 0])
        # Those of the first node alone in a ring.
        ends = (nodes == 0.0) | (nodes == float(elements))
        self._ends = [self._dofs[:, np.take(dofs, VALUES)][ends] for dofs in (X_DOFS, Y_DOFS, THETA_DOFS)]
        self.clamped = np.unique(np.concatenate(self._ends)).astype(np.int32)
        self.points, self.weights = basix.make_quadrature(basix.CellType.interval, CONTACT_DEGREE)
        self.eta = nodes[:, :1] + self.points.ravel()
        numbers = np.sort(self._cells)
        tags = mesh.meshtags(self.mesh, 1, numbers, np.full(len(numbers), BELT, dtype=np.int32))
        self._dx = ufl.Measure("dx", domain=self.mesh, subdomain_data=tags)

    def dx(self, degree: int) -> ufl.Measure:
        """Integrals by eta along the belt, with as many Gauss points as ``degree`` takes."""
        return self._dx(BELT, metadata={"quadrature_degree": degree, "quadrature_scheme": "default"})

    def _set_nodal(self, function: fem.Function, dofs: Array, values: Array, slopes: Array) -> None:
        for value, slope, nodes in zip(VALUES, SLOPES, (slice(None, -1), slice(1, None)), strict=True):
            function.x.array[dofs[:, value]] = values[nodes]
            function.x.array[dofs[:, slope]] = slopes[nodes]

    def set_map(self, sigma: Array, slopes: Array) -> None:
        """Sets sigma and d sigma/d eta at this rank's nodes ``(cells + 1,)``."""
        self._set_nodal(self.sigma, self._sigma_dofs, sigma, slopes)

    def set_state(self, values: Array, slopes: Array) -> None:
        """Sets x, y, theta and their derivatives by eta at this rank's nodes ``(cells + 1, 3)``."""
        for component, dofs in enumerate((X_DOFS, Y_DOFS, THETA_DOFS)):
            self._set_nodal(self.w, self._dofs[:, dofs], values[:, component], slopes[:, component])
        self._start[:] = self._values
        self._deviations[:] = 0.0

    def move(self) -> None:
        """Moves w to where the deviation says."""
        np.add(self._start, self._deviations, out=self._values)

    def nodal(self) -> Array:
        """x, y, theta ``[0]`` and their derivatives by eta ``[1]`` at this rank's nodes ``(2, cells + 1, 3)``."""
        return self.w.x.array[self._nodal_dofs]

    def first_node(self, axis: int) -> Array:
        """Local dofs of x (0) or y (1) at the first node of a ring, on the ranks that know it."""
        return np.unique(self._ends[axis]).astype(np.int32)

    def cellwise(self, element: Any) -> tuple[fem.Function, Array]:
        """A function of an element that is broken between cells, and its dofs in the owned cells ``(cells, dofs)``."""
        function = fem.Function(compat.function_space(self.mesh, element))
        space = function.function_space
        dofs, size = compat.table(space.dofmap.list)[self._cells], space.dofmap.index_map_bs
        return function, (dofs[:, :, np.newaxis] * size + np.arange(size)).reshape(len(dofs), -1)

    def set_gauss(self, function: fem.Function, values: Array) -> None:
        """Sets a Gauss-point coefficient from values on the owned cells ``(cells, points)``."""
        function.x.array[self._gauss_dofs] = values

    def at_gauss(self, expression: fem.Expression) -> Array:
        """Values at the owned cells' Gauss points ``(cells, points, size)``."""
        return compat.evaluate(expression, self.mesh, self._cells).reshape(*self.eta.shape, -1)

    def of_all_ranks(self, *arrays: Array) -> list[Array]:
        """Values at the Gauss points of all cells ``(elements, points)``, from those of the owned ones."""
        if self.comm.size == 1:
            return list(arrays)
        table = self.gather(np.stack(arrays, axis=-1).reshape(-1, len(arrays)))
        return [column.reshape(-1, self.eta.shape[1]) for column in table.T]

    def gather(self, values: Array) -> Array:
        """Rows of all ranks ``(all, size)``, in the order of the ranks, from each rank's own ``(n, size)``."""
        size = values.shape[-1]
        counts = self.comm.allgather(values.size)
        everything = np.empty((sum(counts) // size, size))
        self.comm.Allgatherv(np.ascontiguousarray(values), (everything, counts))
        return everything
