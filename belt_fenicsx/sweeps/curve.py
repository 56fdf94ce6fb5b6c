"""Curves of a sweep: any of its columns against another one, or against what it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.checks import SceneError
from belt_fenicsx.solution.plot import NotebookFigure
from belt_fenicsx.sweeps.table import unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belt_fenicsx.sweeps.sweep import Sweep


def curve(sweep: Sweep, x: str, y: str) -> Figure:
    """Draws one column of a sweep against another one; scenes without an answer leave gaps.

    Raises:
        SceneError: There is no such column, or it holds no numbers.
    """
    columns = {}
    for axis, name in (("x", x), ("y", y)):
        try:
            columns[axis] = _column(sweep, name)
        except (KeyError, TypeError, ValueError):
            changed = "" if sweep.over is None else f" or what changes, {sweep.over}"
            expected = f"be a column of numbers, as `pulleys.0.torque`, `spans.0.tension` or `efficiency`,{changed}"
            raise SceneError(axis, expected, name) from None
    figure = NotebookFigure(figsize=(6.0, 4.0), layout="constrained")
    ax = figure.subplots()
    ax.plot(columns["x"], columns["y"], color="black", linewidth=1.2, marker="o", markersize=3.0)
    ax.set_xlabel(_label(x))
    ax.set_ylabel(_label(y))
    return figure


def _column(sweep: Sweep, name: str) -> Array:
    """Values of a column: of one that the sweep changes, those that were asked for."""
    over = (sweep.over,) if isinstance(sweep.over, str) else sweep.over or ()
    if name not in over:
        return sweep[name]
    rows = sweep.values if isinstance(sweep.over, tuple) else [(value,) for value in sweep.values]
    return np.array([row[over.index(name)] for row in rows], dtype=float)


def _label(name: str) -> str:
    """What an axis is of, with its unit where it is known."""
    try:
        return f"{name} [{unit_of(name)}]"
    except KeyError:
        return name
