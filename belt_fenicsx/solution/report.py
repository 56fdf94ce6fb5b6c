"""A solution as text to read, in one line and in many, and as HTML for notebooks."""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

from belt_fenicsx.solution.contact import QUANTITIES
from belt_fenicsx.solution.reading import goes_along_x
from belt_fenicsx.solution.status import Status
from belt_fenicsx.solution.summary import difference_of_omega

if TYPE_CHECKING:
    from belt_fenicsx.solution.contact import Contact
    from belt_fenicsx.solution.solution import Solution

RESOLUTION = 80  # of a notebook's figure [dots per inch]


def as_text(solution: Solution) -> str:
    """The solution as a table to read; what is no answer is marked on its first line."""
    lines = [] if solution.success else [f"*** {_mark(solution.status)} ***", ""]
    lines += _one_pulley(solution) if solution.scene.is_published else _drive(solution)
    lines += [f"{solution.method}: {solution.status.value}", *([solution.message] if solution.message else [])]
    lines += [f"violated: {violation}" for violation in solution.violations]
    lines += [f"hint: {hint}" for hint in solution.hints]
    if not math.isnan(solution.error_estimate):
        lines.append(f"estimated relative error of omega: {solution.error_estimate:.1e}")
    if solution.stages:
        lines += ["", f"{'stage':<28}{'iterations':>10}{'time [ms]':>12}  why"]
    for stage in solution.stages:
        effort = ("skipped", "") if stage.iterations is None else (stage.iterations, f"{1e3 * stage.seconds:.1f}")
        lines.append(f"{stage.name:<28}{effort[0]:>10}{effort[1]:>12}  {stage.why}")
    return "\n".join(line.rstrip() for line in lines)


def _one_pulley(solution: Solution) -> Iterator[str]:
    """The contact with a pulley, and the zones."""
    length = solution.scene.belt.length
    for contact in solution.contacts:
        yield from (f"{name:<13}{value:>18} {unit}" for name, value, unit in _rows(contact, length))
        yield ""
    if solution.zones:
        yield f"{'zone':<14}{'sigma [m]':^33}{'x [m]':^33}"
        for zone in solution.zones:
            yield f"{zone.name:<14}{_interval(zone.sigma, length)}{_interval(zone.x, length)}"
        yield ""


def _drive(solution: Solution) -> Iterator[str]:
    """What moves the belt, and tables of pulleys and of spans."""
    if solution.contacts:
        yield from (f"{name:<14}{value:>18} {unit}".rstrip() for name, value, unit in _whole(solution))
        yield ""
    for rows in (_pulleys(solution), _spans(solution)):
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows if len(rows) > 1 else ():
            yield "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True))
        yield ""


def _whole(solution: Solution) -> Iterator[tuple[str, str, str]]:
    """Names, values and units of what the whole drive has."""
    yield "transport rate", f"{solution.transport_rate:.12g}", "m/s"
    units = {"power": "W", "losses": "W", "efficiency": "", "bending_stress": "Pa", "surface_strain": ""}
    for name, unit in units.items():
        if not math.isnan(value := getattr(solution, name)):
            yield name.replace("_", " "), f"{value:.8g}", unit
    if not math.isnan(value := solution.scene.static_tension):
        yield "tension at rest", f"{value:.8g}", "N"


def _pulleys(solution: Solution) -> list[list[str]]:
    """Titles, and a row for each pulley; its take-up is told where there is one."""
    tensioned = any(pulley.take_up for pulley in solution.scene.pulleys)
    titles = ["omega [rad/s]", "torque [N m]", "capacity [N m]", "power [W]", "loss [W]", "tight [N]", "slack [N]"]
    titles += ["hub load [N]", "creep", "wrap [rad]", "slip [rad]", *(["take-up [m]"] if tensioned else [])]
    rows = [["pulley", *titles, "zones"]]
    for contact in solution.contacts:
        numbers = (contact.capacity, contact.power, contact.sliding_loss, contact.tight, contact.slack)
        angles = (contact.wrap_angle, contact.slip_angle, *((contact.take_up,) if tensioned else ()))
        more = (contact.hub_load, contact.creep, *angles)
        cells = [f"{contact.omega:.12g}", f"{contact.torque:.9g}", *(f"{number:.6g}" for number in (*numbers, *more))]
        rows.append([str(contact.pulley), *cells, ", ".join(zone.name for zone in contact.zones)])
    return _known(rows)


def _known(rows: list[list[str]]) -> list[list[str]]:
    """The rows without columns in which nothing is known."""
    kept = [column for column in zip(*rows, strict=True) if {*column[1:]} != {"nan"}]
    return [list(row) for row in zip(*kept, strict=True)]


def _spans(solution: Solution) -> list[list[str]]:
    """Titles, and a row for each free span."""
    tension = [f"tension {where} [N]" for where in ("before", "in the middle", "behind")]
    rows = [["span", "length [m]", *tension, "speed [m/s]", "sag [m]", "frequency [Hz]", "angle [rad]"]]
    for index, span in enumerate(solution.spans):
        numbers = (*span.tension, span.speed, span.sag, span.frequency, span.angle)
        rows.append([str(index), f"{span.length:.9g}", *(f"{number:.6g}" for number in numbers)])
    return _known(rows)


