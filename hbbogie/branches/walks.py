"""Branches followed for a census: in closed form, by harmonic balance or by collocation, whichever comes to an end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from hbbogie.branches.bifurcations import forks_of
from hbbogie.branches.closed_form import (
    exact_crossings,
    exact_forks,
    exact_walk,
    exact_walk_beyond,
    exact_walk_through,
)
from hbbogie.branches.collocated import branch_of, collocated_forks, followed_from
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import complete, crossings, extent, from_hopf
from hbbogie.branches.same import alike, once_each, samples
from hbbogie.collocation.method import Collocation
from hbbogie.deadline import time_is_over
from hbbogie.exact.walk import Walk
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve

COARSE, FINER = 15, 31  # highest harmonics with which branches are followed
MOST = 120  # points of a branch from a cycle, to either side
MOST_HARMONICS = 63  # with which a branch of several times the period is followed
FOLLOWED: dict[str, Any] = {"families": False, "stability": False, "max_points": MOST}
UNRESOLVED = 1e-2  # share of the highest harmonics, or of those left out, beyond which cycles are not resolved
MOST_TURNS = 3  # of a cycle that is followed by collocation: chaotic motions lead to ever longer ones
MOST_COLLOCATED = 60  # the same by collocation
RESTS = 1e-9  # size of a motion, relative to the largest coordinate, that is round-off
LIKE = 0.05  # distance up to which a cycle of the branch is the one from which it was followed
CROSSED = 1e-6  # share of the interval up to which a special point is the one where a branch began
SAME = 1e-8  # share of the interval up to which values of the parameter are one
BESIDE = 0.01  # share of the interval beside cycles that are not resolved in which others are looked for


@dataclass(frozen=True, eq=False)
class Walked:
    """A branch that was followed.

    Attributes
    ----------
    said : str
        How far it was followed and why it ended, a sentence.
    complete : bool
        Whether it was followed to its ends.
    cycles : list of Orbit
        Those at the value asked for: candidates that are yet to be polished, unless they are exact.
    forks : callable
        Gives the special points at which other branches begin or cross, each with a first guess beyond if there is one.
    """

    said: str
    complete: bool
    cycles: list[Orbit]
    forks: Callable[[], list[SpecialPoint]] = list


@dataclass(frozen=True, eq=False)
class Walker:
    """What all branches of a census have in common."""

    system: System
    parameter: str
    span: tuple[float, float]

    @property
    def value(self) -> float:
        """The value of the parameter at which cycles are wanted."""
        return self.system.values[self.parameter]

    def from_hopf(self, hopf: SpecialPoint, name: str) -> Iterator[Walked]:
        """Follow the branch from a Hopf point, and those that leave it where it is a family at one value."""
        try:
            exact = self._exact(exact_walk(self.system, hopf, self.span), name)
        except FAILURES:
            exact = None
        if exact is not None and exact.complete:
            yield exact
            return
        equations = HarmonicBalance(COARSE).equations(self.system)
        try:
            branches = from_hopf(equations, hopf, self.parameter, self.span)
        except FAILURES as error:
            yield Walked(f"{name} was not followed: {error}", False, [])
            return
        for k, branch in enumerate(branches):
            before = [] if k else _before(equations, hopf, branch.orbits[0], self.value)
            leaving = f"{name}, left where another one crosses it," if k else name
            walked = self._balanced(equations, branch, leaving, before)
            yield replace(walked, forks=partial(self._away_from, hopf, walked.forks)) if k else walked

    def _away_from(self, start: SpecialPoint, forks: Callable[[], list[SpecialPoint]]) -> list[SpecialPoint]:
        """Return special points but those at the value of the one where the branch began."""
        return [fork for fork in forks() if abs(fork.value - start.value) > CROSSED * (self.span[1] - self.span[0])]

    def through(self, orbit: Orbit, name: str) -> Walked:
        """Follow the branch of a cycle at the value, in both directions; tell where it does not lead through that."""
        best, why = None, "no method leads from it to a branch"
        balances = (self._through_balance(H) for H in (COARSE, FINER))
        for attempt in (self._through_exact, *balances, self._collocated):
            if time_is_over():
                why = "the time limit was reached"
                break
            if best is not None and attempt == self._collocated:  # a last resort, which takes long
                break
            try:
                walked = attempt(orbit, name)
            except FAILURES as error:
                why = str(error).partition("\n")[0]
                continue
            if walked is None or not any(alike(orbit, other, LIKE) for other in walked.cycles):
                continue
            best = walked
            if walked.complete:
                break
        return best or Walked(f"{name} was not followed: {why}", False, [])

    def beyond(self, fork: SpecialPoint, name: str) -> Walked:
        """Follow the branch that begins at a special point, or crosses there."""
        ahead = fork.onward
        try:
            if ahead is None:
                raise ConvergenceError("no first cycle beyond it is known")
            if (turns := _turns(ahead)) > MOST_TURNS:
                raise ConvergenceError(f"its cycles go round {turns} times in a period")
            if ahead.method.startswith("exact"):
                walked = self._exact(exact_walk_beyond(self.system, fork, self.span), name)
                if walked is None:
                    raise ConvergenceError(f"{self.parameter} does not vary along it")
                return walked
            if ahead.method.startswith("collocation"):
                return self._collocated(fork, name)
            if ahead.H > MOST_HARMONICS:
                raise ConvergenceError(f"its cycles take more than {MOST_HARMONICS} harmonics")
            equations = HarmonicBalance(ahead.H, odd=None if ahead.is_odd(0.0) else False).equations(self.system)
            branch = trace(equations, fork, self.parameter, self.span, **FOLLOWED)
            walked = self._balanced(equations, branch, name, [])
            return replace(walked, forks=partial(self._away_from, fork, walked.forks))
        except FAILURES as error:
            return Walked(f"{name} was not followed: {str(error).partition(chr(10))[0]}", False, [])

    def _exact(self, walk: Walk, name: str) -> Walked | None:
        """Return an exact branch; None where the parameter does not vary along it."""
        values = [point.value for point in walk.points]
        low, high = min(values), max(values)
        if high - low <= SAME * (self.span[1] - self.span[0]):
            return None
        lost = walk.marked("not located") + walk.marked("fold not located")
        said = extent(name, values, (walk.beginning, walk.end), "in closed form")
        whole = not lost and walk.end.complete and walk.beginning.complete
        cycles = [orbit for _, orbit in exact_crossings(walk, self.value)]
        return Walked(said, whole, cycles, lambda: exact_forks(walk, self.parameter))

    def _through_exact(self, orbit: Orbit, name: str) -> Walked | None:
        return self._exact(exact_walk_through(self.system, orbit, self.parameter, self.span), name)

    def _through_balance(self, H: int) -> Callable[[Orbit, str], Walked | None]:
        def attempt(orbit: Orbit, name: str) -> Walked | None:
            if _beyond(orbit, H) > UNRESOLVED:
                return None
            equations = HarmonicBalance(H).equations(self.system)
            start = solve(equations, orbit, method="newton")  # where that fails more harmonics do, or collocation
            return self._balanced(equations, trace(equations, start, self.parameter, self.span, **FOLLOWED), name, [])

        return attempt

    def _balanced(self, equations: Equations, branch: Branch, name: str, cycles: list[Orbit]) -> Walked:
        """Return a branch of harmonic balance; where its cycles are not resolved they are those of collocation."""
        cycles = once_each([*cycles, *crossings(equations, branch, self.value)])
        said, whole = extent(name, branch.values, branch.ends), complete(branch)
        room, others = BESIDE * (self.span[1] - self.span[0]), list[Walked]()
        for orbits in (branch.orbits, branch.orbits[::-1]):
            k = next((i for i, o in enumerate(orbits) if o.tail <= UNRESOLVED), 0)
            values = [o.parameters[self.parameter] for o in orbits[: k + 1]]
            part = max(self.span[0], min(values) - room), min(self.span[1], max(values) + room)
            if not k or not part[0] <= self.value <= part[1]:
                continue
            try:
                others.append(replace(self, span=part)._collocated(orbits[k], name))
            except FAILURES:
                said, whole = f"{said}; its cycles near {self.parameter} = {values[0]:.6g} are not resolved", False
        cycles += [cycle for other in others for cycle in other.cycles]

        def found() -> list[SpecialPoint]:
            return [*forks_of(equations, branch, self.span), *(fork for other in others for fork in other.forks())]

        return Walked(said, whole, cycles, found)

    def _collocated(self, start: Orbit | SpecialPoint, name: str) -> Walked:
        if isinstance(start, Orbit) and (turns := _turns(start)) > MOST_TURNS:
            raise ConvergenceError(f"it goes round {turns} times in a period, in which there may be many more like it")
        equations = Collocation().equations(self.system)
        followed = followed_from(equations, start, self.parameter, self.span, max_points=MOST_COLLOCATED)
        branch = branch_of(followed, self.system, start, stability=False)
        cycles = [cycle.orbit() for _, cycle in followed.crossings(self.value)]
        said = extent(f"{name}, by collocation,", branch.values, branch.ends)
        return Walked(said, complete(branch), cycles, lambda: collocated_forks(followed, self.system))


def _turns(orbit: Orbit) -> int:
    """Return how many times a period some coordinate rises through its mean."""
    q = samples(orbit)
    above = q > orbit.coefficients[0] + RESTS * np.abs(q).max()
    return int((above & ~np.roll(above, 1, axis=0)).sum(axis=0).max())


def _beyond(orbit: Orbit, H: int) -> float:
    """Return the largest coefficient of the harmonics above H, relative to the largest of all."""
    waves = np.abs(orbit.coefficients[1:])
    return float(waves[2 * H :].max(initial=0.0) / waves.max())


def _before(equations: Equations, hopf: SpecialPoint, first: Orbit, value: float) -> list[Orbit]:
    """Return the cycle at a value between a Hopf point and the first cycle computed of its branch, if there is one."""
    width = first.parameters[hopf.parameter] - hopf.value
    share = (value - hopf.value) / width if width else 0.0
    if not 0 < share < 1:
        return []
    c = np.sqrt(share) * first.coefficients  # the parameter goes with the square of the amplitude
    c[0] = hopf.orbit.coefficients[0] + share * (first.coefficients[0] - hopf.orbit.coefficients[0])
    try:
        at: dict[str, Any] = {hopf.parameter: value}
        return [solve(equations, first.replace(coefficients=c), method="newton", **at)]
    except ConvergenceError:
        return []
