"""The elimination in C: its steps solve the assembled equations, and none is given where there is none."""

import numpy as np
import pytest
from drives import drive

from belt_fenicsx import Scene, solve
from belt_fenicsx.fitted.newton import iteration_on


def assembled(condensed):
    """Matrix and right-hand side of all unknowns that are not fixed."""
    table, (jacobians, residuals) = condensed.table, condensed.cells
    A, b = np.zeros((table.count, table.count)), np.zeros(table.count)
    for numbers, jacobian, residual in zip(table.numbers, jacobians, residuals, strict=True):
        np.add.at(A, np.ix_(numbers, numbers), jacobian)
        np.add.at(b, numbers, residual)
    if table.loose is not None:
        A[table.loose], b[table.loose] = 0.0, 0.0
        A[table.loose, table.joints[-1]] = 1.0
    free = np.arange(table.count) != table.fixed
    return A[np.ix_(free, free)], b[free], free


@pytest.mark.parametrize("degree", [6, 8])
@pytest.mark.parametrize("name", ["chapter", "two-equal", "two-gravity", "three-idler", "open-S"])
def test_a_step_solves_the_assembled_equations(name, degree):
    state = solve(Scene() if name == "chapter" else drive(name), method="fitted").state.of_degree(degree)
    iteration = iteration_on(state.mesh, degree, state.terms)
    iteration.load(state.scene, state, 1e-3)
    iteration.residuals()
    iteration.jacobians()
    condensed = iteration.condensed
    # A residual of the size of the equations, of which that of a state is next to nothing.
    condensed.cells[1][:] = np.random.default_rng(7).standard_normal(condensed.cells[1].shape)
    A, b, free = assembled(condensed)
    step, scalars = condensed.step()
    x = np.zeros(condensed.table.count)
    x[condensed.table.numbers] = step
    np.testing.assert_array_equal(x[condensed.table.scalars], scalars)
    assert np.all(x[~free] == 0.0)
    x = x[free]
    assert np.all(np.abs(A @ x + b) <= 1e-11 * (np.abs(A).max(axis=1) * np.abs(x).max() + np.abs(b)))


def test_equations_that_tell_nothing_have_no_step():
    state = solve(Scene()).state
    condensed = iteration_on(state.mesh, state.degree, state.terms).condensed
    condensed.cells[0][:] = 0.0
    with pytest.raises(np.linalg.LinAlgError):
        condensed.step()
