"""Pictures of solutions: functions that draw one solution into one Matplotlib axes and give the axes back."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from belt_fenicsx.scene.file import unknown_name
from belt_fenicsx.solution.fields import DERIVED, QUANTITIES
from belt_fenicsx.solution.files import COMPONENTS, columns
from belt_fenicsx.solution.reading import goes_along_x

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belt_fenicsx.solution.solution import Solution

# Told apart in grey, too: by the kind of line for a method, by hatching and shade for a zone.
STYLES = {
    "bvp": {"linestyle": ":", "linewidth": 1.6, "color": "black", "zorder": 3.0},
    "augmented-lagrangian": {"linestyle": (0, (5, 2)), "linewidth": 3.0, "color": "tab:orange", "alpha": 0.75},
    "fitted": {"linestyle": "-", "linewidth": 1.2, "color": "tab:blue"},
}
NAMES = {"bvp": "BVP", "augmented-lagrangian": "FEM, fixed mesh", "fitted": "FEM, fitted zones"}
ZONE_STYLES = {
    "free": {"color": "0.55", "linestyle": "-", "linewidth": 1.5},
    "stick": {"color": "black", "linestyle": "-", "linewidth": 4.5},
    "forward slip": {"color": "tab:red", "linestyle": (0, (1.2, 0.6)), "linewidth": 4.5},
    "backward slip": {"color": "tab:blue", "linestyle": (0, (0.4, 0.4)), "linewidth": 4.5},
}


def field(
    solution: Solution, ax: Axes, name: str, *, along: str | None = None, contact_only: bool = False, **style: Any
) -> Axes:
    """Draws one field against x, or sigma in loops and with several pulleys, with the zones' joints as vertical lines.

    Args:
        solution: A solution with fields.
        ax: Axes to draw into.
        name: Name of a scalar field or of a component, such as ``"p"``, ``"eps"``, ``"Gamma"`` or ``"Q1"``.
        along: ``"x"`` or ``"sigma"``, if it is not to be chosen.
        contact_only: Whether to leave the free spans out.
        style: Keywords of Matplotlib's ``plot``; those of the method by default.

    Raises:
        SceneError: There is no such field, or the solution has none.
    """
    table = columns(solution)
    if name not in table:
        raise unknown_name("name", name, table)
    unit, values = table[name]
    free = np.array([zone.kind == "free" for zone in solution.zones])[table["zone"][1]]
    values = np.where(free, np.nan, values) if contact_only else values
    style = {**STYLES.get(solution.method, {}), "label": NAMES.get(solution.method, solution.method), **style}
    along = along or _along(solution)
    ax.plot(table[along][1], values, **style)
    mark_joints(solution, ax, along)
    ax.set_xlabel("x [m]" if along == "x" else r"$\sigma$ [m]")
    ax.set_ylabel(f"{_meaning(name)}{_symbol(name)} [{unit}]")
    return ax


def _along(solution: Solution) -> str:
    """The coordinate against which fields are drawn."""
    return "x" if goes_along_x(solution.scene) else "sigma"


def _meaning(name: str) -> str:
    texts = {part: QUANTITIES[whole].text for whole, parts in COMPONENTS.items() for part in parts}
    named = {**QUANTITIES, **DERIVED}
    return texts.get(name) or (named[name].text if name in named else name)


def _symbol(name: str) -> str:
    """The symbol of a quantity behind a blank; none where its name says it."""
    if name in ("tension", "speed"):
        return ""
    greek = {"eps": r"\varepsilon", "Gamma": r"\Gamma", "kappa": r"\kappa", "theta": r"\theta", "phi": r"\varphi"}
    return f" ${ {**greek, 'v_rel': 'v_{rel}'}.get(name, name) }$"


class NotebookFigure(Figure):
    """A figure that a notebook shows, also where nobody has loaded pyplot."""

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png")
        return image.getvalue()


def mark_joints(solution: Solution, ax: Axes, along: str | None = None) -> Axes:
    """Marks run-up, transition and run-off by thin vertical lines."""
    for zone in solution.zones[1:]:
        ax.axvline(getattr(zone, along or _along(solution))[0], color="0.8", linewidth=0.8, zorder=0)
    return ax


def contact_forces(solution: Solution, ax: Axes, which: str = "p", **style: Any) -> Axes:
    """Draws the contact pressure (``which="p"``) or the friction traction (``"f"``), as in Fig. 18.2.

    Args:
        solution: A solution with fields.
        ax: Axes to draw into.
        which: ``"p"`` or ``"f"``.
        style: Keywords of Matplotlib's ``plot``; those of the method by default.
    """
    return field(solution, ax, which, **style)


def strains(solution: Solution, ax: Axes, which: str = "eps", **style: Any) -> Axes:
    """Draws the axial strain (``which="eps"``) or the shear strain (``"Gamma"``), as in Fig. 18.3.

    Args:
        solution: A solution with fields.
        ax: Axes to draw into.
        which: ``"eps"`` or ``"Gamma"``.
        style: Keywords of Matplotlib's ``plot``; those of the method by default.
    """
    return field(solution, ax, which, **style)


def deformed_belt(solution: Solution, ax: Axes) -> Axes:
    """Draws the deformed belt on its pulleys to scale, each zone in its own line, and the direction of travel.

    Args:
        solution: A solution with fields.
        ax: Axes to draw into.
    """
    from matplotlib.patches import Circle

    scene, table = solution.scene, columns(solution)
    x, y = table["x"][1], table["y"][1]
    centers = {contact.pulley: contact.center for contact in solution.contacts}
    for index, pulley in enumerate(scene.pulleys):
        center = centers.get(index, pulley.center)
        ax.add_patch(Circle(center, pulley.radius, facecolor="0.93", edgecolor="0.6", linewidth=0.8))
        if len(scene.pulleys) > 1:
            ax.text(*center, str(index), ha="center", va="center", color="0.4")
    named = set()
    for index, zone in enumerate(solution.zones):
        inside = table["zone"][1] == index
        if not inside.any():
            continue
        last = np.flatnonzero(inside)[-1]
        inside[min(last + 1, len(inside) - 1)] = True
        label = None if zone.name in named else zone.name
        ax.plot(x[inside], y[inside], label=label, **ZONE_STYLES[zone.name])
        named.add(zone.name)
    if not scene.closed:
        ends = np.array([end[:2] for end in scene.ends])
        ax.plot(*ends.T, linestyle="none", marker="s", markersize=6, color="0.3", label="clamps")
    ax.set_aspect("equal")
    ax.set_xlabel("x [m]")
    ax.set_ylabel("y [m]")
    return (_frame_clamped if scene.is_published else _frame_drive)(solution, ax)


def _frame_clamped(solution: Solution, ax: Axes) -> Axes:
    """Adds travel, limits and legend round a belt between clamps."""
    half, height = solution.scene.span / 2, float(np.max(columns(solution)["y"][1]))
    ax.annotate("", xy=(-0.72 * half, 0.18 * half), xytext=(-0.98 * half, 0.18 * half), arrowprops={"arrowstyle": "->"})
    ax.text(-0.98 * half, 0.22 * half, "travel", fontsize="small")
    ax.set_xlim(-1.08 * half, 1.08 * half)
    ax.set_ylim(min(-0.25 * half, -0.5 * height), height + 0.22 * half)
    ax.legend(loc="lower center", ncols=4, fontsize="small", frameon=False)
    return ax


def _frame_drive(solution: Solution, ax: Axes) -> Axes:
    """Adds travel, as an arrowhead on each span, limits that show all pulleys, and a legend at the side."""
    table = columns(solution)
    for index, zone in enumerate(solution.zones):
        inside = np.flatnonzero(table["zone"][1] == index)
        if zone.kind == "free" and inside.size > 1:
            here, there = (tuple(table[name][1][i] for name in ("x", "y")) for i in inside[inside.size // 2 - 1 :][:2])
            head = {"arrowstyle": "-|>", "color": "0.3", "shrinkA": 0.0, "shrinkB": 0.0}
            ax.annotate("", xy=there, xytext=here, arrowprops=head)
    ax.autoscale_view()
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    return ax


def overview(*solutions: Solution) -> Figure:
    """One figure of all: the deformed belt, and contact forces and strains of one or more solutions of a scene.

    Args:
        solutions: Solutions with fields; the first one's belt is drawn.
    """
    figure = NotebookFigure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.subplot_mosaic([["belt", "belt"], ["p", "f"], ["eps", "Gamma"]])
    deformed_belt(solutions[0], axes["belt"])
    axes["belt"].set_title(title(solutions[0]))
    for solution in solutions:
        for name in ("p", "f"):
            contact_forces(solution, axes[name], name)
        for name in ("eps", "Gamma"):
            strains(solution, axes[name], name)
    axes["p"].legend(fontsize="small")
    return figure


def title(solution: Solution) -> str:
    """The speeds that were found, and the method."""
    speeds = ", ".join(f"{contact.omega:.6g}" for contact in solution.contacts)
    found = f"$\\omega$ = {speeds} rad/s" if speeds else "no contact"
    return f"{found} ({NAMES.get(solution.method, solution.method)})"
