"""Arrays of numbers, and points of the plane as complex numbers."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def vectors(places: Array) -> Array:
    """Points of the complex plane ``(m,)`` as vectors ``(m, 2)``."""
    return places.view(float).reshape(-1, 2)


def places(vectors: Array) -> Array:
    """Vectors ``(m, 2)`` as points of the complex plane ``(m,)``."""
    return np.ascontiguousarray(vectors).view(complex)[:, 0]
