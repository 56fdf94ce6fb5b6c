"""What is told of scenes for which an iteration failed."""

from dataclasses import replace

import pytest

from belt_fenicsx import Belt, Pulley, Scene, Solution, SolveError, Status, StiffnessBelt, solve
from belt_fenicsx.scene.path import tangent_path
from belt_fenicsx.solution.report import as_text
from belt_fenicsx.solver import explained
from belt_fenicsx.taut_string.hints import _bent_ends, hints

pytestmark = pytest.mark.serial

BELT = Belt(length=0.396, thickness=1.2e-3, width=0.03, youngs_modulus=5e8, poisson_ratio=0.4)
PULLEY = Pulley(radius=0.06, center=(0.0, -0.01), friction=0.3, x_trans=0.0)
GOOD = Scene(belt=BELT, pulleys=(PULLEY,), span=0.4, transport_rate=10.0)


def changed(belt=None, pulley=None, **scene):
    return replace(GOOD, belt=replace(BELT, **(belt or {})), pulleys=(replace(PULLEY, **(pulley or {})),), **scene)


@pytest.mark.parametrize(
    ("scene", "texts"),
    [
        (GOOD, ["from x = -0.0151 to 0.0151 m, a belt of this bending stiffness from about -0.01359 to 0.01359 m."]),
        (changed({"length": 0.45}), ["slack by 0.0374 m", "clamp over the pulley 0.41262 m", "A string would touch"]),
        (changed({"length": 0.2}), ["stretched by 106 %"]),
        (changed({"length": 0.4}, {"center": (0.0, -0.05)}), ["at hardly more than a point"]),
        (changed(pulley={"x_trans": 0.03}), ["`pulleys.0.x_trans` = 0.03, where stick is to end, lies outside"]),
        (changed(pulley={"x_trans": "run-up"}), ["from about -0.01359 to 0.01359 m."]),
        (changed({"thickness": 1.2}), ["`belt.thickness` = 1.2 may be meant in mm", "thick for its pulley"]),
        (
            changed({"length": 396.0, "thickness": 1.2}, {"radius": 60.0, "center": (0.0, -10.0)}, span=400.0),
            ["`belt.length` = 396, `span` = 400, `pulleys.0.radius` = 60, `belt.thickness` = 1.2 may be meant in mm"],
        ),
        (changed({"youngs_modulus": 500.0}), ["500 looks like MPa or GPa"]),
        (changed(pulley={"center": (0.01, 0.03)}), ["0.03 m above the clamps", "`center` = (0.01, -0.03)"]),
        (changed(pulley={"center": (0.0, -0.07)}), []),
        (changed(pulley={"friction": 1e9}), ["A string would touch the pulley from x = -0.0151 to 0.0151 m"]),
        (
            Scene(belt=StiffnessBelt(bending_stiffness=1e3, extensional_stiffness=1e5, shear_stiffness=1e5)),
            ["0.2133 m."],
        ),
    ],
)
def test_hints(scene, texts):
    said = " ".join(hints(scene))
    assert all(text in said for text in texts), said
    assert bool(said) == bool(texts)


@pytest.mark.parametrize("center", [(0.0, -0.01), (0.03, -0.02), (-0.05, 0.03)])
@pytest.mark.parametrize("thickness", [6e-4, 1.2e-3])
def test_the_expected_contact_is_that_of_a_thin_belt(center, thickness):
    scene = changed({"thickness": thickness}, {"x_trans": "run-off", "center": center})
    contact = solve(scene, rtol=1e-4).contacts[0]
    ends, width = _bent_ends(scene, tangent_path(scene)), contact.x_off - contact.x_up
    assert ends == pytest.approx((contact.x_up, contact.x_off), abs=0.03 * width)


def test_failures_that_say_nothing_of_their_reason_have_hints():
    slack = changed({"length": 0.45})
    for status in Status:
        failed = explained(Solution(scene=slack, method="made up", status=status))
        blind = status in (Status.NEWTON_DIVERGED, Status.MULTIPLIERS_DIVERGED, Status.CONTACT_LOST)
        assert ("is slack by" in str(SolveError(failed))) == blind
        assert ("hint: The belt is slack by" in as_text(failed)) == blind
        assert any("slack" in hint for hint in failed.summary()["hints"]) == blind


def test_a_first_scene_that_fails_says_why():
    with pytest.raises(SolveError, match="The belt is slack by 0.0374 m"):
        solve(changed({"length": 0.45}), options={"snes_max_it": 1})
