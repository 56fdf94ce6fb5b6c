"""Solutions without their arrays, as plain data and as JSON for other programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from belt_fenicsx.scene.file import scene_to_dict

if TYPE_CHECKING:
    from belt_fenicsx.solution.solution import Solution

FOLLOWS = ("power", "hub_load", "hub_angle", "tight", "slack")  # what a contact tells beside what it holds


def summary(solution: Solution) -> dict[str, Any]:
    """Everything but the arrays, as plain data for JSON."""
    return _finite(
        {
            "method": solution.method,
            "status": solution.status.name,
            "message": solution.message or solution.status.value,
            "success": solution.success,
            "admissible": solution.admissible,
            "violations": solution.violations,
            "hints": solution.hints,
            "omega": solution.contacts[0].omega if len(solution.contacts) == 1 else None,
            "transport_rate": solution.transport_rate,
            "power": solution.power,
            "losses": solution.losses,
            "efficiency": solution.efficiency,
            "bending_stress": solution.bending_stress,
            "surface_strain": solution.surface_strain,
            "contacts": [
                {**asdict(contact), **{name: getattr(contact, name) for name in FOLLOWS}, "geometric_wrap": wrap}
                for contact, wrap in zip(solution.contacts, solution.geometric_wraps, strict=True)
            ],
            "spans": [asdict(span) for span in solution.spans],
            "zones": [asdict(zone) for zone in solution.zones],
            "iterations": solution.iterations,
            "error_estimate": solution.error_estimate,
            "field_errors": solution.field_errors,
            "measures": solution.measures,
            "stages": [asdict(stage) for stage in solution.stages],
            "timings": solution.timings,
        }
    )


def as_json(solution: Solution, left_out: Mapping[str, Any] | None = None) -> str:
    """The solution and its scene as one JSON object, without the arrays.

    Args:
        solution: The solution.
        left_out: Values that a scene file left out, if the scene is from one.
    """
    return _json({"scene": scene_to_dict(solution.scene), **_left_out(left_out), **summary(solution)}, indent=2)


def _left_out(values: Mapping[str, Any] | None) -> dict[str, Any]:
    return {} if values is None else {"left_out": dict(values)}


def _json(plain: Mapping[str, Any], indent: int | None = None) -> str:
    return json.dumps(_finite(plain), indent=indent, allow_nan=False)


def row_as_json(values: Mapping[str, Any], solution: Solution) -> str:
    """A row of a sweep as one line of JSON: the values of its scene that change, and the answer."""
    return _json({"values": dict(values), **summary(solution)})


def _finite(value: Any) -> Any:
    """Dictionaries and lists as JSON has them. It has no NaN and no infinity; null stands for them."""
    if isinstance(value, Mapping):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def certificates_as_json(solutions: Sequence[Solution], left_out: Mapping[str, Any] | None = None) -> str:
    """What `certificates` tells as one JSON object."""
    plain = [
        {**summary(solution), "checks": [{**asdict(check), "holds": check.holds} for check in solution.checks]}
        for solution in solutions
    ]
    scene = scene_to_dict(solutions[0].scene)
    difference = {"relative_difference_of_omega": difference_of_omega(solutions)}
    return _json({"scene": scene, **_left_out(left_out), "solutions": plain, **difference}, indent=2)


def difference_of_omega(solutions: Sequence[Solution]) -> float | None:
    """How far two solutions differ in omega, on the pulley where they do most; None where one has none."""
    first, second = ([contact.omega for contact in solution.contacts] for solution in solutions)
    if not first or len(first) != len(second):
        return None
    pairs = zip(first, second, strict=True)
    return max((0.0 if a == b else (a - b) / max(abs(a), abs(b)) for a, b in pairs), key=abs)
