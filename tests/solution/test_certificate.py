"""The certificate: each check notices what it is there for."""

from dataclasses import replace

import numpy as np
import pytest

from belt_fenicsx import Scene, bvp
from belt_fenicsx.solution.certificate import certified, certify
from belt_fenicsx.solution.fields import simpson_weights
from belt_fenicsx.solution.status import Status

pytestmark = pytest.mark.serial
TOLERANCE = 1e-6


@pytest.fixture(scope="module")
def solution():
    return bvp.solve(Scene(), rtol=1e-8)


def violated(solution, **changed):
    fields = replace(solution.fields, **changed)
    checks = certify(replace(solution, fields=fields), tolerance=TOLERANCE)
    return {check.name for check in checks if not check.holds}


def test_the_published_case_is_admissible(solution):
    assert solution.admissible
    assert [check.name for check in solution.checks] == [
        "joints in order",
        "no penetration outside contact",
        "positive pressure in contact",
        "Coulomb's bound in stick",
        "sense of sliding in slip",
        "balance of forces",
        "balance of moments",
        "drive met",
    ]


def test_tension_at_the_pulley_is_noticed(solution):
    p = solution.fields.p.copy()
    p[np.flatnonzero(solution.fields.zone == 1)[30]] *= -1e-3
    assert "positive pressure in contact" in violated(solution, p=p)


def test_a_nan_is_noticed(solution):
    p = solution.fields.p.copy()
    p[np.flatnonzero(solution.fields.zone == 1)[30]] = np.nan
    assert "positive pressure in contact" in violated(solution, p=p)


def test_penetration_is_noticed(solution):
    r = solution.fields.r.copy()
    r[np.flatnonzero(solution.fields.zone == 0)[-3], 1] -= 1e-3
    assert violated(solution, r=r) == {"no penetration outside contact"}


def test_friction_beyond_its_bound_is_noticed(solution):
    f = solution.fields.f.copy()
    inside = np.flatnonzero(solution.fields.zone == 1)[50]
    f[inside] = 1.01 * 0.2 * solution.fields.p[inside]
    assert "Coulomb's bound in stick" in violated(solution, f=f)


def test_sliding_against_its_friction_is_noticed(solution):
    v_rel = np.where(solution.fields.zone == 2, -solution.fields.v_rel, solution.fields.v_rel)
    assert violated(solution, v_rel=v_rel) == {"sense of sliding in slip"}


def test_friction_of_the_wrong_sign_breaks_the_balances(solution):
    assert violated(solution, f=-solution.fields.f) == {"balance of forces", "balance of moments"}


@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_pressure_that_is_off_breaks_the_balance_of_forces(solution, factor):
    assert violated(solution, p=factor * solution.fields.p) >= {"balance of forces"}


def test_a_bending_moment_that_is_off_breaks_the_balance_of_moments(solution):
    M = solution.fields.M.copy()
    M[solution.fields.zone == 3] *= 1.2
    assert violated(solution, M=M) == {"balance of moments"}


def test_borders_out_of_order_are_noticed(solution):
    stick = solution.zones[1]
    zones = (solution.zones[0], replace(stick, sigma=stick.sigma[::-1]), *solution.zones[2:])
    checks = certify(replace(solution, zones=zones), tolerance=TOLERANCE)
    assert not checks[0].holds


def test_a_violation_takes_the_success_back(solution):
    fields = replace(solution.fields, p=solution.fields.p - 0.5 * solution.fields.p.max())
    failed = certified(replace(solution, fields=fields, status=Status.SOLVED), tolerance=TOLERANCE)
    assert failed.status is Status.NOT_ADMISSIBLE
    assert not failed.admissible
    assert any(text.startswith("positive pressure in contact: violated, margin -") for text in failed.violations)


@pytest.mark.parametrize("count", [3, 4, 9, 10])
def test_simpsons_rule_is_exact_for_parabolas_on_any_points(count):
    x = np.sort(np.random.default_rng(count).uniform(-1.0, 2.0, count))
    exact = (x[-1] ** 3 - x[0] ** 3) / 3 - (x[-1] ** 2 - x[0] ** 2) + 5 * (x[-1] - x[0])
    assert simpson_weights(x) @ (x**2 - 2 * x + 5) == pytest.approx(exact, rel=1e-12)
