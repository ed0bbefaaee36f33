"""First cycles without a guess: equilibria, Hopf points, and the small cycles that begin there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint

Array = NDArray[np.float64]


def hopf_points(
    system: System, parameter: str, interval: tuple[float, float], *, points: int = 201
) -> list[SpecialPoint]:
    """Find all Hopf points of the equilibrium over an interval of a parameter.

    The k-th largest real part among the oscillating modes is a continuous function of the parameter;
    its changes of sign are refined by bracketing, and its local extrema close to zero are looked into
    as well, so that a pair that crosses and comes back between two samples is not lost.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    points : int
        Samples over the interval.

    Returns
    -------
    list of SpecialPoint, kind "hopf", in increasing order of the parameter
        Each orbit is the linear cycle along the critical mode whose largest coordinate is 1 in its unit.

    Raises
    ------
    ModelError
        For an unknown parameter or an empty interval.
    """
    lo, hi = check_interval(system, parameter, interval)
    line = Linearisation(system, parameter)
    grid = np.linspace(lo, hi, points)
    growth = line.growth(grid)
    found: list[SpecialPoint] = []
    for k in range(max((len(g) for g in growth), default=0)):

        def alpha(value: float, k: int = k) -> float:
            (real,) = line.growth([value])
            return float(real[k]) if k < len(real) else float("nan")

        samples = np.array([g[k] if k < len(g) else np.nan for g in growth])
        for a, b in _brackets(grid, samples, alpha):
            found.append(_hopf(line, parameter, alpha, a, b, k))
    found.sort(key=lambda s: s.value)
    return [s for i, s in enumerate(found) if i == 0 or not _same(s, found[i - 1])]


def _brackets(grid: Array, samples: Array, alpha: Callable[[float], float]) -> list[tuple[float, float]]:
    """Return intervals over which the function changes sign; extrema close to zero are refined first."""
    brackets: list[tuple[float, float]] = []
    spread = np.nanmax(np.abs(np.diff(samples)), initial=0.0)
    for i in range(len(grid) - 1):
        a, b = samples[i], samples[i + 1]
        if a * b < 0 or (a == 0 and i == 0) or b == 0:
            brackets.append((float(grid[i]), float(grid[i + 1])))
            continue
        if not (0 < i < len(grid) - 2) or min(abs(a), abs(b)) > 2 * spread:
            continue
        turning = (samples[i - 1] - a) * a > 0 and (samples[i + 2] - b) * b > 0
        if turning:  # both neighbours lie farther from zero: there may be a dip through zero inside
            sign = np.sign(a)
            dip = minimize_scalar(lambda v, s=sign: s * alpha(v), bounds=(grid[i], grid[i + 1]), method="bounded")
            if dip.fun < 0:
                brackets += [(float(grid[i]), float(dip.x)), (float(dip.x), float(grid[i + 1]))]
    return brackets


def _hopf(
    line: Linearisation, parameter: str, alpha: Callable[[float], float], a: float, b: float, k: int
) -> SpecialPoint:
    ends = alpha(a), alpha(b)
    value = (
        a
        if ends[0] == 0
        else b
        if ends[1] == 0
        else float(brentq(alpha, a, b, xtol=1e-13 * max(abs(a), abs(b)), rtol=1e-14))
    )
    if abs(value) < 1e-12 * (b - a):
        value = 0.0
    real, eigenvalues, vectors = line.pairs(value)
    omega, mode = float(eigenvalues[k].imag), vectors[: line.system.n, k]
    mode = mode / mode[np.argmax(np.abs(mode))]
    coefficients = np.array([line.equilibrium(value), mode.real, -mode.imag])
    system = line.system
    orbit = Orbit(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        coefficients,
        omega,
        dict(zip(system.parameter_names, map(float, line.parameters(value)), strict=True)),
        "linearisation",
        0.0,
        "the linear cycle along the critical mode",
    )
    direction = "gains" if ends[1] > ends[0] else "loses"
    status = f"a pair of eigenvalues {direction} a positive real part; real part {real[k]:.1e} 1/s where located"
    width = 1e-13 * max(abs(value), abs(b - a))
    return SpecialPoint("hopf", parameter, value, (value - width, value + width), orbit, status)


def _same(a: SpecialPoint, b: SpecialPoint) -> bool:
    close = abs(a.value - b.value) <= 1e-9 * max(abs(a.value), abs(b.value), 1e-9)
    return close and abs(a.omega - b.omega) <= 1e-6 * a.omega
