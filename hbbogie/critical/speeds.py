"""All critical values of a parameter over an interval, without a guess."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from hbbogie.branches.crossing import extent, from_hopf
from hbbogie.branches.resolution import doubt_at_fold
from hbbogie.critical.folds import fold
from hbbogie.critical.harmonic_error import with_error
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.critical import Critical, Criticals
from hbbogie.results.failure import FAILURES, ConvergenceError

BEYOND = 0.5  # share of the interval by which Hopf points are looked for beyond its ends
SAME = 1e-7  # relative distance in value and frequency below which two points are one
ORDERS = (9, 21)  # highest harmonics with which a branch is followed, tried in turn
RESOLVED, LOST = 0.02, 0.1  # shares of the highest harmonics up to which a branch needs no more, and tells anything


@door(system=System, parameter=str)
def critical_speeds(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    *,
    harmonics: int = 21,
    start: Start | None = None,
    limit: float | None = None,
    **values: float,
) -> Criticals:
    """Find the critical values of a parameter, without a guess: Hopf points and the folds of their branches.

    Each branch is followed from its Hopf point to where it leaves the interval or ends, with 9 harmonics; with more
    where these do not resolve its cycles or lose it. Each fold is then solved for with all harmonics.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look; twice the parameter's value (at least 1) to either side, within its bounds, where left out.
    harmonics : int
        Highest harmonic of the folds.
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only Hopf points of the equilibrium near it, and their branches, are looked at.
    limit : float, optional, s
        Time after which the search ends with what was found, and says so in ``undecided``.
    **values : float
        Parameter values, by name.

    Returns
    -------
    Criticals : list of Critical
        In increasing order of the value. The error of a fold bounds what the harmonics left out change. The list
        carries ``evidence``: how far each branch was followed; and ``undecided``: what was not followed to its end.
        Folds on branches that reach no Hopf point in the interval, or up to half of it beyond its ends, are not among
        them.

    Raises
    ------
    ModelError
        For wrong names or values.
    """
    system = system.with_parameters(**values)
    if harmonics == 0:
        raise ModelError("critical_speeds: harmonics=0; give a whole number from 1.")
    lo, hi = check_interval(system, parameter, interval)
    # the branch of a fold inside may begin at a Hopf point beyond the end
    around = lo - BEYOND * (hi - lo), hi + BEYOND * (hi - lo)
    span = check_interval(system, parameter, around)
    with time_limit(limit):
        search = _Search(HarmonicBalance(harmonics).equations(system), harmonics, span)
        points = hopf_points(system, parameter, span, start=start)
        search.undecided += points.undecided
        if not points:
            search.evidence += points.evidence
        for hopf in points:
            if lo <= hopf.value <= hi:
                search.found.append(hopf_gradient(system, hopf))
            search.follow(hopf)
        if time_is_over() and not search.undecided:
            search.undecided.append("the time limit was reached before all was searched")
        inside = [
            _with_doubt(system, with_error(system, c, harmonics)) if c.kind == "fold" else c
            for c in search.found
            if lo <= c.value <= hi
        ]
    return Criticals(sorted(inside, key=lambda c: c.value), search.evidence, search.undecided)


def _with_doubt(system: System, fold: Critical) -> Critical:
    """Return a fold whose status says so where its cycle is not resolved."""
    doubt = doubt_at_fold(system, fold.orbit)
    return replace(fold, status=f"{fold.status}; {doubt}") if doubt else fold


@dataclass(eq=False)
class _Search:
    """The search for folds along branches, and what it has found."""

    equations: Equations
    harmonics: int
    span: tuple[float, float]
    found: list[Critical] = field(default_factory=list)
    evidence: list[str] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)

    def follow(self, hopf: SpecialPoint) -> None:
        """Follow the branch from a Hopf point, with more harmonics where it takes them, and solve for its folds."""
        name = f"the branch from the Hopf point at {hopf.parameter} = {hopf.value:.9g}"
        orders = sorted({min(H, self.harmonics) for H in ORDERS})
        why, branches, folds, tail = "the time limit was reached", list[Branch](), list[Critical](), 0.0
        for H in orders:
            if time_is_over():
                break
            try:
                branches = self._traced(hopf, H)
            except FAILURES as error:
                why = str(error).partition("\n")[0]
                continue
            last = orders[-1] == H
            try:
                folds = [self._solved(special, last) for branch in branches for special in branch.folds()]
            except ConvergenceError:  # of a fold that these harmonics alone have
                continue
            tail = max(o.tail for branch in branches for o in branch.orbits)
            if all(map(_complete, branches)) and tail <= RESOLVED:
                break
        if not branches:
            said = f"{name} was not followed: {why}"
            self.evidence.append(said)
            self.undecided.append(said)
            return
        lost = f"; {H} harmonics do not resolve all its cycles, whose folds may be others" if tail > LOST else ""
        for branch in branches:
            said = f"{extent(name, branch)}{lost}"
            self.evidence.append(said)
            if lost or not _complete(branch):
                self.undecided.append(said)
        self.found += [c for c in folds if not any(coincide(c, other) for other in self.found)]

    def _traced(self, hopf: SpecialPoint, H: int) -> list[Branch]:
        equations = HarmonicBalance(H).equations(self.equations.system)
        return from_hopf(equations, hopf, hopf.parameter, self.span)

    def _solved(self, special: SpecialPoint, last: bool) -> Critical:
        """Return a fold of a branch with its gradient; of the last attempt without one where that does not converge."""
        try:
            return fold(self.equations, special, special.parameter, search=last and not time_is_over())
        except ConvergenceError as error:
            if not last:
                raise
            status, orbit = f"located along the branch, {special.status}; no gradient: {error}", special.orbit
        shown: dict[str, Any] = {"gradient": {}, "residual": orbit.residual, "curvature": float("nan")}
        return Critical(
            kind="fold",
            parameter=special.parameter,
            value=special.value,
            extremum=special.extremum,
            omega=special.omega,
            orbit=orbit,
            status=status,
            **shown,
        )


def _complete(branch: Branch) -> bool:
    return all(end.complete for end in branch.ends)


def coincide(a: Critical | SpecialPoint, b: Critical | SpecialPoint) -> bool:
    """Tell whether two points are one: of one kind, and the same in value and frequency."""
    pairs: tuple[tuple[Any, Any], ...] = ((a.value, b.value), (a.omega, b.omega))
    return a.kind == b.kind and all(abs(x - y) <= SAME * max(abs(x), abs(y)) for x, y in pairs)
