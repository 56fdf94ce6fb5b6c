"""The table of a sweep: its columns and rows, as comma-separated values, in one line and as HTML for notebooks."""

from __future__ import annotations

import html
from collections import Counter
from typing import TYPE_CHECKING, Any

from belt_fenicsx.solution.contact import QUANTITIES

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution
    from belt_fenicsx.sweeps.sweep import Sweep

SHOWN = 5  # rows that a notebook shows, from the table's head and from its tail


def header(over: str | tuple[str, ...] | None) -> list[str]:
    """Names of a table's columns, with units."""
    changed = [over or "scene"] if not isinstance(over, tuple) else over
    columns = [f"{name} [{quantity.unit}]" for name, quantity in QUANTITIES.items()]
    return [*changed, *columns, "error_estimate [-]", "iterations", "status"]


def row(value: Any, solution: Solution) -> list[Any]:
    """A row of a table, from the value, or the tuple of values, of its scene."""
    changed = value if isinstance(value, tuple) else (value,)
    quantities = [of_contact(solution, name) for name in QUANTITIES]
    return [*changed, *quantities, solution.error_estimate, solution.iterations, solution.status.name]


def of_contact(solution: Solution, name: str) -> float:
    """A quantity of the only contact; NaN where the answer is not one to rely on."""
    return float(getattr(solution.contacts[0], name)) if solution.success else float("nan")


def as_line(sweep: Sweep) -> str:
    """A sweep in one line: how many scenes, over what, and how they ended."""
    over = ""
    if sweep.over is not None and sweep.values:
        paths = sweep.over if isinstance(sweep.over, str) else ", ".join(sweep.over)
        over = f" over {paths} = {sweep.values[0]} ... {sweep.values[-1]}"
    ends = Counter(solution.status.name for solution in sweep.solutions)
    return f"<Sweep of {len(sweep.solutions)} scenes{over}: {', '.join(f'{n} {name}' for name, n in ends.items())}>"


def as_html(sweep: Sweep) -> str:
    """The head and the tail of a sweep's table."""
    names, *rows = sweep.rows()
    if len(rows) > 2 * SHOWN:
        rows[SHOWN:-SHOWN] = [["..."] * len(names)]
    head = "".join(f"<th>{html.escape(name)}</th>" for name in names)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(_short(value))}</td>' for value in row)}</tr>" for row in rows)
    return f"<div><p>{html.escape(as_line(sweep))}</p><table><tr>{head}</tr>{body}</table></div>"


def _short(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
