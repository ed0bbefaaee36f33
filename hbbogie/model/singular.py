"""Places where equations are not smooth or not finite: divisions, logarithms and roots."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from hbbogie.errors import ModelError
from hbbogie.model.divisions import divisions
from hbbogie.model.system import System

Array = NDArray[np.float64]
SAMPLES = 101  # values of a parameter at which a denominator is looked at
ZERO = 1e-10  # share of its largest value up to which it is zero
ROOM = 1e-6  # share of an interval that is kept from a pole


@dataclass(frozen=True, eq=False)
class SingularTerms:
    """Expressions that may not be zero, or negative, and the equations in which they stand.

    Attributes
    ----------
    labels : tuple of str
        Such as "equation 2 divides by mu".
    of_parameters : ndarray of bool
        Which of them depend on parameters only.
    values : casadi.Function, (q, p) -> the expressions at rest
    """

    labels: tuple[str, ...]
    of_parameters: NDArray[np.bool_]
    values: ca.Function

    def vanishing(self, q: Array, p: Array) -> tuple[str, ...]:
        """Return the labels of those that are zero, negative or not finite at a state of rest."""
        values = self.values(q, p).full().ravel()
        size = ZERO * np.abs(values[np.isfinite(values)]).max(initial=1.0)
        return tuple(dict.fromkeys(t for t, v in zip(self.labels, values, strict=True) if not abs(v) > size or v < 0))


def singular_terms(system: System) -> SingularTerms:
    """Return what a system divides by and takes roots and logarithms of."""
    return system.once("singular terms", lambda: _singular_terms(system))


def poles(system: System, parameter: str, interval: tuple[float, float]) -> dict[float, str]:
    """Return the values in an interval, its ends included, at which the equations have a pole, with what vanishes.

    Only expressions of the parameters are looked at, the others at the system's values.
    """
    terms = singular_terms(system)
    place = system.parameter_names.index(parameter)
    own = [i for i in np.flatnonzero(terms.of_parameters) if terms.values.jac_sparsity(0, 1).has_nz(int(i), place)]
    if not own:
        return {}
    low, high = interval
    rest, base = np.zeros(system.n), system.vector()

    def at(values: Array) -> Array:
        p = np.repeat(base[:, None], len(values), axis=1)
        p[place] = values
        columns = system.once(("singular terms", len(values)), lambda: terms.values.map(len(values)))
        return np.asarray(columns(np.repeat(rest[:, None], len(values), axis=1), p).full())

    grid = np.linspace(low, high, SAMPLES)
    found: dict[float, str] = {}
    for i, d in zip(own, at(grid)[own], strict=True):

        def term(v: float, i: int = int(i)) -> float:
            return float(at(np.array([v]))[i, 0])

        for value in _zeros(term, grid, d):
            found.setdefault(value, terms.labels[i])
    return dict(sorted(found.items()))


def between_poles(
    system: System, parameter: str, interval: tuple[float, float]
) -> tuple[list[tuple[float, float]], tuple[str, ...]]:
    """Return the parts of an interval between the poles of the equations, and a sentence on each pole."""
    found, (low, high) = poles(system, parameter, interval), interval
    room = ROOM * (high - low)
    edges = [low, *(edge for value in found for edge in (value - room, value + room)), high]
    parts = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > room]
    return parts, tuple(f"a pole of the equations at {parameter} = {v:.6g}: {why}" for v, why in found.items())


def without_poles(system: System, parameter: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the part of an interval that holds the system's own value of the parameter and no pole.

    Raises
    ------
    ModelError
        Where the system's own value is a pole.
    """
    value = system.values[parameter]
    for pole, why in poles(system, parameter, (min(interval[0], value), max(interval[1], value))).items():
        if abs(pole - value) <= ROOM * 1e-3 * (interval[1] - interval[0]):
            raise ModelError(
                f"system {system.name!r} has a pole at {parameter} = {value:g}: {why}; give another value."
            )
    parts, _ = between_poles(system, parameter, interval)
    return next((part for part in parts if part[0] <= value <= part[1]), interval)


def _zeros(function: Callable[[float], float], grid: Array, d: Array) -> list[float]:
    """Return the zeros of a function of one variable, also those without change of sign.

    A function that is made to differ from zero at one point, as by ``if_else(k == 0, 1, k)``, has none there.
    """
    size = ZERO * np.abs(d[np.isfinite(d)]).max(initial=0.0)
    candidates = (_snapped(value, grid) for value in _near_zeros(function, grid, d, size))
    return [value for value in candidates if not abs(function(value)) > size]


def _near_zeros(function: Callable[[float], float], grid: Array, d: Array, size: float) -> Iterable[float]:
    away = np.abs(d)
    zero = away <= size
    crosses, dips = np.zeros((2, len(d)), dtype=bool)
    with np.errstate(invalid="ignore"):
        crosses[1:] = (d[1:] * d[:-1] < 0) & (away[:-1] > size)
        dips[1:-1] = (away[1:-1] < np.minimum(away[:-2], away[2:])) & (d[1:-1] * d[2:] > 0)
    for i in map(int, np.flatnonzero(zero | crosses | dips)):
        if zero[i]:
            yield float(grid[i])
        elif crosses[i]:
            yield float(brentq(function, grid[i - 1], grid[i], xtol=1e-14))
        else:
            dip = minimize_scalar(
                lambda v: abs(function(v)),
                bounds=(grid[i - 1], grid[i + 1]),
                method="bounded",
                options={"xatol": 1e-12},
            )
            if dip.fun <= size:
                yield float(dip.x)


def _snapped(value: float, grid: Array) -> float:
    return 0.0 if abs(value) < 1e-8 * (grid[-1] - grid[0]) else value


def _singular_terms(system: System) -> SingularTerms:
    q, p = ca.vertcat(*system.coordinates), ca.vertcat(*system.parameters) if system.parameters else ca.SX(0, 1)
    v, a = (ca.vertcat(*(getattr(c, name) for c in system.coordinates)) for name in ("dot", "ddot"))
    r = system.residual(q, v, a, p)
    labels, expressions = [], []
    for i in range(system.n):
        for what, expression in divisions(ca.Function("row", [q, v, a, p], [r[i]])(q, v, a, p)):
            labels.append(f"equation {i + 1} {what} {expression}")
            expressions.append(expression)
    moving = ca.vertcat(q, v, a)
    own = np.array([not ca.depends_on(e, moving) for e in expressions], dtype=bool)
    at_rest = ca.substitute(ca.vertcat(*expressions), ca.vertcat(v, a), ca.SX.zeros(2 * system.n))
    return SingularTerms(tuple(labels), own, ca.Function("singular", [q, p], [ca.densify(at_rest)]))
