# %% [markdown]
# # One pulley: the published case, by two methods
#
# A belt is clamped at both ends of a unit span and transported over a rigid pulley whose top stands 0.125 m above
# the clamps. Run-up comes first, then a zone of stick, then one of forward slip; both free spans bend, shear and
# stretch. The belt is a Cosserat rod: because it shears, no concentrated forces stand at the ends of contact.
#
# The scene prescribes where stick ends, x_trans = 0. There the sliding speed c D - R omega is zero, and so
# the stretch of the stick zone gives the angular velocity of the pulley, omega = c D / R.
#
# Two methods answer it:
#
# - finite elements on a fixed mesh of 100 elements, with multipliers for pressure and friction (section 18.2);
# - collocation of the boundary-value problem in each zone (section 18.3), which shares no code with the first.

# %%
import logging
from pathlib import Path

from belt_fenicsx import Scene, bvp, solve
from belt_fenicsx.solution.plot import contact_forces, deformed_belt, strains

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

OUTPUT = Path(__file__).parent / "output"
PUBLISHED_OMEGA = 1.4807
REFERENCE_OMEGA = 1.4807092526223

# %% [markdown]
# The source's scene is the default one; the same numbers stand in `demos/one_pulley.toml`.

# %%
scene = Scene()
fem = solve(scene, method="augmented-lagrangian", elements=100)
reference = bvp.solve(scene, rtol=1e-11)

# %% [markdown]
# ## The two methods side by side
#
# A fixed mesh knows the ends of contact only to a part of an element, 0.01 m long here. So omega, which depends on
# the resultants, agrees to six digits; the torque and the borders of contact to four.

# %%
ROWS = (
    ("omega [rad/s]", "omega"),
    ("run-up [m]", "x_up"),
    ("run-off [m]", "x_off"),
    ("torque [N m]", "torque"),
    ("wrap angle [rad]", "wrap_angle"),
)


def side_by_side() -> str:
    """A table of the quantities of contact."""
    lines = [f"{'':<18}{'FEM, 100 elements':>20}{'BVP':>20}{'difference':>12}"]
    for label, name in ROWS:
        ours, theirs = getattr(fem.contacts[0], name), getattr(reference.contacts[0], name)
        lines.append(f"{label:<18}{ours:>20.10f}{theirs:>20.10f}{ours - theirs:>12.1e}")
    return "\n".join(lines)


# %% [markdown]
# ## Pictures
#
# In the style of the source's Figs. 18.2 and 18.3: dotted for the boundary-value problem, dashed for the finite
# elements, vertical lines at the borders of the zones. The pressure peaks where the belt meets and leaves the pulley,
# as far as 100 elements resolve it.


# %%
def draw() -> None:
    """Writes the three figures."""
    from matplotlib.figure import Figure

    OUTPUT.mkdir(exist_ok=True)
    for stem, draw_one, names in (("contact_forces", contact_forces, "pf"), ("strains", strains, ("eps", "Gamma"))):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        for ax, name in zip(figure.subplots(1, 2), names, strict=True):
            draw_one(fem, ax, name)
            draw_one(reference, ax, name)
            ax.legend(fontsize="small")
        figure.savefig(OUTPUT / f"{stem}.png", dpi=120)
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    deformed_belt(fem, figure.subplots())
    figure.savefig(OUTPUT / "deformed_belt.png", dpi=120)


# %% [markdown]
# Under `mpirun` the mesh is distributed and all ranks hold the same answer; one of them reports.


# %%
def headline() -> str:
    """What there is to remember."""
    return f"omega = {fem.omega:.4f} rad/s, as published."


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(side_by_side())
        draw()
        print(f"\n{headline()} Figures: {OUTPUT}")

# %%
assert abs(fem.omega / REFERENCE_OMEGA - 1.0) < 1e-5
assert abs(reference.omega / REFERENCE_OMEGA - 1.0) < 1e-10
assert round(fem.omega, 4) == round(reference.omega, 4) == PUBLISHED_OMEGA
