"""All critical values of a parameter over an interval, without a guess."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from hbbogie.branches.choice import chosen_methods, is_switched_linear
from hbbogie.branches.closed_form import exact_branch, exact_critical, exact_walk
from hbbogie.branches.collocated import collocated_critical, followed_from
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import complete, extent, from_hopf
from hbbogie.branches.resolution import MEET, doubt_at_fold
from hbbogie.collocation.method import Collocation
from hbbogie.critical.folds import fold, located_fold
from hbbogie.critical.groups import cycles_of_groups
from hbbogie.critical.harmonic_error import ROUND_OFF, with_error
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import check_interval, widened
from hbbogie.model.system import System
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.critical import Critical, Criticals
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.stability.fold_defect import FoldShift, fold_shift

SAME = 1e-7  # relative distance in value and frequency below which two points are one
STEEP = 1e-3  # the same in frequency, of two folds
HARMONICS = 21  # highest harmonic of a fold by harmonic balance, where none is given
BY = {"exact": "in closed form", "mhb": "by harmonic balance", "collocation": "by collocation"}
ORDERS = (9, 21)  # highest harmonics with which a branch is followed, tried in turn
APART = 0.01  # share of the interval by which a fold must lie above another one to stay so with more harmonics
SMALL = 1e-3  # share of the interval up to which what harmonics leave out is corrected for, by which a fold is shifted
RESOLVED, LOST = 0.02, 0.1  # shares of the highest harmonics up to which a branch needs no more, and tells anything


@door(system=System, parameter=str)
def critical_speeds(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    *,
    method: str = "auto",
    harmonics: int | None = None,
    start: Start | None = None,
    limit: float | None = None,
    **values: float,
) -> Criticals:
    """Find the critical values of a parameter, without a guess: Hopf points and the folds of their branches.

    Each branch is followed from its Hopf point to where it leaves the interval or ends. In closed form, and by
    collocation, its folds are those of the cycles themselves. By harmonic balance it is followed with 9 harmonics, with
    more where these do not resolve its cycles or lose it. Each fold is then solved for with 21, and its value corrected
    for what these leave out (eq-fold-shift), unless the system is linear between switchings. The orbit at the fold
    keeps the value that its harmonics give.

    Where the coordinates belong to groups of bodies, motions in which one group moves below the first Hopf point lead
    to further branches.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look; twice the parameter's value (at least 1) to either side, within its bounds, where left out. A
        fold below it counts as well where the branch from a Hopf point inside goes down to it: cycles then exist at
        the beginning of the interval already.
    method : {"auto", "exact", "mhb", "collocation"}
        "auto" follows a branch in closed form where the system is linear between switchings, else by multi-harmonic
        balance, and by collocation where the system is smooth and harmonics do not resolve the branch or a fold of it.
        The ``evidence`` and the status of each fold say by which it was.
    harmonics : int, optional
        Highest harmonic of the folds, whose values are then those of these harmonics, not corrected; where it is given,
        "auto" is "mhb".
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only Hopf points of the equilibrium near it, and their branches, are looked at.
    limit : float, optional, s
        Time after which the search ends with what was found, and says so in ``undecided``.
    **values : float
        Parameter values, by name.

    Returns
    -------
    Criticals : list of Critical
        In increasing order of the value. The error of a fold bounds what harmonics left out, or the mesh, change: the
        size of the correction where there is one, of which usually a few hundredths are left. The
        list carries ``evidence``: how far each branch was followed; ``undecided``: what was not followed to its end.
        Folds on branches that reach no Hopf point in the interval, or up to half of it beyond its ends, are not among
        them.

    Raises
    ------
    ModelError
        For wrong names or values, and for a method that does not apply to the system.
    """
    with time_limit(limit):
        return criticals(system.with_parameters(**values), parameter, interval, method, harmonics, start)


def criticals(
    system: System,
    parameter: str,
    interval: tuple[float, float] | None,
    method: str,
    harmonics: int | None,
    start: Start | None = None,
    *,
    lowest: bool = False,
) -> Criticals:
    """Return critical values as `critical_speeds`, or only the lowest ones in full.

    Parameters
    ----------
    system, parameter, interval, method, harmonics, start
        As of `critical_speeds`.
    lowest : bool
        Whether folds of harmonic balance that lie above others are only located along their branches.
    """
    if harmonics == 0:
        raise ModelError("critical_speeds: harmonics=0; give a whole number from 1.")
    methods = chosen_methods("critical_speeds", system, method, harmonics, along=parameter)
    corrects, harmonics = harmonics is None, HARMONICS if harmonics is None else harmonics
    HarmonicBalance(harmonics).check(system)
    lo, hi = check_interval(system, parameter, interval)
    span = widened(system, parameter, (lo, hi))  # the branch of a fold inside may begin at a Hopf point beyond the end
    corrects = corrects and not is_switched_linear(system)
    search = _Search(system, methods, harmonics, span, lo, corrects, lowest)
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
    inside = [search.certified(c) for c in search.found if c.value <= hi]
    return Criticals(sorted(inside, key=lambda c: c.value), search.evidence, search.undecided)


@dataclass(frozen=True, eq=False)
class _Followed:
    """By one method: what is said of a branch, its folds, whether these are all it has, and the branch itself."""

    said: str
    folds: list[Critical]
    whole: bool
    branches: list[Branch] = field(default_factory=list)


@dataclass(eq=False)
class _Search:
    """The search for folds along branches, and what it has found."""

    system: System
    methods: tuple[str, ...]
    harmonics: int
    span: tuple[float, float]
    low: float
    corrects: bool
    lowest: bool
    found: list[Critical] = field(default_factory=list)
    evidence: list[str] = field(default_factory=list)
    undecided: list[str] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    shifts: dict[Orbit, FoldShift | None] = field(default_factory=dict)
    located: set[Orbit] = field(default_factory=set)
    least: float = float("inf")

    def look_in_groups(self, hopf: list[float]) -> None:
        """Follow the branches to which motions of one group of bodies lead, up to the highest Hopf point."""
        if not self.branches or time_is_over():
            return
        coarse, parameter = HarmonicBalance(ORDERS[0]).equations(self.system), self.branches[0].parameter
        span = (self.span[0], max(hopf))
        for said, cycle in cycles_of_groups(coarse, self.branches, hopf):
            self.evidence.append(said)
            if cycle is None:
                continue
            try:
                branch = trace(coarse, cycle, parameter, span, families=False, stability=False)
                found = [self._solved(special, True) for special in by_value(branch)]
            except FAILURES as error:
                self.undecided.append(f"the branch of {said} was not followed: {error}")
                continue
            self.evidence.append(extent("its branch", branch.values, branch.ends))
            if not complete(branch):
                self.undecided.append(f"the branch of {said} was not followed to its end: {branch.ends[1]}")
            self._add(found, cycle.parameters[parameter])

    def _add(self, folds: list[Critical], begin: float) -> None:
        """Keep folds of a branch that begins at a value: below the interval the minima of one that begins inside."""
        for c in folds:
            inside = c.value >= self.low or (c.extremum == "minimum" and begin >= self.low)
            if inside and not any(coincide(c, other) for other in self.found):
                self.found.append(c)

    @cached_property
    def equations(self) -> Equations:
        """The equations of harmonic balance with which folds are solved for."""
        return HarmonicBalance(self.harmonics).equations(self.system)

    def follow(self, hopf: SpecialPoint) -> None:
        """Follow the branch from a Hopf point by one method after another until one follows all of it."""
        name = f"the branch from the Hopf point at {hopf.parameter} = {hopf.value:.9g}"
        ways = {"exact": self._in_closed_form, "mhb": self._by_harmonics, "collocation": self._by_collocation}
        best: _Followed | None = None
        for method in self.methods:
            if best is not None and time_is_over():
                break
            try:
                got = ways[method](hopf, name)
            except FAILURES as error:
                why = str(error).partition("\n")[0]
                got = _Followed(f"{name} was not followed {BY[method]}: {why}", [], False)
            self.evidence.append(got.said)
            if best is None or got.whole or len(got.folds) > len(best.folds):
                best = got
            if got.whole:
                break
        assert best is not None
        self.undecided += [] if best.whole else [best.said]
        self.branches += best.branches
        self._add(best.folds, hopf.value)

    def _in_closed_form(self, hopf: SpecialPoint, name: str) -> _Followed:
        walk = exact_walk(self.system, hopf, self.span)
        lost = walk.marked("not located") + walk.marked("fold not located")
        folds = [exact_critical(point) for point in walk.marked("fold")]
        said = extent(name, [p.value for p in walk.points], (walk.end,), "in closed form")
        said += "; the order of its contacts was lost on the way" if lost else ""
        branches = [exact_branch(walk, hopf)] if self.system.groups else []
        return _Followed(said, folds, walk.end.complete and not lost, branches)

    def _by_collocation(self, hopf: SpecialPoint, name: str) -> _Followed:
        followed = followed_from(Collocation().equations(self.system), hopf, hopf.parameter, self.span)
        folds = [collocated_critical(special) for special in followed.special(("fold",))]
        values = [*map(float, followed.values), *(c.value for c in folds)]
        said = extent(name, values, followed.ends[1:], "by collocation")
        return _Followed(said, folds, followed.ends[1].complete)

    def _by_harmonics(self, hopf: SpecialPoint, name: str) -> _Followed:
        """Follow the branch with more harmonics where it takes them, and solve for its folds."""
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
            last = orders[-1] == H or time_is_over()
            try:
                folds = [self._solved(special, last) for branch in branches for special in by_value(branch)]
            except ConvergenceError:  # of a fold that these harmonics alone have
                continue
            tail = max(o.tail for branch in branches for o in branch.orbits)
            if all(map(complete, branches)) and tail <= RESOLVED:
                break
        if not branches:
            return _Followed(f"{name} was not followed: {why}", [], False)
        said, lost = "; ".join(extent(name, b.values, b.ends) for b in branches), tail > LOST
        if lost:
            said += f"; {H} harmonics do not resolve all its cycles, whose folds may be others"
        whole = all(map(complete, branches)) and not lost
        if whole and "collocation" in self.methods and any(self._doubt(c) for c in folds):
            said, whole = f"{said}; {self.harmonics} harmonics do not resolve a fold of it", False
        return _Followed(said, folds, whole, branches)

    def _traced(self, hopf: SpecialPoint, H: int) -> list[Branch]:
        return from_hopf(HarmonicBalance(H).equations(self.system), hopf, hopf.parameter, self.span)

    def _solved(self, special: SpecialPoint, last: bool) -> Critical:
        """Return a fold of a branch with its gradient; of the last attempt without one where that does not converge."""
        above = self.least + APART * (self.span[1] - self.span[0])
        if self.lowest and (special.extremum == "maximum" or special.value > above):
            self.located.add(special.orbit)
            return located_fold(special, "it lies above another fold")
        if time_is_over():
            return located_fold(special, "the time limit was reached")
        try:
            solved = fold(self.equations, special, special.parameter, search=last)
        except ConvergenceError as error:
            if not last:
                raise
            return located_fold(special, str(error))
        if solved.extremum == "minimum":
            self.least = min(self.least, solved.value)
        return solved

    def _shift(self, critical: Critical) -> FoldShift | None:
        """Return what the equations of motion tell of a fold where its multipliers meet at 1; computed once."""
        orbit = critical.orbit
        if orbit not in self.shifts:
            try:
                shift = fold_shift(self.system, orbit, critical.parameter)
            except FAILURES:
                shift = None
            self.shifts[orbit] = shift if shift and shift.apart <= MEET else None
        return self.shifts[orbit]

    def _doubt(self, critical: Critical) -> str:
        """Return why a fold may be none."""
        return "" if self._shift(critical) else doubt_at_fold(self.system, critical.orbit)

    def certified(self, critical: Critical) -> Critical:
        """Return a fold of harmonic balance, corrected, with its error, and a status that says where it is doubtful."""
        if critical.kind != "fold" or critical.orbit.kept is None or critical.orbit in self.located:
            return critical
        shift = self._shift(critical) if self.corrects and not time_is_over() else None
        if shift and abs(shift.value) <= SMALL * (self.span[1] - self.span[0]):
            error = abs(shift.value) + ROUND_OFF * abs(critical.value)
            status = f"{critical.status}; corrected by {shift.value:.3g} for what {self.harmonics} harmonics leave out"
            return replace(critical, value=critical.value + shift.value, error=error, status=status)
        critical = with_error(self.system, critical, self.harmonics)
        doubt = "" if time_is_over() else self._doubt(critical)
        return replace(critical, status=f"{critical.status}; {doubt}") if doubt else critical


def by_value(branch: Branch) -> list[SpecialPoint]:
    """Return the folds of a branch in increasing order of their values."""
    return sorted(branch.folds(), key=lambda special: special.value)


def coincide(a: Critical | SpecialPoint, b: Critical | SpecialPoint) -> bool:
    """Tell whether two points are one: of one kind, and the same in value and frequency.

    The frequency at a fold is less certain than its value, much less where the branch is steep, as that of canards.
    """
    pairs: tuple[tuple[Any, Any, float], ...] = (
        (a.value, b.value, SAME),
        (a.omega, b.omega, STEEP if a.kind == "fold" else SAME),
    )
    same = a.kind == b.kind and a.extremum == b.extremum
    return same and all(abs(x - y) <= share * max(abs(x), abs(y)) for x, y, share in pairs)
