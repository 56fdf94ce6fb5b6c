"""Whole figures of a solution: the drive with its numbers, fields along the belt, pressure round each pulley."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.scene.file import unknown_name
from belt_fenicsx.solution.plot import NotebookFigure, deformed_belt, field, overview, title
from belt_fenicsx.solution.reading import fibre, parts_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from belt_fenicsx.solution.contact import Contact
    from belt_fenicsx.solution.solution import Solution

UNROLLED = ("p", "f", "tension", "v_rel")
DRAWN, LINE_HEIGHT = 4.6, 0.24  # heights of a drive and of each line of its tables [inches]
SHORT = 0.05  # A contact that is a smaller part of the belt is shown once more, widened.
ROUNDING = 1e-9  # A smaller part of the largest torque is shown as zero.
ROOM = 0.02  # Names of joints are at least so far apart, as a part of an axes' width.
WIDENED = 3  # of them, the shortest ones
MARGIN = 0.15  # what a widened contact shows of the spans beside it, as a part of its length
ABREAST = 4  # polar plots in a row
RINGS = 3  # of equal pressure, about, in each of them
LINE: Mapping[str, Any] = {"color": "black", "linestyle": "-", "linewidth": 1.2}
PAPER: Mapping[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0}
# Told apart in grey: stick is shaded, sliding is hatched, one way and the other.
GROUNDS: Mapping[str, Mapping[str, Any]] = {
    "stick": {"facecolor": "0.85", "edgecolor": "none"},
    "forward slip": {"facecolor": "none", "edgecolor": "0.75", "hatch": "////"},
    "backward slip": {"facecolor": "none", "edgecolor": "0.75", "hatch": "\\\\\\\\"},
}


def drive(solution: Solution) -> Figure:
    """The whole drive to scale, with the direction of travel and of rotation, and the numbers of pulleys and spans."""
    rows = [_pulley_rows(solution), _span_rows(solution)]
    heights = [DRAWN, *(LINE_HEIGHT * (1 + len(table)) for table in rows)]
    figure = NotebookFigure(figsize=(9.0, sum(heights)), layout="constrained")
    drawn, *below = figure.subplots(3, 1, height_ratios=heights)
    deformed_belt(solution, drawn)
    drawn.set_title(title(solution))
    for contact in solution.contacts:
        _turning(solution, contact, drawn)
    for number, span in enumerate(solution.spans):
        _number(solution, number, sum(span.sigma) / 2.0, drawn)
    for ax, table in zip(below, rows, strict=True):
        ax.axis("off")
        if len(table) > 1:
            shown = ax.table(table[1:], colLabels=table[0], loc="center", cellLoc="right")
            shown.auto_set_font_size(False)
            shown.set_fontsize(8)
            for cell in shown.get_celld().values():
                cell.set_linewidth(0.3)
    return figure


def _pulley_rows(solution: Solution) -> list[list[str]]:
    titles = ["pulley", "$\\omega$ [rad/s]", "torque [N m]", "power [W]", "tight [N]", "slack [N]", "hub load [N]"]
    rows = [[*titles, "wrap [deg]", "slip [deg]", "creep [-]"]]
    nothing = ROUNDING * max((abs(contact.torque) for contact in solution.contacts), default=0.0)
    for contact in solution.contacts:
        angles = [f"{round(math.degrees(angle), 1) + 0.0:.1f}" for angle in (contact.wrap_angle, contact.slip_angle)]
        given = (contact.torque, contact.power) if abs(contact.torque) > nothing else (0.0, 0.0)
        numbers = (contact.omega, *given, contact.tight, contact.slack, contact.hub_load)
        creep = "" if math.isnan(contact.creep) else f"{contact.creep:.3g}"
        rows.append([str(contact.pulley), *(f"{number:.5g}" for number in numbers), *angles, creep])
    return rows


def _span_rows(solution: Solution) -> list[list[str]]:
    rows = [["span", "tension [N]", "speed [m/s]", "length [m]", "sag [m]", "frequency [Hz]"]]
    for number, span in enumerate(solution.spans):
        numbers = [span.tension[1], span.speed, span.length, span.sag, span.frequency]
        rows.append([f"S{number}", *("" if math.isnan(value) else f"{value:.5g}" for value in numbers)])
    return rows


def _turning(solution: Solution, contact: Contact, ax: Axes) -> None:
    """The sense of rotation of a pulley, as an arrow round its centre."""
    pulley = solution.scene.pulleys[contact.pulley]
    # The surface moves with the belt, which passes a pulley on its right clockwise.
    sense = -pulley.turn * math.copysign(1.0, contact.omega)
    around = complex(*contact.center) + 0.7 * pulley.radius * np.exp(
        1j * (0.5 * math.pi + sense * np.array([-1.0, 1.0]))
    )
    start, end = ((float(place.real), float(place.imag)) for place in around)
    curved = {"arrowstyle": "-|>", "color": "0.4", "connectionstyle": f"arc3,rad={-0.45 * -sense:g}", "shrinkA": 0.0}
    ax.annotate("", xy=end, xytext=start, arrowprops={**curved, "shrinkB": 0.0})


def _number(solution: Solution, number: int, sigma: float, ax: Axes) -> None:
    """The number of a span at its middle."""
    fields = solution.fields
    assert fields is not None, "spans come from fields"
    x, y = (float(np.interp(sigma, fields.sigma, values)) for values in (fields.x, fields.y))
    paper = {"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": "0.4", "linewidth": 0.6}
    ax.text(x, y, f"S{number}", ha="center", va="center", fontsize="x-small", bbox=paper, zorder=5.0)


def unrolled(solution: Solution) -> Figure:
    """Pressure, friction, tension and sliding speed along the belt, and once more, widened, on very short contacts."""
    whole = sum(zone.sigma[1] - zone.sigma[0] for zone in solution.zones)
    ends = [(contact, contact.zones[0].sigma[0], contact.zones[-1].sigma[1]) for contact in solution.contacts]
    short = sorted((end - start, start, contact) for contact, start, end in ends if end - start < SHORT * whole)
    widened = sorted((start, length, contact) for length, start, contact in short[:WIDENED])
    figure = NotebookFigure(figsize=(9.0 + 2.5 * len(widened), 9.0), layout="constrained")
    axes = figure.subplots(len(UNROLLED), 1 + len(widened), squeeze=False, width_ratios=[3.0, *[1.0] * len(widened)])
    for row, name in zip(axes, UNROLLED, strict=True):
        for ax in row:
            field(solution, ax, name, along="sigma", contact_only=name == "v_rel", **LINE)
            _ground(solution, ax)
            ax.set_xlim(solution.zones[0].sigma[0], solution.zones[-1].sigma[1])
            ax.label_outer()
        for ax, (start, length, _) in zip(row[1:], widened, strict=True):
            ax.set_xlim(start - MARGIN * length, start + (1.0 + MARGIN) * length)
            ax.locator_params(axis="x", nbins=3)
    for contact, start, end in ends:
        axes[0, 0].annotate(
            f"pulley {contact.pulley}", xy=((start + end) / 2.0, 0.98), xycoords=("data", "axes fraction"),
            ha="center", va="top", fontsize="small", rotation=90.0, bbox=PAPER,
        )  # fmt: skip
    _name_joints(axes[0, 0], [contact for contact, start, end in ends if end - start >= SHORT * whole])
    for ax, (_, _, contact) in zip(axes[0, 1:], widened, strict=True):
        ax.set_title(f"pulley {contact.pulley}, widened", fontsize="small")
        _name_joints(ax, [contact])
    _legend(solution, axes[-1, 0])
    return figure


def _name_joints(ax: Axes, contacts: Sequence[Contact]) -> None:
    """Names the joints of contacts above an axes, their ends first; those that have no room have no name."""
    low, high = ax.get_xlim()
    ends = [(contact.zones[i].sigma[i], name) for contact in contacts for i, name in ((0, "run-up"), (-1, "run-off"))]
    inner = [
        (before.sigma[1], "slip begins" if before.kind == "stick" else "turn" if after.slip else "stick begins")
        for contact in contacts
        for before, after in itertools.pairwise(contact.zones)
    ]
    names: dict[float, str] = {}
    for place, name in ends + inner:
        if all(abs(place - other) > ROOM * (high - low) for other in names):
            names[place] = name
    above = ax.secondary_xaxis("top")
    above.set_xticks([*names], labels=[*names.values()], rotation=90.0, fontsize="x-small")
    above.tick_params(length=2.0)


def _ground(solution: Solution, ax: Axes) -> None:
    """Shades and hatches the zones in contact."""
    for zone in solution.zones:
        if zone.kind != "free":
            ax.axvspan(*zone.sigma, zorder=-1.0, linewidth=0.0, **GROUNDS[zone.name])


def _legend(solution: Solution, ax: Axes) -> None:
    """Names the grounds of the zones that there are, below an axes."""
    from matplotlib.patches import Patch

    names = [name for name in GROUNDS if any(zone.name == name for zone in solution.zones)]
    patches = [Patch(label=name, **GROUNDS[name]) for name in names]
    ax.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.5, -0.3), ncols=3, fontsize="small", frameon=False)


def polar(solution: Solution) -> Figure:
    """The pressure round each pulley: its angle is that of the place on the pulley, from the x axis."""
    from matplotlib.ticker import EngFormatter, MaxNLocator

    fields, contacts = solution.fields, solution.contacts
    assert fields is not None, "contacts come with fields"
    columns = min(ABREAST, len(contacts))
    rows = -(-len(contacts) // columns)
    figure = NotebookFigure(figsize=(3.4 * columns + 0.6, 3.6 * rows + 0.4), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.12)
    axes = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"}).ravel()
    for ax, contact in zip(axes, contacts, strict=False):
        turn = solution.scene.pulleys[contact.pulley].turn
        for zone, points in zip(solution.zones, parts_of(fields, solution.zones), strict=True):
            if zone.pulley == contact.pulley:
                place = fibre(solution.scene, fields, turn, points) - complex(*contact.center)
                _around(ax, np.unwrap(np.angle(place)), fields.p[points], zone.name)
        ax.set_title(f"pulley {contact.pulley}: p [N/m]", fontsize="small")
        ax.tick_params(labelsize="x-small")
        # What is inside of zero pressure is the pulley.
        ax.set_ylim(0.0, None)
        ax.set_rorigin(-ax.get_ylim()[1])
        ax.set_yticks(MaxNLocator(RINGS).tick_values(0.0, ax.get_ylim()[1])[1:-1])
        ax.yaxis.set_major_formatter(EngFormatter(sep=""))
        ax.set_rlabel_position(math.degrees(_free_angle(solution, contact)))
    for ax in axes[len(contacts) :]:
        ax.remove()
    _legend(solution, axes[columns * (rows - 1)])
    return figure


def _around(ax: Axes, angle: Array, p: Array, name: str) -> None:
    """The pressure of a zone, over the ground of its kind."""
    style = GROUNDS[name]
    ax.fill_between(angle, 0.0, p, linewidth=0.0, **style)
    ax.plot(angle, p, **LINE)


def _free_angle(solution: Solution, contact: Contact) -> float:
    """The middle of the angle at which a pulley is not touched, for what is written there."""
    middle = (contact.angle_up + contact.angle_off) / 2.0
    return middle - solution.scene.pulleys[contact.pulley].turn * math.pi / 2.0


PICTURES: Mapping[str, Callable[[Solution], Figure]] = {
    "drive": drive,
    "unrolled": unrolled,
    "polar": polar,
    "overview": overview,
}


def picture(solution: Solution, which: str) -> Figure:
    """One of the `PICTURES` of a solution.

    Raises:
        SceneError: There is no such picture, or the solution has no fields, or no contact, to be drawn.
    """
    if which not in PICTURES:
        raise unknown_name("which", which, PICTURES)
    if solution.fields is None or not (solution.contacts or which == "overview"):
        raise SceneError("solution", "have fields and a contact to be drawn", solution.status.name)
    return PICTURES[which](solution)
