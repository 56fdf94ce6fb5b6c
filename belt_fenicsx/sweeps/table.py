"""The table of a sweep: its columns and rows, as comma-separated values, in one line and as HTML for notebooks."""

from __future__ import annotations

import html
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from belt_fenicsx.scene.pulley import DRIVES
from belt_fenicsx.solution.contact import OF_CONTACT, OF_SPAN, QUANTITIES
from belt_fenicsx.solution.reading import goes_along_x

if TYPE_CHECKING:
    from belt_fenicsx.scene.scene import Scene
    from belt_fenicsx.solution.solution import Solution
    from belt_fenicsx.sweeps.sweep import Sweep

# What is one number of a whole solution, with its unit.
OF_ALL = {
    "transport_rate": "m/s",
    "power": "W",
    "losses": "W",
    "efficiency": "-",
    "bending_stress": "Pa",
    "surface_strain": "-",
    "error_estimate": "-",
    "iterations": "-",
}
SHOWN = 5  # rows that a notebook shows, from the table's head and from its tail


def quantities(scenes: Iterable[Scene]) -> dict[str, str]:
    """Names and units of what a table tells of its solutions: the contact, or transport rate and pulleys of drives."""
    most = max((len(scene.pulleys) for scene in scenes if not goes_along_x(scene)), default=0)
    if most == 0:
        return {name: quantity.unit for name, quantity in QUANTITIES.items()}
    told = {f"pulleys.{i}.{name}": DRIVES[name].unit for i in range(most) for name in ("omega", "torque")}
    return {"transport_rate": "m/s", **told}


def header(over: str | tuple[str, ...] | None, told: Mapping[str, str]) -> list[str]:
    """Names of a table's columns, with units."""
    changed = [over or "scene"] if not isinstance(over, tuple) else over
    columns = [f"{name} [{unit}]" for name, unit in told.items()]
    return [*changed, *columns, "error_estimate [-]", "iterations", "status"]


def row(value: Any, solution: Solution, told: Iterable[str]) -> list[Any]:
    """A row of a table, from the value, or the tuple of values, of its scene, and the names of what is told of it."""
    changed = value if isinstance(value, tuple) else (value,)
    numbers = [number(solution, name) for name in told]
    return [*changed, *numbers, solution.error_estimate, solution.iterations, solution.status.name]


def unit_of(name: str) -> str:
    """Unit of what `number` knows by this name: of all, as ``"efficiency"``, of a pulley or of a span.

    Raises:
        KeyError: There is no such quantity.
    """
    where, index, quantity = _parts_of(name)
    known = {"": OF_ALL, "pulleys": OF_CONTACT, "spans": OF_SPAN}.get(where, {})
    if quantity not in known or not (index.isdecimal() or where == ""):
        raise KeyError(name)
    return known[quantity]


def _parts_of(name: str) -> tuple[str, str, str]:
    """Where a quantity is, the index there, and its own name; that of a contact alone is one of the first pulley."""
    where, _, rest = name.rpartition(".")
    if where == "":
        return ("", "", name) if name in OF_ALL else ("pulleys", "0", name)
    return (*where.partition(".")[::2], rest)


def number(solution: Solution, name: str) -> float:
    """A quantity of a solution; NaN where the answer is not one to rely on, and of a pulley or span that there is not.

    The tension of a span is that in its middle.
    """
    where, index, quantity = _parts_of(name)
    if where == "" and quantity in ("error_estimate", "iterations"):
        return float(getattr(solution, quantity))
    if not solution.success:
        return math.nan
    if where == "":
        return float(getattr(solution, quantity))
    if where == "spans":
        told = [span.tension[1] if quantity == "tension" else getattr(span, quantity) for span in solution.spans]
        return float(told[int(index)]) if int(index) < len(told) else math.nan
    return next((float(getattr(c, quantity)) for c in solution.contacts if c.pulley == int(index)), math.nan)


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
