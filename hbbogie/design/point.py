"""A design: a system at one choice of its parameters, with its critical values and quantities derived from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import branches_from_hopf, crossings
from hbbogie.branches.simulated import settled_cycles
from hbbogie.brief import brief
from hbbogie.critical.curvature import critical_hessian, fold_motion
from hbbogie.critical.folds import Critical, fold
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.critical.search import coincide
from hbbogie.critical.speeds import critical_speeds
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import widened
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
SHORTEST = 0.05  # share of the way to another design at which a fold that is followed in steps is given up


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
    names : tuple of str
        Their names, such as "fold 1". A fold keeps its name from design to design.
    kept : dict
        Cycles computed at this design, by the quantity that needed them.
    random : dict
        Random designs about this one, solved for, by the quantity that needed them.
    searched : bool
        Whether all branches were traced here, rather than folds followed.
    """

    system: System
    equations: Equations
    parameter: str
    interval: tuple[float, float]
    critical: tuple[Critical, ...]
    names: tuple[str, ...]
    kept: dict[Any, Orbit] = field(default_factory=dict)
    random: dict[Any, tuple[DesignPoint | float, ...]] = field(default_factory=dict)
    searched: bool = False

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
    anew: bool = False,
    follow: bool = False,
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
        A nearby design, whose folds are followed. Branches are traced only if there are more Hopf points than there, or
        if a fold that may be the smallest critical value is lost. Other folds that are lost are left out.
    anew : bool
        Whether branches are traced in any case; what they lead to is added to what is followed.
    follow : bool
        Whether to give up, rather than to trace, where a fold that may be the smallest critical value is lost.

    Raises
    ------
    ConvergenceError
        When the equilibrium is already unstable at the beginning of the range, the gradient of the smallest critical
        value is not known, a fold is lost that was to be followed, or a cycle is
        not followed to its fold.

    Notes
    -----
    Cycles may live in the range without a Hopf point that leads to them. Where a search finds no critical value at all,
    motions at the end of the range are therefore simulated. Where they come to a cycle, its branch leads to the fold.
    """
    equations = HarmonicBalance(harmonics).equations(system)
    eigenvalues = Linearisation(system, parameter).eigen(interval[0])[0]
    if eigenvalues[0].real > 1e-9 * np.abs(eigenvalues).max():
        raise ConvergenceError(
            f"the equilibrium is unstable already at {parameter} = {interval[0]:g}, where the range begins: the "
            "critical value lies below the range.",
            statistics={"below": interval[0]},
        )
    known, lost = ({}, False) if near is None else _followed(near, system, harmonics)
    if lost and follow:
        raise ConvergenceError("a fold that may be the smallest critical value was lost on the way to this design.")
    hopfs = [sum(c.kind == "hopf" for c in some) for some in (known.values(), near.critical if near else ())]
    if near is None or anew or lost or hopfs[0] > hopfs[1]:
        found = critical_speeds(system, parameter, interval, harmonics=harmonics)
        new = [c for c in found if c.extremum != "maximum" and not _among(c, known)]
        if not any(c.value < interval[1] for c in (*known.values(), *new)):
            new += _apart(system, parameter, interval, harmonics)
        known |= _numbered(new, (*known, *near.names) if near else ())
    kept = sorted(known.items(), key=lambda item: item[1].value)
    if kept and not kept[0][1].gradient and len(system.parameters) > 1:
        first = kept[0][1]
        raise ConvergenceError(f"the {first.kind} at {parameter} = {first.value:g} has no gradient: {first.status}")
    kept = [(name, c) for name, c in kept if c.gradient]
    names, critical = tuple(name for name, _ in kept), tuple(c for _, c in kept)
    cycles, random = ({} if near is None or anew else dict(near.kept)), ({} if near is None else dict(near.random))
    return DesignPoint(system, equations, parameter, interval, critical, names, cycles, random, near is None or anew)


def _apart(system: System, parameter: str, interval: tuple[float, float], harmonics: int) -> list[Critical]:
    """Return folds that no Hopf point leads to: of the cycles to which motions at the end of the range come.

    Raises
    ------
    ConvergenceError
        When a motion goes on without settling on a cycle, or the branch of its cycle does not end in the range.
    """
    equations = HarmonicBalance(harmonics).equations(system.with_parameters(**{parameter: interval[1]}))
    found: list[Critical] = []
    try:
        cycles = settled_cycles(equations, parameter)
    except ConvergenceError as error:
        if error.statistics.get("goes on"):
            raise
        cycles = []  # motions die out, if slowly
    for cycle in cycles:
        branch = trace(equations, cycle, parameter, interval, families=False, stability=False)
        if branch.values.min() <= interval[0]:
            raise ConvergenceError(
                f"the system has a cycle at {parameter} = {interval[0]:g} already, where the range begins.",
                statistics={"below": interval[0]},
            )
        lowest = [fold(equations, special) for special in branch.folds() if special.extremum == "minimum"]
        if not lowest:
            raise ConvergenceError(
                f"a cycle at {parameter} = {interval[1]:g} was not followed down to where it begins: {branch.ends}."
            )
        found += [c for c in lowest if not any(coincide(c, other) for other in found)]
    return found


def _followed(near: DesignPoint, system: System, harmonics: int) -> tuple[dict[str, Critical], bool]:
    """Return the critical values by name as they follow from those of a nearby design, and whether one is lost."""
    hopf = [hopf_gradient(system, h) for h in hopf_points(system, near.parameter, near.interval)]
    found, lost, smallest_lost = _numbered(hopf), [], False
    for name, c in zip(near.names, near.critical, strict=True):
        if c.kind == "fold":
            there = _moved(c, near.system, system, harmonics)
            if there is None or _among(there, found):
                lost.append((c.value + min(_expected(c, near.system, system), 0.0), name, c))
            else:
                found[name] = there  # a fold stays when its Hopf point leaves the range
    for least, name, c in sorted(lost):
        smallest = min([other.value for other in found.values()] + [near.interval[1]])
        if least <= smallest:
            last, between = _in_steps(c, near.system, system, harmonics)
            if between is system and not _among(last, found):
                found[name] = last
            elif last.value + min(_expected(last, between, system), 0.0) <= smallest:
                smallest_lost = True
    return found, smallest_lost


def _expected(c: Critical, before: System, after: System) -> float:
    """Return by how much a critical value changes from one design to another, to first order."""
    return sum(c.gradient[n] * (after.values[n] - value) for n, value in before.values.items() if n in c.gradient)


def _among(c: Critical, found: Mapping[str, Critical]) -> bool:
    return any(coincide(c, other) for other in found.values())


def _moved(c: Critical, before: System, after: System, harmonics: int) -> Critical | None:
    """Return the fold of a design that Newton's method finds from one of another design; None where it finds none."""
    change = {n: after.values[n] - value for n, value in before.values.items() if n in c.gradient}
    change = {n: step for n, step in change.items() if step}
    p = after.vector(**{c.parameter: c.value + _expected(c, before, after)})
    equations = HarmonicBalance(harmonics).equations(before).phased(c.orbit)
    try:
        z = equations.encode(c.orbit) + fold_motion(equations, c, [*change])[:-1] @ [*change.values()]
        there = fold(HarmonicBalance(harmonics).equations(after), equations.decode(z, p), c.parameter, search=False)
    except FAILURES:
        return None
    return there if there.extremum == c.extremum else None


