"""The search for folds along the branches from Hopf points, and along those to which motions lead."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from hbbogie.branches.closed_form import exact_branch, exact_critical, exact_walk
from hbbogie.branches.collocated import collocated_critical, followed_from
from hbbogie.branches.continuation import balanced_trace
from hbbogie.branches.crossing import complete, extent, from_hopf
from hbbogie.branches.resolution import MEET, doubt_at_fold
from hbbogie.collocation.method import Collocation
from hbbogie.critical.coupled import census_below, left_out
from hbbogie.critical.folds import fold, located_fold
from hbbogie.critical.groups import cycles_of_groups
from hbbogie.critical.harmonic_error import ROUND_OFF, with_error
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.census import Start
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.results.branch import Branch, SpecialPoint
from hbbogie.results.critical import Critical
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.stability.fold_defect import FoldShift, fold_shift

SAME = 1e-7  # relative distance in value and frequency below which two points are one
STEEP = 1e-3  # the same in frequency, of two folds
BY = {"exact": "in closed form", "mhb": "by harmonic balance", "collocation": "by collocation"}
ORDERS = (9, 21)  # highest harmonics with which a branch is followed, tried in turn
APART = 0.01  # share of the interval by which a fold must lie above another one to stay so with more harmonics
SMALL = 1e-3  # share of the interval up to which what harmonics leave out is corrected for, by which a fold is shifted
# branches only lead to their folds, each of which is solved for again, and whose multipliers then tell of doubts
COARSELY: dict[str, Any] = {"tolerance": 1e-7, "doubts": False, "max_points": 1000}
RESOLVED, LOST = 0.02, 0.1  # shares of the highest harmonics up to which a branch needs no more, and tells anything


@dataclass(frozen=True, eq=False)
class _Followed:
    """By one method: what is said of a branch, its folds, whether these are all it has, and the branch itself."""

    said: str
    folds: list[Critical]
    whole: bool
    branches: list[Branch] = field(default_factory=list)


@dataclass(eq=False)
class Search:
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
        """Follow the branches to which motions of groups of bodies lead, up to the highest Hopf point."""
        if not self.branches or time_is_over():
            return
        coarse, parameter = HarmonicBalance(ORDERS[0]).equations(self.system), self.branches[0].parameter
        span = (self.span[0], max(hopf))
        for said, cycle in cycles_of_groups(coarse, self.branches, hopf):
            self.evidence.append(said)
            if cycle is None:
                continue
            try:
                branch = balanced_trace(coarse, cycle, parameter, span, families=False, stability=False, **COARSELY)
                found = [self._solved(special, True) for special in by_value(branch)]
            except FAILURES as error:
                self.undecided.append(f"the branch of {said} was not followed: {error}")
                continue
            self.evidence.append(extent("its branch", branch.values, branch.ends))
            if why := branch.unfinished:
                self.undecided.append(f"the branch of {said} was not followed to its ends: {why}")
            self.branches.append(branch)
            self._add(found, cycle.parameters[parameter])

    def follow_motions(self, parameter: str, hopf: list[float], start: Start | None) -> None:
        """Follow the branches of cycles to which motions of many groups lead, down to their folds and back up."""
        census = census_below(self.system, parameter, (self.span[0], min(hopf)), self.low, start)
        self.evidence += census.evidence
        coarse, folds = HarmonicBalance(ORDERS[0]).equations(census.system), list[SpecialPoint]()
        for cycle in census.found:
            name = f"the branch of the cycle in which {moving_groups(census.system, cycle)} move"
            try:
                span = self.span[0], census.value
                branch = balanced_trace(coarse, cycle, parameter, span, families=False, stability=False, **COARSELY)
            except FAILURES as error:
                self.undecided.append(f"{name} was not followed: {error}")
                continue
            self.evidence.append(extent(name, branch.values, branch.ends))
            if why := branch.unfinished:
                self.undecided.append(f"{name} was not followed to its ends: {why}")
            self.branches.append(branch)
            folds += branch.folds()
        self.lowest = True  # each fold that is solved for takes long
        folds.sort(key=lambda special: special.value)
        self._add([self._solved(special, True) for special in folds], census.value)
        self.undecided.append(left_out(self.system, len(hopf), census.value, parameter))

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
        return from_hopf(HarmonicBalance(H).equations(self.system), hopf, hopf.parameter, self.span, **COARSELY)

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
            if abs(solved.value - special.value) > APART * (self.span[1] - self.span[0]):
                raise ConvergenceError(f"Newton's method led to another fold, {solved.value:.6g}")
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

    def certified(self) -> list[Critical]:
        """Return what was found in increasing order of the value, each as `_certified`.

        Where only the lowest is asked for, folds stay as they are above which no correction leads it.
        """
        done, least, reach = list[Critical](), np.inf, SMALL * (self.span[1] - self.span[0])
        for c in sorted(self.found, key=lambda c: c.value):
            if c.kind == "fold" and not (self.lowest and c.value > least + reach):
                c = self._certified(c)
                least = min(least, c.value)
            done.append(c)
        return sorted(done, key=lambda c: c.value)

    def _certified(self, critical: Critical) -> Critical:
        """Return a fold of harmonic balance, corrected, with its error, and a status that says where it is doubtful."""
        if critical.orbit.kept is None or critical.orbit in self.located:
            return critical
        shift = self._shift(critical) if self.corrects and not time_is_over() else None
        if shift and abs(shift.value) <= SMALL * (self.span[1] - self.span[0]):
            error = abs(shift.value) + ROUND_OFF * abs(critical.value)
            status = f"{critical.status}; corrected by {shift.value:.3g} for what {self.harmonics} harmonics leave out"
            status += "; the cycles next to it are all unstable" if shift.unstable else ""
            return replace(critical, value=critical.value + shift.value, error=error, status=status, apart=shift.apart)
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
