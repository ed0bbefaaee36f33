"""A design: a system at one choice of its parameters, with its critical values and quantities derived from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.crossing import branches_from_hopf, crossings
from hbbogie.brief import brief
from hbbogie.critical.curvature import critical_hessian
from hbbogie.critical.folds import Critical, fold
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.critical.search import coincide
from hbbogie.critical.speeds import critical_speeds
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Row:
    """A smooth function of the parameters, at one design.

    Attributes
    ----------
    name : str
        The same for all designs.
    value : float
    gradient : ndarray, shape (number of parameters,)
        Derivative in every parameter of the system.
    hessian : callable, optional
        Names of k parameters -> second derivatives in them, shape (k, k); None if they are not known.
    """

    name: str
    value: float
    gradient: Array
    hessian: Callable[[Sequence[str]], Array] | None = None


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """The critical values of a parameter at one choice of all other parameters.

    Attributes
    ----------
    system : System
    equations : Equations
    parameter : str
        The parameter whose critical values these are.
    interval : (float, float), unit of the parameter
    critical : tuple of Critical
        Hopf points, and folds that are a minimum of the parameter, in increasing order.
    kept : dict
        Cycles computed at this design, by the quantity that needed them.
    """

    system: System
    equations: Equations
    parameter: str
    interval: tuple[float, float]
    critical: tuple[Critical, ...]
    kept: dict[Any, Orbit] = field(default_factory=dict)

    __repr__ = brief

    @property
    def value(self) -> float:
        """The smallest critical value, or the end of the range if there is none below it."""
        return min([c.value for c in self.critical] + [self.interval[1]])

    def beyond(self, share: float) -> float:
        """Return the value that exceeds the smallest critical value by the given fraction."""
        return self.value + share * abs(self.value)

    def gradient(self, slopes: Mapping[str, float]) -> Array:
        """Return a gradient by name as a vector over all parameters, shape (number of parameters,)."""
        return np.array([slopes.get(n, 0.0) for n in self.system.parameter_names])


def design_point(
    system: System,
    parameter: str,
    interval: tuple[float, float],
    harmonics: int = 15,
    near: DesignPoint | None = None,
) -> DesignPoint:
    """Find the critical values at a design, from scratch or from a nearby design.

    Parameters
    ----------
    system : System
        With the parameter values of the design.
    parameter : str
    interval : (float, float), unit of the parameter
    harmonics : int
        Highest harmonic.
    near : DesignPoint, optional
        A nearby design, whose folds are followed. No branch is traced unless the number of Hopf points has changed. A
        fold that no longer exists is left out.

    Raises
    ------
    ConvergenceError
        When the equilibrium is already unstable at the beginning of the range, or the gradient of the smallest critical
        value is not known.
    """
    equations = HarmonicBalance(harmonics).equations(system)
    eigenvalues = Linearisation(system, parameter).eigen(interval[0])[0]
    if eigenvalues[0].real > 1e-9 * np.abs(eigenvalues).max():
        raise ConvergenceError(
            f"the equilibrium is unstable already at {parameter} = {interval[0]:g}, where the range begins: the "
            "critical value lies below the range.",
            statistics={"below": interval[0]},
        )
    hopf = [] if near is None else hopf_points(system, parameter, interval)
    if near is None or len(hopf) != sum(c.kind == "hopf" for c in near.critical):
        found = [*critical_speeds(system, parameter, interval, harmonics=harmonics)]
    else:
        found = [hopf_gradient(system, h) for h in hopf]
    for c in near.critical if near else ():  # a fold stays when its Hopf point leaves the range
        warm = _followed(equations, c, parameter) if c.kind == "fold" else None
        if warm is not None and not any(coincide(warm, other) for other in found):
            found.append(warm)
    kept = sorted((c for c in found if c.extremum != "maximum"), key=lambda c: c.value)
    if kept and not kept[0].gradient and len(system.parameters) > 1:
        raise ConvergenceError(
            f"the {kept[0].kind} at {parameter} = {kept[0].value:g} has no gradient: {kept[0].status}"
        )
    cycles = {} if near is None else dict(near.kept)
    return DesignPoint(system, equations, parameter, interval, tuple(c for c in kept if c.gradient), cycles)


def _followed(equations: Equations, c: Critical, parameter: str) -> Critical | None:
    try:
        return fold(equations, c.orbit, parameter)
    except ConvergenceError:
        return None


def critical_rows(point: DesignPoint) -> list[tuple[Row, Critical | None]]:
    """Return value and gradient of every critical value, and of the end of the range, which caps the smallest one."""
    rows: list[tuple[Row, Critical | None]] = []
    count = {"hopf": 0, "fold": 0}
    for c in sorted(point.critical, key=lambda c: (c.kind, c.omega)):
        count[c.kind] += 1
        label = "Hopf point" if c.kind == "hopf" else "fold"
        second = partial(critical_hessian, point.equations, c)
        rows.append((Row(f"{label} {count[c.kind]}", c.value, point.gradient(c.gradient), second), c))
    flat = np.zeros(len(point.system.parameters))
    end = Row("end of the range", point.interval[1], flat, lambda names: np.zeros((len(names), len(names))))
    return [*rows, (end, None)]


def stable_cycle(point: DesignPoint, key: Any, value: float) -> Orbit | None:
    """Return the stable cycle at a value of the parameter, the largest if there are several; None if there is no cycle.

    Parameters
    ----------
    point : DesignPoint
        The search begins at the cycle kept under the key, which may come from a nearby design.
    key : hashable
    value : float, unit of the parameter
    """
    at: dict[str, Any] = {point.parameter: value}
    if key in point.kept:
        try:
            point.kept[key] = solve(point.equations, point.kept[key], method="newton", **at)
            return point.kept[key]
        except ConvergenceError:
            del point.kept[key]
    span = point.interval[0], max(point.interval[1], 1.01 * value)
    found = [
        cycle
        for branch in branches_from_hopf(point.equations, point.parameter, span)
        for cycle in crossings(point.equations, branch, value)
    ]
    if not found:
        return None

    def rank(cycle: Orbit) -> tuple[bool, float]:
        verdict = floquet(point.system, cycle).verdict
        return verdict == "stable", float(np.linalg.norm(cycle.coefficients[1:]))

    point.kept[key] = max(found, key=rank)
    return point.kept[key]