def _in_steps(c: Critical, before: System, after: System, harmonics: int) -> tuple[Critical, System]:
    """Follow a fold from one design to another in steps; return it where it was followed to, and the design there."""
    way = {name: after.values[name] - value for name, value in before.values.items() if name != c.parameter}
    here, done, stride = before, 0.0, 0.5
    while done < 1 and stride > SHORTEST:
        share = min(done + stride, 1.0)
        there = after
        if share < 1:
            there = after.with_parameters(**{n: after.values[n] - (1 - share) * step for n, step in way.items()})
        moved = _moved(c, here, there, harmonics)
        if moved is None:
            stride /= 2
        else:
            here, done, c, stride = there, share, moved, 1.5 * stride
    return c, here


def _numbered(found: Sequence[Critical], taken: Sequence[str] = ()) -> dict[str, Critical]:
    """Return critical values by names that are not taken: the kind and a number, in order of frequency."""
    named: dict[str, Critical] = {}
    for kind, label in (("fold", "fold"), ("hopf", "Hopf point")):
        free = (name for k in count(1) if (name := f"{label} {k}") not in taken)
        named |= dict(zip(free, sorted((c for c in found if c.kind == kind), key=lambda c: c.omega), strict=False))
    return named


def critical_rows(point: DesignPoint) -> list[tuple[Row, Critical | None]]:
    """Return value and gradient of every critical value, and of the end of the range, which caps the smallest one."""
    rows: list[tuple[Row, Critical | None]] = []
    for name, c in zip(point.names, point.critical, strict=True):
        second = partial(critical_hessian, point.equations, c)
        rows.append((Row(name, c.value, point.gradient(c.gradient), second), c))
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
    found: list[Orbit] = []
    for reach in (span, widened(point.system, point.parameter, span)):  # its Hopf point may lie beyond the end
        if not found:
            branches = branches_from_hopf(point.equations, point.parameter, reach)
            found = [cycle for branch in branches for cycle in crossings(point.equations, branch, value)]
    if not found:
        return None

    def rank(cycle: Orbit) -> tuple[bool, float]:
        verdict = floquet(point.system, cycle).verdict
        return verdict == "stable", float(np.linalg.norm(cycle.coefficients[1:]))

    point.kept[key] = max(found, key=rank)
    return point.kept[key]
