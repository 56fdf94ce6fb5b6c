"""Newton's method for a UFL residual by PETSc SNES, set up once and used for many solves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from belt_fenicsx.backend import compat
from belt_fenicsx.backend.petsc_options import PREFIX, set_options
from belt_fenicsx.lagrangian.joined_lu import ORDERING, JoinedLU
from belt_fenicsx.layout.arrays import Array

# The line search accepts a square of the residual's norm that falls by this share of its slope; one below zero lets it
# grow. Where a Gauss point comes into contact or leaves it, the residual has a kink, and may have to grow on the way
# across. With growth by up to 8 times the step's length, all of 200 meshes of up to 1500 elements were solved; with a
# norm that must fall (PETSc's 1e-4), the search got stuck at such a kink on three of them.
LEAST_DECREASE = -4.0


class NewtonError(RuntimeError):
    """SNES stopped without convergence; the message says why and where.

    Attributes:
        iterations: Iterations that were done.
    """

    def __init__(self, message: str, iterations: int) -> None:
        super().__init__(message)
        self.iterations = iterations


class Newton:
    """SNES on F(w) = 0 with some dofs of w fixed at the values that w already has.

    Fixed dofs are never lifted: their residual is zero and their rows and columns are the identity's, so each
    iterate keeps the start's values.

    Args:
        residual: Linear UFL form F.
        jacobian: Bilinear UFL form J.
        unknown: The function w.
        moved: Called each time that w has other values.
        fixed: Local numbers of the dofs that stay as they are.
        options: The caller's PETSc options, without the prefix ``belt_``.
    """

    def __init__(
        self,
        residual: Any,
        jacobian: Any,
        unknown: fem.Function,
        moved: Callable[[], None],
        fixed: Array,
        options: Mapping[str, Any],
    ) -> None:
        self._F, self._J = fem.form(residual), fem.form(jacobian)
        index_map = unknown.function_space.dofmap.index_map
        self._unknown, self._moved, self._owned = unknown, moved, index_map.size_local
        self.fix(fixed)
        self._w = compat.petsc_vector(unknown)
        self._b = self._w.duplicate()
        self._matrix: PETSc.Mat | None = None
        self._x, self._start = self._w.duplicate(), self._w.duplicate()
        comm = unknown.function_space.mesh.comm
        self.snes = PETSc.SNES().create(comm)
        self.snes.setFunction(self._residual, self._b)
        if comm.size > 1:
            self.snes.ksp.pc.setType("python")
            self.snes.ksp.pc.setPythonContext(JoinedLU(index_map.ghosts, f"{PREFIX}sub_"))
        defaults = {
            "snes_type": "newtonls",
            "snes_linesearch_type": "bt",
            "snes_linesearch_alpha": LEAST_DECREASE,
            "snes_stol": 0.0,
            "snes_max_it": 50,
            "ksp_type": "preonly",
            **({"pc_type": "lu", "pc_factor_mat_ordering_type": ORDERING} if comm.size == 1 else {}),
        }
        set_options(self.snes, defaults, options)

    def fix(self, dofs: Array) -> None:
        """Fixes these dofs, by local numbers, and no others."""
        self._fixed = dofs[dofs < self._owned]
        self._bcs = [fem.dirichletbc(self._unknown, dofs.astype(np.int32))]
        self._reactions = np.zeros(self._fixed.size)

    @property
    def reaction(self) -> float:
        """Sum of the forces that hold this rank's fixed dofs, in the last residual."""
        return float(self._reactions.sum())

    def _load(self, x: PETSc.Vec) -> None:
        x.copy(self._w)
        self._w.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        self._moved()

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, b: PETSc.Vec) -> None:
        self._load(x)
        with b.localForm() as local:
            local.set(0.0)
        petsc.assemble_vector(b, self._F)
        b.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        self._reactions = b.array_r[self._fixed]
        b.array_w[self._fixed] = 0.0

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        P.zeroEntries()
        petsc.assemble_matrix(P, self._J, bcs=self._bcs)
        P.assemble()

    def solve(self, *, rtol: float = 0.0, atol: float = 0.0) -> int:
        """Solves from the unknown's present value.

        Args:
            rtol: Residual norm to reach, relative to the start's.
            atol: Residual norm to reach; the larger of the two counts.

        Returns:
            Number of iterations.

        Raises:
            NewtonError: No convergence; the unknown is left as it was.
        """
        self.snes.setTolerances(rtol=rtol, atol=atol)
        self._w.copy(self._x)
        self._w.copy(self._start)
        if self._matrix is None:
            # Where the start is as good as a fine mesh allows, no matrix is needed, which takes long to set up.
            self._residual(self.snes, self._x, self._b)
            if self._b.norm() <= atol:
                return 0
            self._matrix = petsc.create_matrix(self._J)
            self.snes.setJacobian(self._jacobian, self._matrix)
        try:
            self.snes.solve(None, self._x)
        except PETSc.Error as error:
            # Behind which newer releases of petsc4py put whatever a callback raises, also Ctrl-C.
            raise error.__cause__ or error from None
        reason, iterations = self.snes.getConvergedReason(), self.snes.getIterationNumber()
        self._load(self._x if reason > 0 else self._start)
        if reason <= 0:
            names = {value: name for name, value in vars(PETSc.SNES.ConvergedReason).items() if isinstance(value, int)}
            name, norm = names.get(reason, reason), self.snes.getFunctionNorm()
            text = f"SNES stopped with {name} after {iterations} iterations at residual norm {norm:.3g}"
            raise NewtonError(text, iterations)
        return iterations

    def norms(self) -> tuple[float, float]:
        """Norms of the last solve's residual, and of the step by which all its iterations moved the unknown."""
        self._start.aypx(-1.0, self._x)
        return self._b.norm(), self._start.norm()

    def destroy(self) -> None:
        """Frees PETSc's objects; collective. They refer to this object and it to them, which Python does not see."""
        for item in (self.snes, self._matrix, self._w, self._b, self._x, self._start):
            if item is not None:
                item.destroy()
