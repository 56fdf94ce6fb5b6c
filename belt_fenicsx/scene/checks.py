"""Values that cannot be meant: the error that says so, and the checks that raise it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

METHODS = ("fitted", "augmented-lagrangian", "bvp", "string")  # the default first
FEWEST_ELEMENTS = 2  # that any method may be asked for
RTOL_RANGE = (1e-13, 1e-1)  # of relative tolerances, within what double precision can give

# Products of powers of numbers of this size stay within the range of a float.
SMALLEST, LARGEST = 1e-100, 1e100


class SceneError(ValueError):
    """A scene that cannot be meant: names the field, what was expected, and what it got.

    Attributes:
        field: Name of the field, with its path where it comes from a file (``"pulleys.0.radius"``).
        expected: What the field must be, with its unit.
        got: The value that was given.
    """

    def __init__(self, field: str, expected: str, got: object) -> None:
        self.field, self.expected, self.got = field, expected, got
        super().__init__(field, expected, got)

    def __str__(self) -> str:
        return printable(f"`{self.field}` must {self.expected}, got {shown(self.got)}.")

    def __reduce__(self) -> tuple[type[SceneError], tuple[str, str, Verbatim]]:
        # What was given may be anything, and need not travel to another process: its text does.
        return SceneError, (self.field, self.expected, Verbatim(shown(self.got)))

    def within(self, path: str) -> SceneError:
        """The same error, with the field's path in front."""
        return SceneError(f"{path}.{self.field}", self.expected, self.got)


class Verbatim(str):
    """A value whose text goes into an error as it is, without quotes."""


def shown(value: object) -> str:
    """The value as an error shows it: short, whatever it is."""
    try:
        text = value if isinstance(value, Verbatim) else repr(value)
    except ValueError:  # Python refuses to write integers of thousands of digits.
        text = "an integer of too many digits"
    return text if len(text) <= 120 else f"{text[:117]}..."


def printable(text: str) -> str:
    """The text with escapes in place of what a terminal would obey: names in files may hold anything."""
    return "".join(char if char.isprintable() or char == "\n" else ascii(char)[1:-1] for char in text)


def number(name: str, value: object, unit: str) -> float:
    """Checks that ``value`` is a finite real number and returns it as a float."""
    try:
        # The first question is the quicker one, and mostly enough.
        if isinstance(value, float):
            result = float(value)
        else:
            result = math.nan if isinstance(value, bool) or not isinstance(value, Real) else float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise SceneError(name, f"be a finite number [{unit}]", value)
    if abs(result) > LARGEST:
        raise SceneError(name, f"be at most {LARGEST:g} in size [{unit}]", value)
    return result


def positive(name: str, value: object, unit: str) -> float:
    """Checks that ``value`` is a finite number above zero and returns it as a float."""
    result = number(name, value, unit)
    if result <= 0.0:
        raise SceneError(name, f"be positive [{unit}]", value)
    if result < SMALLEST:
        raise SceneError(name, f"be at least {SMALLEST:g} [{unit}]", value)
    return result


def not_negative(name: str, value: object, unit: str) -> float:
    """Checks that ``value`` is a finite number, not below zero, and returns it as a float."""
    result = number(name, value, unit)
    if result < 0.0:
        raise SceneError(name, f"be zero or positive [{unit}]", value)
    return result


def pair(name: str, value: object, expected: str, unit: str) -> tuple[float, float]:
    """Checks that ``value`` is a pair of finite numbers, as ``expected`` says, and returns it as floats."""
    values: Any = value  # Of whatever type it is, it is asked what a pair can do.
    if isinstance(values, str | Mapping) or not hasattr(values, "__getitem__") or len(values) != 2:
        raise SceneError(name, f"be a pair of finite numbers {expected} [{unit}]", value)
    return number(f"{name}.0", values[0], unit), number(f"{name}.1", values[1], unit)


def whole_number(name: str, value: object, least: int) -> int:
    """Checks that ``value`` is a whole number of at least ``least`` and returns it as an int."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise SceneError(name, f"be a whole number of at least {least}", value)
    return int(value)


def relative_tolerance(rtol: object) -> float:
    """Checks a relative tolerance and returns it as a float."""
    low, high = RTOL_RANGE
    result = number("rtol", rtol, "-")
    if not low <= result <= high:
        raise SceneError("rtol", f"lie in [{low:g}, {high:g}] [-]", rtol)
    return result


def named_options(options: object) -> dict[str, Any]:
    """Checks that ``options`` map names of PETSc options to values and returns them in alphabetical order."""
    if not isinstance(options, Mapping) or not all(isinstance(name, str) for name in options):
        raise SceneError("options", "be a mapping of the names of PETSc options to their values", options)
    return dict(sorted(options.items()))


def store(instance: object, **values: object) -> None:
    """Stores validated values in a frozen dataclass that is still being made."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)