def as_line(solution: Solution) -> str:
    """The solution in one line: method, status, and omega, torque and the ends of contact where there is one."""
    length = solution.scene.belt.length
    parts = [f"{solution.method}: {solution.status.name}"]
    for contact in solution.contacts:
        ends = f"{_place(contact.x_up, length)} ... {_place(contact.x_off, length)}"
        where = [f"contact {ends} m"] if goes_along_x(solution.scene) else []
        parts += [f"omega = {contact.omega:.12g} rad/s", *where, f"torque = {contact.torque:.6g} N m"]
    return f"<Solution {', '.join([*parts, f'{solution.iterations} iterations'])}>"


def as_html(solution: Solution) -> str:
    """The solution as a table and, where Matplotlib is there, a small figure of the deformed belt, in one piece."""
    mark = "" if solution.success else f"<strong>{_mark(solution.status)}</strong><br>"
    sentences = (solution.status.value, solution.message, *solution.violations, *solution.hints)
    text = "<br>".join(html.escape(sentence) for sentence in sentences if sentence)
    rows = []
    for contact in solution.contacts if solution.scene.is_published else ():
        rows += [(name, f"{value} {unit}") for name, value, unit in _rows(contact, solution.scene.belt.length)]
        rows.append(("zones", ", ".join(zone.name for zone in contact.zones)))
    more = ""
    if solution.contacts and not solution.scene.is_published:
        rows += [(name, f"{value} {unit}") for name, value, unit in _whole(solution)]
        more = "".join(map(_html_table, (_pulleys(solution), _spans(solution))))
    rows += [("method", solution.method), ("iterations", str(solution.iterations))]
    if not math.isnan(solution.error_estimate):
        rows.append(("estimated relative error of omega", f"{solution.error_estimate:.1e}"))
    table = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows)
    return f"<div><p>{mark}{text}</p><table>{table}</table>{more}{_html_figure(solution)}</div>"


def _html_table(rows: list[list[str]]) -> str:
    """A table whose first row has the titles."""
    tags = ["th", *["td"] * (len(rows) - 1)]
    cells = [[f"<{tag}>{html.escape(cell)}</{tag}>" for cell in row] for tag, row in zip(tags, rows, strict=True)]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in map(''.join, cells))}</table>"


def _rows(contact: Contact, length: float) -> Iterator[tuple[str, str, str]]:
    """Names, values and units of what a contact has."""
    for name, quantity in QUANTITIES.items():
        value = getattr(contact, name)
        digits = 12 if name == "omega" else 10
        yield quantity.text, _place(value, length) if quantity.unit == "m" else f"{value:.{digits}g}", quantity.unit


def _html_figure(solution: Solution) -> str:
    if solution.fields is None or find_spec("matplotlib") is None:
        return ""
    from matplotlib.figure import Figure

    from belt_fenicsx.solution.plot import deformed_belt

    figure = Figure(figsize=(6.0, 3.0), layout="constrained")
    deformed_belt(solution, figure.subplots())
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=RESOLUTION)
    data = base64.b64encode(image.getvalue()).decode("ascii")
    return f'<img alt="The deformed belt on its pulley" src="data:image/png;base64,{data}">'


def certificates(solutions: Sequence[Solution]) -> str:
    """The certificates of a scene's solutions, below each other, and how far the solutions agree."""
    lines = []
    for solution in solutions:
        lines += [f"{solution.method}: {solution.status.value}", *([solution.message] if solution.message else [])]
        for contact in solution.contacts:
            number = f"pulley {contact.pulley}: " if len(solution.contacts) > 1 else ""
            lines.append(f"{number}omega {contact.omega:.12g} rad/s, torque {contact.torque:.10g} N m")
        if solution.checks:
            lines.append(f"  {'check':<42}{'margin':>11}{'allowed':>11}{'at x [m]':>13}")
        for check in solution.checks:
            verdict = "" if check.holds else "  violated"
            lines.append(f"  {check.title:<42}{check.margin:>11.2e}{-check.tolerance:>11.0e}{check.x:>13.6g}{verdict}")
        lines.append("")
    if any(solution.method == "string" for solution in solutions):
        lines.append("The string is the limit without bending and shear.")
    if (difference := difference_of_omega(solutions)) is not None:
        lines.append(f"relative difference of omega {difference:.1e}")
    return "\n".join(lines)


def _mark(status: Status) -> str:
    return "NOT ADMISSIBLE" if status is Status.NOT_ADMISSIBLE else "NO SOLUTION"


def _interval(ends: tuple[float, float], length: float) -> str:
    return f"{_place(ends[0], length):>14} ...{_place(ends[1], length):>14} "


def _place(x: float, length: float) -> str:
    """A coordinate to ten digits of the belt's length, so that rounding errors at zero are shown as zero."""
    return f"{round(x / length, 10) * length + 0.0:.10g}"
