"""Planar normal form of a degenerate (Bautin) Hopf bifurcation: a fold of cycles in closed form.

In polar coordinates the motion is r' = r (mu + a r^2 - r^4), theta' = w0. With s = x^2 + y^2:

    x' = x (mu + a s - s^2) - w0 y
    y' = y (mu + a s - s^2) + w0 x

Cycles are circles with r^4 - a r^2 - mu = 0, run through at the frequency w0. For a > 0 the Hopf
bifurcation at mu = 0 is subcritical: an unstable cycle leads back to the fold at mu = -a^2 / 4,
r^2 = a / 2, whence a stable cycle of larger radius leads forward.

Source: Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 8.3 (Bautin bifurcation).
Assumptions: normal form cut off at fifth order; x, y dimensionless, time in seconds.

Symbols: x, y [1] coordinates; r [1] radius; mu [1/s] growth rate of small motions; a [1/s] cubic
coefficient; w0 [rad/s] frequency.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import Coordinate, Parameter, System


def bautin(**parameters: float) -> System:
    """Return the normal form, two equations of first order.

    Parameters
    ----------
    **parameters : float
        Values of mu [1/s], a [1/s], w0 [rad/s] that replace the defaults -0.1, 1, 1.
    """
    x = Coordinate("x", "1", "first coordinate")
    y = Coordinate("y", "1", "second coordinate")
    mu = Parameter("mu", -0.1, "1/s", "growth rate of small motions", (-1e3, 1e3))
    a = Parameter("a", 1.0, "1/s", "cubic coefficient", (-1e3, 1e3))
    w0 = Parameter("w0", 1.0, "rad/s", "frequency", (1e-6, 1e6))
    s = x**2 + y**2
    rate = mu + a * s - s**2
    equations = [x.dot - x * rate + w0 * y, y.dot - y * rate - w0 * x]
    system = System("Bautin normal form", [x, y], [mu, a, w0], equations, description="fold of cycles")
    return system.with_parameters(**parameters)


def radii(mu: float, a: float = 1.0) -> NDArray[np.float64]:
    """Return the radii of the cycles, increasing.

    Parameters
    ----------
    mu, a : float, 1/s

    Returns
    -------
    ndarray, shape (0,), (1,) or (2,), dimensionless
        Between the fold and the Hopf point the first cycle is unstable; the largest one is stable.
    """
    root = np.emath.sqrt(a**2 / 4 + mu)
    if np.iscomplexobj(root):
        return np.empty(0)
    s = np.unique([a / 2 - root, a / 2 + root])
    return np.sqrt(s[s > 0])


def multiplier(radius: ArrayLike, a: float = 1.0, w0: float = 1.0) -> NDArray[np.float64]:
    """Return the nontrivial multiplier exp((2 pi / w0) d(r')/dr) of the cycle with a radius.

    Parameters
    ----------
    radius : array_like, dimensionless
    a : float, 1/s
    w0 : float, rad/s

    Returns
    -------
    ndarray, shape of radius, dimensionless
    """
    s = np.asarray(radius, dtype=float) ** 2
    # d/dr of r (mu + a r^2 - r^4) with mu = r^4 - a r^2 put in
    return np.exp(2 * np.pi / w0 * 2 * s * (a - 2 * s))


def fold(a: float = 1.0) -> tuple[float, float]:
    """Return growth rate mu [1/s] and radius [1] at the fold of cycles, for a > 0."""
    return -(a**2) / 4, float(np.sqrt(a / 2))


SYSTEM = bautin
PARAMETER = "mu"
RANGE = (-0.3, 0.2)
