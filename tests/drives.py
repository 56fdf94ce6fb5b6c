"""Reference drives as scenes: what is given and what is known of each."""

import json
import math
from pathlib import Path

from belt_fenicsx.scene.belt import StiffnessBelt
from belt_fenicsx.scene.pulley import Pulley
from belt_fenicsx.scene.scene import Scene

REFERENCE = json.loads((Path(__file__).parent / "drives.json").read_text())
NAMES = tuple(REFERENCE)


def drive(name: str, **changes) -> Scene:
    """The scene of a reference drive, with other values for some of the scene's."""
    known, pulleys = REFERENCE[name], []
    given = {row[1]: row for row in known["drives"] if row[0] != "c"}
    rates = [row[1] for row in known["drives"] if row[0] == "c"]
    for index, pulley in enumerate(known["pulleys"]):
        # A pulley that nothing drives is a free idler.
        kind, _, *values = given.get(index, ("torque", index, 0.0))
        driven = {
            "omega": {"omega": values[0]},
            "torque": {"torque": values[0]},
            "law": {"torque": values[0], "drag": values[-1]},
            "x": {"x_trans": values[0], "slip": senses(name, index)[-1]},
        }[kind]
        place = {**pulley, "center": tuple(pulley["center"])}
        pulleys.append(Pulley(**place, **driven))
    path = {"closed": True} if known["closed"] else {"span": known["span"]}
    return Scene(
        **{
            "belt": StiffnessBelt(**known["belt"], contact_offset=known.get("contact_offset", 0.0)),
            "pulleys": tuple(pulleys),
            "gravity": tuple(known["gravity"]),
            "transport_rate": rates[0] if rates else None,
            **path,
            **changes,
        }
    )


def senses(name: str, index: int) -> list[str | None]:
    """Senses of sliding of the zones on a pulley; None where it sticks."""
    kinds = [zone["kind"] for zone in REFERENCE[name]["answer"]["pulleys"][index]["zones"]]
    return [kind.removeprefix("slip ") if kind != "stick" else None for kind in kinds]


def apart(one, other) -> float:
    """By how much two solutions of a scene differ at most: speeds relative, torques over radius times tension."""
    tension = max(max(span.tension) for span in other.spans)
    found = [one.transport_rate / other.transport_rate - 1.0]
    for contact, known in zip(one.contacts, other.contacts, strict=True):
        radius = other.scene.pulleys[known.pulley].radius
        found += [contact.omega / known.omega - 1.0, (contact.torque - known.torque) / (radius * tension)]
    return max(abs(value) for value in found)


def differences(name: str, solution) -> dict[str, float]:
    """By how much a solution differs from what is known: relative, angles in radians, torques over the largest one."""
    known = REFERENCE[name]["answer"]
    largest, found = max(abs(pulley["torque"]) for pulley in known["pulleys"]), {}
    found["transport rate"] = solution.transport_rate / known["transport_rate"] - 1.0
    for index, (contact, pulley) in enumerate(zip(solution.contacts, known["pulleys"], strict=True)):
        found[f"omega {index}"] = contact.omega / pulley["omega"] - 1.0
        found[f"torque {index}"] = (contact.torque - pulley["torque"]) / largest
        for end in ("angle_up", "angle_off"):
            # The reference may count whole turns in another way.
            found[f"{end} {index}"] = math.remainder(getattr(contact, end) - pulley[end], 2.0 * math.pi)
        for i, (zone, other) in enumerate(zip(contact.zones, pulley["zones"], strict=True)):
            length = zone.sigma[1] - zone.sigma[0]
            found[f"length of zone {i} on {index}"] = (length - other["length"]) / solution.scene.belt.length
    for index, (span, other) in enumerate(zip(solution.spans, known["free_spans"], strict=True)):
        found[f"length of span {index}"] = span.length / other["length"] - 1.0
        for i, (tension, expected) in enumerate(zip(span.tension, other["tension"], strict=True)):
            found[f"tension {i} of span {index}"] = tension / expected - 1.0
    return found
