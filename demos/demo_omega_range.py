# %% [markdown]
# # The range of omega: from pure stick to pure slip
#
# The angular velocity of the pulley hardly depends on where stick ends. Shifting the transition from the run-off
# point, where the belt sticks all along, to the run-up point, where it slides all along, omega runs through the
# whole interval in which the belt can be driven: [1.4779, 1.4825] in the source.
#
# That is why the scene prescribes x_trans: a speed with three right digits may already lie outside.

# %%
import logging
from pathlib import Path

import numpy as np

from belt_fenicsx import Pulley, Scene, bvp, solve

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

OUTPUT = Path(__file__).parent / "output"
PURE_STICK, PURE_SLIP = 1.4825151024971, 1.4779052879917

# %% [markdown]
# The two ends by the boundary-value problem, and the places of the transition between them by finite elements on a
# fixed mesh, each started from the solution before it.


# %%
def scene(x_trans: float | str) -> Scene:
    """The source's scene with another transition."""
    return Scene(pulleys=(Pulley(x_trans=x_trans),))


stick, slip = (bvp.solve(scene(end), rtol=1e-10) for end in ("run-off", "run-up"))
places = np.linspace(0.22, -0.22, 12)
solution, speeds, torques = None, [], []
for x_trans in places:
    solution = solve(scene(float(x_trans)), method="augmented-lagrangian", initial=solution)
    speeds.append(solution.omega)
    torques.append(solution.contacts[0].torque)


# %%
def draw() -> None:
    """Writes the figure of omega and torque against the place of the transition."""
    from matplotlib.figure import Figure

    OUTPUT.mkdir(exist_ok=True)
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    panels = ((speeds, "omega", r"$\omega$ [rad/s]"), (torques, "torque", "torque [N m]"))
    for ax, (values, name, label) in zip(figure.subplots(1, 2), panels, strict=True):
        ax.plot(places, values, "k--o", markersize=4, linewidth=1.0, label="FEM, fixed mesh")
        for end, marker, text in ((stick, "s", "pure stick (BVP)"), (slip, "^", "pure forward slip (BVP)")):
            contact = end.contacts[0]
            ax.plot(contact.x_trans, getattr(contact, name), marker, color="tab:red", label=text)
        ax.set_xlabel("transition $x_{trans}$ [m]")
        ax.set_ylabel(label)
        ax.ticklabel_format(useOffset=False)
        ax.grid(color="0.92")
    ax.legend(fontsize="small")
    figure.savefig(OUTPUT / "omega_range.png", dpi=120)


# %%
def headline() -> str:
    """What there is to remember."""
    return f"omega in [{slip.omega:.4f}, {stick.omega:.4f}] rad/s, from sliding all along to sticking all along."


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(f"{'x_trans [m]':>12}{'omega [rad/s]':>16}{'torque [N m]':>15}")
        for row in zip(places, speeds, torques, strict=True):
            print(f"{row[0]:>12.3f}{row[1]:>16.7f}{row[2]:>15.3f}")
        draw()
        print(f"\n{headline()} Figure: {OUTPUT / 'omega_range.png'}")

# %%
assert abs(stick.omega / PURE_STICK - 1.0) < 1e-9
assert abs(slip.omega / PURE_SLIP - 1.0) < 1e-9
assert (round(slip.omega, 4), round(stick.omega, 4)) == (1.4779, 1.4825)
assert np.all(np.diff(speeds) < 0.0) and PURE_SLIP < speeds[-1] < speeds[0] < PURE_STICK
