"""Fields along the belt: their meaning, units and dimensions, and the arrays that hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from belt_fenicsx.layout.arrays import Array
from belt_fenicsx.scene.belt import Belt, StiffnessBelt
from belt_fenicsx.scene.units import Quantity, Units

QUANTITIES: Mapping[str, Quantity] = {
    "sigma": Quantity(unit="m", text="material-length coordinate", length=1),
    "r": Quantity(unit="m", text="position", length=1),
    "theta": Quantity(unit="rad", text="angle of the cross-section"),
    "phi": Quantity(unit="rad", text="angle of the tangent"),
    "D": Quantity(unit="-", text="stretch"),
    "eps": Quantity(unit="-", text="axial strain"),
    "Gamma": Quantity(unit="-", text="shear strain"),
    "kappa": Quantity(unit="1/m", text="bending strain", length=-1),
    "Q": Quantity(unit="N", text="force in the axes e1, e2", force=1),
    "M": Quantity(unit="N m", text="bending moment", length=1, force=1),
    "p": Quantity(unit="N/m", text="contact pressure", length=-1, force=1),
    "f": Quantity(unit="N/m", text="friction traction", length=-1, force=1),
    "v_rel": Quantity(unit="m/s", text="sliding speed", rate=1),
    "speed": Quantity(unit="m/s", text="speed", rate=1),
}
# What follows from the others.
DERIVED: Mapping[str, Quantity] = {"tension": Quantity(unit="N", text="tension", force=1)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Fields:
    """Fields along the belt, sorted by ``sigma``; a joint of zones appears once for each side.

    They are those of the middle line, with one exception: where a belt with a ``contact_offset`` lies on a pulley, its
    stretch D and the angle phi are those of the fibre that touches, with which it slides and along which friction acts.
    Fields are equal that have equal values at equal points.

    Attributes:
        zone: Index into the solution's zones ``(n,)``.
        weight: Weights of a quadrature along the belt ``(n,)`` [m]: ``weight @ p`` is the whole pressure.
        sigma: Coordinate in [-Ls/2, Ls/2] ``(n,)`` [m].
        r: Position ``(n, 2)`` [m].
        theta: Angle of the cross-section ``(n,)`` [rad].
        phi: Angle of the tangent ``(n,)``, counted on along the belt; of the touching fibre on a pulley [rad].
        D: Stretch ``(n,)``, of the touching fibre on a pulley [-].
        eps: Axial strain ``(n,)`` [-].
        Gamma: Shear strain ``(n,)`` [-].
        kappa: Bending strain ``(n,)`` [1/m].
        Q: Forces Q1, Q2 in the axes of the cross-section ``(n, 2)`` [N].
        M: Bending moment ``(n,)`` [N m].
        p: Contact pressure per material length ``(n,)``, zero outside contact [N/m].
        f: Friction traction on the belt along its tangent ``(n,)``, zero outside contact [N/m].
        v_rel: Sliding speed c D - R omega of the belt against the pulley ``(n,)`` [m/s].
        speed: Speed c D of the belt ``(n,)``, of the touching fibre on a pulley [m/s].
    """

    zone: Array
    weight: Array
    sigma: Array
    r: Array
    theta: Array
    phi: Array
    D: Array
    eps: Array
    Gamma: Array
    kappa: Array
    Q: Array
    M: Array
    p: Array
    f: Array
    v_rel: Array
    speed: Array

    def __eq__(self, other: object) -> bool:
        return same_values(self, other) if isinstance(other, Fields) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.sigma.shape)

    def __repr__(self) -> str:
        names = ", ".join(f.name for f in fields(self))
        ends = f"sigma = {self.sigma[0]:.6g} ... {self.sigma[-1]:.6g} m" if self.sigma.size else "no sigma"
        return f"<Fields at {self.sigma.size} points, {ends}: {names}>"

    @property
    def x(self) -> Array:
        """Global coordinate x ``(n,)`` [m]."""
        return self.r[:, 0]

    @property
    def y(self) -> Array:
        """Global coordinate y ``(n,)`` [m]."""
        return self.r[:, 1]

    @property
    def tension(self) -> Array:
        """Elastic force along the tangent of the middle line ``(n,)`` [N]."""
        along = 1.0 + self.eps
        return (self.Q[:, 0] * along + self.Q[:, 1] * self.Gamma) / np.hypot(along, self.Gamma)

    @classmethod
    def from_state(
        cls,
        belt: Belt | StiffnessBelt,
        *,
        zone: Array,
        sigma: Array,
        r: Array,
        theta: Array,
        phi: Array,
        D: Array,
        rate: float,
        kappa: Array,
        p: Array,
        f: Array,
        v_rel: Array,
        weight: Array | None = None,
        offset: Array | None = None,
    ) -> Fields:
        """Adds strains and forces by the constitutive law (18.5), (18.6), and the weights of Simpson's rule.

        A fibre at r - d e2 has the derivative r' + d kappa e1 = (1 + eps + d kappa) e1 + Gamma e2, whose length and
        angle are D and phi.

        Args:
            rate: Transport rate c.
            offset: Distance d of the fibre whose stretch and tangent are given from the middle line, towards -e2
                ``(n,)``; zero by default.
        """
        if weight is None:
            joints = np.flatnonzero(np.diff(zone)) + 1
            weight = np.concatenate([simpson_weights(part) for part in np.split(sigma, joints)])
        psi = theta - phi
        eps, Gamma = D * np.cos(psi) - 1.0, -D * np.sin(psi)
        if offset is not None:
            eps -= offset * kappa
        Q = np.column_stack([belt.extensional_stiffness * eps, belt.shear_stiffness * Gamma])
        M = belt.bending_stiffness * (kappa - belt.curvature)
        return cls(
            zone=zone, weight=weight, sigma=sigma, r=r, theta=theta, phi=phi, D=D, eps=eps, Gamma=Gamma, kappa=kappa,
            Q=Q, M=M, p=p, f=f, v_rel=v_rel, speed=rate * D,
        )  # fmt: skip

    def in_units(self, units: Units) -> Fields:
        """The fields of a dimensionless scene in the given units."""
        scaled = {
            name: getattr(self, name) * scale
            for name, quantity in QUANTITIES.items()
            if (scale := quantity.scale(units)) != 1.0
        }
        return replace(self, weight=self.weight * units.length, **scaled)


def same_values(one: Any, other: Any) -> bool:
    """Whether two values are equal: arrays as a whole, dataclasses by what they compare, and NaN equal to itself."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    if is_dataclass(one) and type(one) is type(other):
        return all(same_values(getattr(one, f.name), getattr(other, f.name)) for f in fields(one) if f.compare)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same_values, one, other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same_values(value, other[name]) for name, value in one.items())
    return bool(one == other or (one != one and other != other))


def simpson_weights(x: Array) -> Array:
    """Weights of Simpson's rule on unequal points, parabola by parabola ``(n,)``."""
    weights, h = np.zeros(len(x)), np.diff(x)
    if len(h) < 2:
        return np.full(len(x), h.sum() / len(x))
    even = len(h) // 2 * 2
    left, right = h[:even:2], h[1:even:2]
    third = (left + right) / 6.0
    weights[:even:2] += third * (2.0 - right / left)
    weights[1:even:2] += third * (left + right) ** 2 / (left * right)
    weights[2 : even + 1 : 2] += third * (2.0 - left / right)
    if even < len(h):
        before, last = h[-2:]
        weights[-1] += last * (2.0 * last + 3.0 * before) / (6.0 * (before + last))
        weights[-2] += last * (last + 3.0 * before) / (6.0 * before)
        weights[-3] -= last**3 / (6.0 * before * (before + last))
    return weights
