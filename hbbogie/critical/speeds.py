"""All critical values of a parameter over an interval, without a guess."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from hbbogie.branches.continuation import trace
from hbbogie.branches.resolution import doubt_at_fold
from hbbogie.critical.folds import fold
from hbbogie.critical.groups import cycles_of_groups
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
    where these do not resolve its cycles or lose it. Each fold is then solved for with all harmonics. Where the
    coordinates belong to groups of bodies, motions in which one group moves below the first Hopf point lead to further
    branches.

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
        search.look_in_groups([hopf.value for hopf in points])
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
    branches: list[Branch] = field(default_factory=list)

    def look_in_groups(self, hopf: list[float]) -> None:
        """Follow the branches to which motions of one group of bodies lead, up to where these were begun."""
        if not self.branches or time_is_over():
            return
        coarse, parameter = HarmonicBalance(ORDERS[0]).equations(self.equations.system), self.branches[0].parameter
        for said, cycle in cycles_of_groups(coarse, self.branches, hopf):
            self.evidence.append(said)
            if cycle is None:
                continue
            value = cycle.parameters[parameter]
            try:
                branch = trace(coarse, cycle, parameter, (self.span[0], value), families=False, stability=False)
                found = [self._solved(special, True) for special in branch.folds()]
            except FAILURES as error:
                self.undecided.append(f"the branch of {said} was not followed: {error}")
                continue
            self.evidence.append(f"its branch was followed down to {float(branch.values.min()):.6g}: {branch.ends[1]}")
            self._add(found)

    def _add(self, folds: list[Critical]) -> None:
        self.found += [c for c in folds if not any(coincide(c, other) for other in self.found)]

    def follow(self, hopf: SpecialPoint) -> None:
        """Follow the branch from a Hopf point, with more harmonics where it takes them, and solve for its folds."""
        name = f"the branch from the Hopf point at {hopf.parameter} = {hopf.value:.9g}"
        orders = sorted({min(H, self.harmonics) for H in ORDERS})
        why, branch, folds, tail = "the time limit was reached", None, list[Critical](), 0.0
        for H in orders:
            if time_is_over():
                break
            try:
                branch = self._traced(hopf, H)
            except FAILURES as error:
                why = str(error).partition("\n")[0]
                continue
            last = orders[-1] == H
            try:
                folds = [self._solved(special, last) for special in branch.folds()]
            except ConvergenceError:  # of a fold that these harmonics alone have
                continue
            tail = max(o.tail for o in branch.orbits)
            if branch.ends[1].complete and tail <= RESOLVED:
                break
        if branch is None:
            said = f"{name} was not followed: {why}"
            self.evidence.append(said)
            self.undecided.append(said)
            return
        low, high = float(branch.values.min()), float(branch.values.max())
        said = f"{name} was followed from {low:.6g} to {high:.6g}: {branch.ends[1]}"
        lost = tail > LOST
        if lost:
            said += f"; {H} harmonics do not resolve all its cycles, whose folds may be others"
        self.evidence.append(said)
        if lost or not branch.ends[1].complete:
            self.undecided.append(said)
        self.branches.append(branch)
        self._add(folds)

    def _traced(self, hopf: SpecialPoint, H: int) -> Branch:
        equations = HarmonicBalance(H).equations(self.equations.system)
        return trace(equations, hopf, hopf.parameter, self.span, families=False, stability=False)

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


def coincide(a: Critical | SpecialPoint, b: Critical | SpecialPoint) -> bool:
    """Tell whether two points are one: of one kind, and the same in value and frequency."""
    pairs: tuple[tuple[Any, Any], ...] = ((a.value, b.value), (a.omega, b.omega))
    return a.kind == b.kind and all(abs(x - y) <= SAME * max(abs(x), abs(y)) for x, y in pairs)
