# %% [markdown]
# # The chapter's problem, as plain as SciPy takes it
#
# One page, for the benchmark's fixed clock: the belt's four zones side by side on [0, 1], each as long as its parameter
# says, solved by `solve_bvp` with numeric Jacobians from a uniform first mesh. Nothing of belt_fenicsx is in it, no
# zone is looked for, and nothing is checked afterwards.
#
# Free spans have x, y, theta, kappa and the force's components X, Y; stick has phi, theta, kappa; sliding has D, too.

# %%
import math

import numpy as np
from scipy.integrate import solve_bvp

E, NU, H, W, LENGTH, SPAN = 5e7, 0.45, 0.05, 0.1, 1.0, 1.0
RADIUS, XC, YC, MU, X_TRANS, RATE = 0.7, 0.0, -0.575, 0.2, 0.0, 1.0
B1 = E * H * W  # the unit of force
A, B2 = H**2 / 12.0, 1.0 / (2.0 * (1.0 + NU))
NODES = 12  # of the first mesh


# %%
def free(y):
    """Rates of x, y, theta, kappa, X, Y, then phi and D."""
    _, _, theta, kappa, X, Y = y
    cos, sin = np.cos(theta), np.sin(theta)
    Q1, Q2 = X * cos + Y * sin, Y * cos - X * sin
    rx, ry = (1.0 + Q1) * cos - Q2 / B2 * sin, (1.0 + Q1) * sin + Q2 / B2 * cos
    zero = np.zeros_like(X)
    bending = (Q1 * Q2 / B2 - Q2 * (1.0 + Q1)) / A
    return np.array([rx, ry, kappa, bending, zero, zero]), np.arctan2(ry, rx), np.hypot(rx, ry)


def force(psi, D):
    """Force along the tangent and the normal of the belt."""
    eps, Gamma = D * np.cos(psi) - 1.0, -D * np.sin(psi)
    return eps * np.cos(psi) - B2 * Gamma * np.sin(psi), eps * np.sin(psi) + B2 * Gamma * np.cos(psi)


def stick(y, D):
    """Rates of phi, theta, kappa."""
    phi, theta, kappa = y
    return np.array([-D / RADIUS + 0.0 * phi, kappa, -D * force(theta - phi, D)[1] / A])


def slip(y):
    """Rates of phi, theta, kappa, D: (Q'.t) + mu (Q'.n) = 0, solved for D'."""
    phi, theta, kappa, D = y
    psi, turn = theta - phi, -D / RADIUS
    t, n = force(psi, D)
    s, c, b = np.sin(psi), np.cos(psi), 1.0 - B2
    t_psi, n_psi = s - 2.0 * b * D * s * c, b * D * (c * c - s * s) - c
    per_D = B2 + b * c * c + MU * b * s * c
    rest = (t_psi + MU * n_psi) * (kappa - turn) - turn * (n - MU * t)
    return np.array([turn, kappa, -D * n / A, -rest / per_D])


# %%
def rate(_, y, p):
    up, trans, off, D = p
    return np.concatenate(
        [
            (up + 0.5) * free(y[:6])[0],
            (trans - up) * stick(y[6:9], D),
            (off - trans) * slip(y[9:13]),
            (0.5 - off) * free(y[13:])[0],
        ]
    )


def on_pulley(phi):
    return XC - RADIUS * np.sin(phi), YC + RADIUS * np.cos(phi)


def conditions(first, last, p):
    (_, up_phi, up_D), (_, off_phi, off_D) = free(last[:6]), free(first[13:])
    up, off = first[6:9], last[9:13]
    return np.concatenate(
        [
            first[:3] - [-SPAN / 2, 0.0, 0.0],
            [*(last[:2] - on_pulley(up[0])), up_phi - up[0], last[2] - up[1], last[3] - up[2], up_D - p[3]],
            [*(last[6:9] - first[9:12]), first[12] - p[3], on_pulley(last[6])[0] - X_TRANS],
            [*(first[13:15] - on_pulley(off[0])), off_phi - off[0], first[15] - off[1], first[16] - off[2]],
            [off_D - off[3]],
            last[13:16] - [SPAN / 2, 0.0, 0.0],
        ]
    )


def plain(tol: float) -> float:
    """Angular velocity [rad/s], from a string with the right tangents and a guessed strain of 4 %."""
    wrap = math.asin(RADIUS / math.hypot(SPAN / 2, YC)) + math.atan2(YC, SPAN / 2)
    xi, D = np.linspace(0.0, 1.0, NODES + 1), 1.04
    x_up, y_up = on_pulley(wrap)
    ends = (x_up + SPAN / 2) / math.cos(wrap) / D - 0.5
    phi = wrap * (1.0 - xi)
    ones, zero = np.ones_like(xi), np.zeros_like(xi)
    pull, lift = (D - 1.0) * math.cos(wrap) * ones, (D - 1.0) * math.sin(wrap) * ones
    y = np.array(
        [
            *(-SPAN / 2 + (x_up + SPAN / 2) * xi, y_up * xi, wrap * ones, zero, pull, lift),
            *(phi, phi, -D / RADIUS * ones),
            *(phi - wrap, phi - wrap, -D / RADIUS * ones, D * ones),
            *(-x_up + (SPAN / 2 + x_up) * xi, y_up * (1.0 - xi), -wrap * ones, zero, pull, -lift),
        ]
    )
    result = solve_bvp(rate, conditions, xi, y, np.array([ends, 0.0, -ends, D]), tol=tol, max_nodes=100000)
    assert result.success, result.message
    return RATE * float(result.p[3]) / RADIUS


# %%
if __name__ == "__main__":
    for tol in (1e-3, 1e-5, 1e-7, 1e-9):
        print(f"tol {tol:g}: omega {plain(tol):.12f} rad/s")
