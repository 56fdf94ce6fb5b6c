"""The UFL forms: derivatives against finite differences, rigid motion, clamps."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from belt_fenicsx import Scene
from belt_fenicsx.lagrangian.forms import Problem, Terms
from belt_fenicsx.lagrangian.taut import TautBelt
from belt_fenicsx.mechanics import rod

ELEMENTS = 8


GRADES = {"uniform": np.zeros(ELEMENTS), "graded": 0.1 * np.array([0, 1, 2, 3, 3, 2, 1, 0])}


@pytest.fixture(scope="module", params=GRADES)
def problem(request):
    problem = Problem(ELEMENTS, MPI.COMM_SELF, {}, Terms())
    scene = Scene().dimensionless()[0]
    sizes = np.exp(-GRADES[request.param])
    problem.load(scene, TautBelt.of(scene), np.append(0.0, np.cumsum(sizes)) / np.sum(sizes) - 0.5)
    nodes = problem.nodes
    # A bent, stretched and sheared belt, partly inside the pulley.
    values = np.column_stack([1.04 * nodes, 0.11 * np.cos(np.pi * nodes), -0.3 * np.sin(np.pi * nodes)])
    slopes = np.column_stack(
        [np.full_like(nodes, 1.04), -0.11 * np.pi * np.sin(np.pi * nodes), -0.3 * np.pi * np.cos(np.pi * nodes)]
    )
    problem.set_state(values, slopes)
    shape = problem.space.eta.shape
    problem.set_penalty(np.full(shape, 50.0))
    problem.set_multipliers(np.full(shape, 0.07), np.full(shape, -0.01))
    return problem


def vector(form):
    result = fem.assemble_vector(fem.form(form))
    return np.array(result.x.array if hasattr(result, "x") else result.array)


def matrix(form):
    result = fem.assemble_matrix(fem.form(form))
    return result.to_dense() if hasattr(result, "to_dense") else result[:, :]


def test_jacobian_is_the_derivative_of_the_residual(problem):
    deviation = problem.space.deviation.x.array
    J = matrix(problem.jacobian)
    direction = np.random.default_rng(1).standard_normal(deviation.size)

    def moved(step):
        deviation[:] = step * direction
        problem.space.move()
        return vector(problem.residual)

    step = 1e-6
    difference = (moved(step) - moved(-step)) / (2 * step)
    moved(0.0)
    assert J @ direction == pytest.approx(difference, abs=1e-7 * np.abs(difference).max())


def test_jacobian_has_friction_the_others_have_not(problem):
    """The friction traction is no potential force: without its tangent's motion the matrix would be symmetric."""
    J = matrix(problem.jacobian)
    assert np.abs(J - J.T).max() > 1e-4 * np.abs(J).max()
    problem.set_multipliers(np.full(problem.space.eta.shape, 0.07), np.zeros(problem.space.eta.shape))
    J = matrix(problem.jacobian)
    assert np.abs(J - J.T).max() < 1e-13 * np.abs(J).max()
    problem.set_multipliers(np.full(problem.space.eta.shape, 0.07), np.full(problem.space.eta.shape, -0.01))


@pytest.mark.parametrize("angle", [0.0, 0.4, -2.0])
def test_rigid_motion_costs_no_energy(problem, angle):
    space = problem.space
    nodes, size = problem.nodes, problem.slopes[:, np.newaxis]
    c, s = np.cos(angle), np.sin(angle)
    kept = space.w.x.array.copy()
    values = np.column_stack([0.3 + c * nodes, -0.2 + s * nodes, np.full_like(nodes, angle)])
    space.set_state(values, size * np.column_stack([np.full_like(nodes, c), np.full_like(nodes, s), 0.0 * nodes]))
    r, theta = ufl.split(space.w)
    strain = rod.strains(r, theta, rod.along(space.sigma))
    energy = rod.strain_energy(strain, **problem.stiffness) * space.sigma.dx(0) * space.dx(5)
    forces = vector(ufl.derivative(energy, space.w))
    value = fem.assemble_scalar(fem.form(energy))
    space.w.x.array[:] = kept
    assert value == pytest.approx(0.0, abs=1e-28)
    assert forces == pytest.approx(0.0, abs=1e-14)


def test_energy_of_a_stretched_and_of_a_bent_belt(problem):
    """U = b1 eps^2 Ls / 2 of pure stretch and a kappa^2 Ls / 2 of a circle (18.9)."""
    space, scene = problem.space, Scene().dimensionless()[0]
    nodes, size, kappa, eps = problem.nodes, problem.slopes[:, np.newaxis], 0.5, 0.03
    kept = space.w.x.array.copy()
    r, theta = ufl.split(space.w)
    strain = rod.strains(r, theta, rod.along(space.sigma))
    energy = fem.form(rod.strain_energy(strain, **problem.stiffness) * space.sigma.dx(0) * space.dx(13))
    zero, one = np.zeros_like(nodes), np.ones_like(nodes)
    values, slopes = np.column_stack([nodes, zero, zero]), np.column_stack([one, zero, zero])
    space.set_state((1 + eps) * values, (1 + eps) * size * slopes)
    stretched = fem.assemble_scalar(energy)
    c, s = np.cos(kappa * nodes), np.sin(kappa * nodes)
    values, slopes = np.column_stack([s / kappa, -c / kappa, kappa * nodes]), np.column_stack([c, s, kappa * one])
    space.set_state(values, size * slopes)
    bent = fem.assemble_scalar(energy)
    space.w.x.array[:] = kept
    assert stretched == pytest.approx(0.5 * eps**2, rel=1e-12)
    # Where the sizes of a few cells change by jumps, the map is less smooth than the circle.
    rel = 1e-5 if np.ptp(problem.slopes) < 1e-12 else 5e-4
    assert bent == pytest.approx(0.5 * scene.belt.bending_stiffness * kappa**2, rel=rel)
