"""Cycles known in closed form or from published numbers, used by several test files."""

from __future__ import annotations

import numpy as np

from hbbogie import Coordinate, HarmonicBalance, Orbit, Parameter, System, solve


def radial(rho: float) -> tuple[System, Orbit]:
    """Return the radial normal form and its exact cycle: radius sqrt(rho), omega 1."""
    x, y, r = Coordinate("x"), Coordinate("y"), Parameter("rho", rho)
    s = x**2 + y**2
    system = System("radial", [x, y], [r], [x.dot - (r - s) * x + y, y.dot - (r - s) * y - x])
    c = np.sqrt(rho) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    return system, Orbit(system.name, ("x", "y"), ("", ""), c, 1.0, {"rho": rho})


def lure() -> tuple[System, Orbit]:
    """Return Lur'e's x''' + alpha x'' + x' + x - x^2 = 0, of mixed order, and its cycle at the period doubling."""
    x, y, alpha = Coordinate("x"), Coordinate("y"), Parameter("alpha", 0.63030200616)
    system = System("Lur'e", [x, y], [alpha], [x.ddot - y, y.dot + alpha * y + x.dot + x - x**2])
    c = np.zeros((51, 2))
    c[0], c[1], c[2] = (0.2, 0.0), (-0.6, 0.6), (0.0, 0.0)
    guess = Orbit(system.name, ("x", "y"), ("", ""), c, 0.987, dict(system.values))
    return system, solve(HarmonicBalance(25).equations(system), guess)
