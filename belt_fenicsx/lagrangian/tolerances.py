"""Where the method on a fixed mesh stops, and what it lets pass."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of the room; what has no unit here is relative.

    Attributes:
        shared: Elements of each rank from which on ranks that share a mesh are faster than one of them alone.
        coarse_rtol: The ``rtol`` of the coarser meshes that lead to the last one.
        penalty_scale: Factor on the full penalty, on which no answer depends.
        penalty_growth: Factor of the penalty from one update to the next.
        least_growth: Growth of the penalty below which a Newton iteration that diverges ends the solve.
        updates: Largest number of updates.
        newton_rtol: Norm of the residual at which Newton's iteration between two updates ends, over the start's.
        newton_atol: Norm of the residual at which it ends whatever the start's is, over the extensional stiffness.
        penetration: Largest penetration, over the pulley's radius, per ``rtol``.
        penetration_range: Bounds of that largest penetration, whatever ``rtol`` is.
        multiplier_change: Largest change of the multipliers in one update per ``rtol``. It sits near the joints and
            alternates in sign: omega, which feels its resultant, is closer to its limit by four to five digits.
        resultant_factor: Factor on the resultant of the friction's change, which omega feels at once.
        rounding: Share of the nodal forces' rounding errors that does not cancel in the pressure; on 4e5 elements it
            is 0.05.
        blur: Rounding errors of a penetration by which updates go on to change the pressure; on graded meshes 0.4.
        margin: Negative margin that the certificate allows, which unfinished updates leave. A coarse mesh that has the
            wrong sense of sliding by more is no answer, though a finer one may find the scene admissible.
        balance: Negative margin of the balances, and of the force of a take-up, over the tension, that the certificate
            allows: a mesh meets them as well as it resolves the layers, and hub loads jump where contact begins or ends
            at another Gauss point. In the chapter's scene it is a thousandth of the whole pressure.
        largest_error: Estimated error of a torque or a clamp moment from which on it is no answer. On the 287 meshes
            of `accuracy.SAFETY` it kept errors above 5 % from being answers, but for one of 6 %.
    """

    shared: int = 1000
    coarse_rtol: float = 1e-6
    penalty_scale: float = 1.0
    penalty_growth: float = 10.0
    least_growth: float = 1.2
    updates: int = 200
    newton_rtol: float = 1e-1
    newton_atol: float = 1e-13
    penetration: float = 1e-1
    penetration_range: tuple[float, float] = (1e-9, 1e-7)
    multiplier_change: float = 1e3
    resultant_factor: float = 10.0
    rounding: float = 0.1
    blur: float = 0.5
    margin: float = 1e-6
    balance: float = 6.5e-4
    largest_error: float = 0.2
