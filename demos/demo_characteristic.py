# %% [markdown]
# # The characteristic of a drive: moment against angular velocity
#
# A pulley that turns a little slower than the belt would carry it is driven along: the belt slides forward before it
# leaves the pulley, and transmits a moment. The slower, the longer the zone of sliding and the larger the moment, until
# the belt slides all along. That is the creep curve of a belt drive. On the other side of free rolling the
# pulley drives the belt, which slides backward.
#
# The curve is followed in one sweep, from sliding forward all along (the transition lies at the run-up) over sticking
# all along (at the run-off) to sliding backward all along. Each scene starts from the answer before it.

# %%
from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from belt_fenicsx import Belt, Pulley, Scene, solve, sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belt_fenicsx.solution.contact import Contact

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

OUTPUT = Path(__file__).parent / "output"
FORWARD_LIMIT, BACKWARD_LIMIT = (1.4779052879917, 1162.868190), (1.4874009496195, -1162.868190)
FREE_OMEGA = 1.4825151024971
STRING_OMEGA = 1.47806


# %%
def scene(*, thickness: float = 0.05, **pulley: float | str) -> Scene:
    """The source's scene with another belt or pulley."""
    return Scene(belt=Belt(thickness=thickness), pulleys=(Pulley(**pulley),))


def creep_curve(steps: int = 9, **changed: float) -> np.ndarray:
    """Angular velocity and moment from one limit to the other ``(2 * steps + 3, 2)``."""
    free = solve(scene(x_trans="run-off", **changed)).contacts[0]
    inner = np.linspace(0.02, 0.98, steps) * (free.x_off - free.x_up) + free.x_up
    forward = [scene(x_trans=place, slip="forward", **changed) for place in ("run-up", *inner.tolist())]
    backward = [scene(x_trans=place, slip="backward", **changed) for place in (*inner.tolist()[::-1], "run-up")]
    table = sweep([*forward, scene(x_trans="run-off", **changed), *backward])
    assert table.success, [solution.message for solution in table.solutions if not solution.success]
    return np.column_stack([table["omega"], table["torque"]])


# %% [markdown]
# ## The string beside it
#
# A belt without thickness neither bends nor shears. In its sliding zone the tension grows by exp(mu times angle), the
# law of Euler and Eytelwein, and its length decides how large the tension is. With R the radius and b1 the extensional
# stiffness, its moment is R b1 times the difference of the strains of the two spans.


# %%
def string(**changed: float | str) -> Contact:
    """Contact of the string."""
    return solve(scene(**changed), method="string").contacts[0]


def string_curve(steps: int = 41, **changed: float) -> np.ndarray:
    """The same curve of a string ``(2 * steps - 1, 2)``."""
    wrap = string(x_trans="run-off", **changed).wrap_angle
    slid = np.linspace(0.0, wrap, steps)[1:].tolist()
    forward = [string(slip_angle=angle, slip="forward", **changed) for angle in reversed(slid)]
    backward = [string(slip_angle=angle, slip="backward", **changed) for angle in slid]
    contacts = [*forward, string(x_trans="run-off", **changed), *backward]
    return np.array([(contact.omega, contact.torque) for contact in contacts])


# %%
published = creep_curve()
by_friction = {mu: creep_curve(friction=mu) for mu in (0.1, 0.4)}
by_thickness = {h: creep_curve(thickness=h) for h in (0.025, 0.075)}


def draw() -> None:
    """Writes the figure: other frictions on the left, other thicknesses on the right."""
    from matplotlib.figure import Figure

    def curve(ax: Axes, rows: np.ndarray, scale: float, style: str, label: str) -> None:
        ax.plot(rows[:, 0], rows[:, 1] / scale, style, markersize=3.5, linewidth=1.1, label=label)

    OUTPUT.mkdir(exist_ok=True)
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    styles = ("C0--s", "k-o", "C3-.^")
    for (mu, rows), style in zip(sorted({**by_friction, 0.2: published}.items()), styles, strict=True):
        curve(left, rows, 1.0, style, rf"$\mu$ = {mu}")
    curve(left, string_curve(), 1.0, "k:", r"string, $\mu$ = 0.2")
    for (h, rows), style in zip(sorted({**by_thickness, 0.05: published}.items()), styles, strict=True):
        belt = replace(Scene().belt, thickness=h)
        curve(right, rows, Scene().pulleys[0].radius * belt.extensional_stiffness, style, f"h = {h} m")
    scale = Scene().pulleys[0].radius * Scene().belt.extensional_stiffness
    curve(right, string_curve(), scale, "k:", "string, h = 0")
    for ax, label in ((left, "moment of the belt on the pulley [N m]"), (right, r"moment / ($R\, b_1$) [-]")):
        ax.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        ax.set_xlabel(r"$\omega$ [rad/s]")
        ax.set_ylabel(label)
        ax.ticklabel_format(useOffset=False)
        ax.legend(fontsize="small")
    figure.savefig(OUTPUT / "characteristic.png", dpi=120)


# %%
def headline() -> str:
    """What there is to remember."""
    return (
        f"A change of omega by {100.0 * (published[-1, 0] / published[0, 0] - 1.0):.2f} % takes the moment from "
        f"{published[0, 1]:.1f} to {published[-1, 1]:.1f} N m."
    )


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(f"{'omega [rad/s]':>16}{'moment [N m]':>16}")
        for omega, moment in published:
            print(f"{omega:>16.10f}{moment:>16.6f}")
        draw()
        print(f"\n{headline()} Figure: {OUTPUT / 'characteristic.png'}")

# %% [markdown]
# The moment falls all along the curve as omega rises, and vanishes where the belt sticks all along. The string is no
# stiffer to turn, but it is shorter: without bending it takes the straight way, is strained less, and so is slower.

# %%
for (omega, moment), (omega_limit, moment_limit) in (
    (published[0], FORWARD_LIMIT),
    (published[-1], BACKWARD_LIMIT),
    (published[len(published) // 2], (FREE_OMEGA, 0.0)),
):
    assert abs(omega / omega_limit - 1.0) < 1e-8
    assert abs(moment - moment_limit) < 1e-5 * FORWARD_LIMIT[1]
assert np.all(np.diff(published[:, 0]) > 0.0) and np.all(np.diff(published[:, 1]) < 0.0)
assert abs(string(x_trans=0.0).omega - STRING_OMEGA) < 1e-5
