"""Arrays of numbers, and points of the plane as complex numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


def vectors(places: Array) -> Array:
    """Points of the complex plane ``(m,)`` as vectors ``(m, 2)``."""
    return places.view(float).reshape(-1, 2)


def places(vectors: Array) -> Array:
    """Vectors ``(m, 2)`` as points of the complex plane ``(m,)``."""
    return np.ascontiguousarray(vectors).view(complex)[:, 0]
