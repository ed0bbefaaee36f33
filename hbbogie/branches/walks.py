"""Branches followed for a census: in closed form, by harmonic balance or by collocation, whichever comes to an end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
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
from hbbogie.branches.collocated import collocated_forks, followed_from
from hbbogie.branches.continuation import balanced_trace
from hbbogie.branches.crossing import crossings, extent, from_hopf
from hbbogie.branches.relaxation import solved
from hbbogie.branches.same import alike, once_each, samples
from hbbogie.collocation.method import Collocation
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.special import judged
from hbbogie.deadline import time_is_over
from hbbogie.errors import ModelError
from hbbogie.exact.walk import Walk
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.system import System
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve

COARSE, FINER = 15, 31  # highest harmonics with which branches are followed
MOST = 120  # points of a branch from a cycle, to either side
MOST_HARMONICS = 63  # with which a branch of several times the period is followed
# cycles at the value are solved for again, and folds are not asked for
COARSELY: dict[str, Any] = {"tolerance": 1e-7, "doubts": False}
FOLLOWED: dict[str, Any] = {"families": False, "stability": False, "max_points": MOST, **COARSELY}
UNRESOLVED = 1e-2  # share of the highest harmonics, or of those left out, beyond which cycles are not resolved
MESH_ERROR = 1e-6  # with which branches are followed by collocation; the cycles at the value are solved for again
WORK = 32_000  # intervals of all points, to either side, times states
FINE = 0.1  # share of that in the cycle away from which collocation goes on
MOST_TURNS = 3  # of a cycle that is followed by collocation: chaotic motions lead to ever longer ones
MOST_COLLOCATED, MOST_BEYOND = 60, 200  # the same by collocation, and of a branch that goes on by it
RESTS = 1e-9  # size of a motion, relative to the largest coordinate, that is round-off
LIKE = 0.05  # distance up to which a cycle of the branch is the one from which it was followed
CROSSED = 1e-6  # share of the interval up to which a special point is the one where a branch began
VANISHED = 1e-4  # share of the interval by which a small cycle is off its Hopf point
NEAR = 1e-2  # the same of its frequency and place
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
    vanishing : tuple of Orbit
        Small cycles with which the branch ends at other Hopf points.
    """

    said: str
    complete: bool
    cycles: list[Orbit]
    forks: Callable[[], list[SpecialPoint]] = list
    vanishing: tuple[Orbit, ...] = ()

    def reaches(self, hopf: SpecialPoint, width: float) -> bool:
        """Tell whether the branch ends at a Hopf point; ``width`` is that of the interval of the parameter."""
        for small in self.vanishing:
            off = abs(small.parameters[hopf.parameter] - hopf.value) / width, abs(small.omega / hopf.omega - 1)
            mean, place = small.coefficients[0], hopf.orbit.coefficients[0]
            if off[0] <= VANISHED and off[1] <= NEAR and np.allclose(mean, place, NEAR, NEAR * np.abs(place).max()):
                return True
        return False


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

    @cached_property
    def _unresolved(self) -> float:
        """Share of the highest harmonics beyond which collocation takes over, where it applies."""
        try:
            Rates(self.system, self.parameter)
        except ModelError:
            return np.inf
        held = conserved_quantities(self.system, self.system.vector(), np.ones(self.system.n_states))
        return np.inf if len(held) else UNRESOLVED

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
            branches = from_hopf(equations, hopf, self.parameter, self.span, self._unresolved, **COARSELY)
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
            options = {**FOLLOWED, "unresolved": self._unresolved}
            branch = balanced_trace(equations, fork, self.parameter, self.span, **options)
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
            options = {**FOLLOWED, "unresolved": self._unresolved}
            branch = balanced_trace(equations, start, self.parameter, self.span, **options)
            return self._balanced(equations, branch, name, [])

        return attempt

    def _balanced(self, equations: Equations, branch: Branch, name: str, cycles: list[Orbit]) -> Walked:
        """Return a branch of harmonic balance, followed on by collocation from where its cycles are not resolved."""
        cycles = once_each([*cycles, *crossings(equations, branch, self.value)])
        ends = zip(branch.ends, (branch.orbits[0], branch.orbits[-1]), strict=True)
        small = [orbit for end, orbit in ends if end.kind == "vanishes"]
        said, others = extent(name, branch.values, branch.ends), list[Walked]()
        whole = all(e.complete or e.kind == "unresolved" for e in branch.ends)
        for end, orbits in zip(branch.ends, (branch.orbits, branch.orbits[::-1]), strict=True):
            where = f"its cycles near {self.parameter} = {orbits[0].parameters[self.parameter]:.6g} are not resolved"
            if end.kind == "unresolved" and len(orbits) > 1:
                try:
                    before = next((o for o in orbits[1:] if o.tail <= FINE * UNRESOLVED), orbits[-1])
                    others.append(self._collocated(orbits[0], "it", before))
                except FAILURES:
                    said, whole = f"{said}; {where}", False
            elif end.kind == "unresolved" or self._astray(orbits):
                said, whole = f"{said}; {where}", False
        said, whole = "; ".join([said, *(o.said for o in others)]), whole and all(o.complete for o in others)
        cycles += [cycle for other in others for cycle in other.cycles]
        small += [orbit for other in others for orbit in other.vanishing]

        def found() -> list[SpecialPoint]:
            return [*forks_of(equations, branch, self.span), *(fork for other in others for fork in other.forks())]

        return Walked(said, whole, cycles, found, tuple(small))

    def _astray(self, orbits: Sequence[Orbit]) -> bool:
        """Tell whether the first of the cycles, near the value, are not resolved."""
        k = next((i for i, o in enumerate(orbits) if o.tail <= UNRESOLVED), 0)
        values, room = [o.parameters[self.parameter] for o in orbits[: k + 1]], BESIDE * (self.span[1] - self.span[0])
        return bool(k) and min(values) - room <= self.value <= max(values) + room

    def _collocated(self, start: Orbit | SpecialPoint, name: str, before: Orbit | None = None) -> Walked:
        """Follow the branch of a cycle by collocation, in both directions or away from the cycle before it."""
        if isinstance(start, Orbit) and (turns := _turns(start)) > MOST_TURNS:
            raise ConvergenceError(f"it goes round {turns} times in a period, in which there may be many more like it")
        equations = Collocation(tolerance=MESH_ERROR).equations(self.system)
        most = MOST_COLLOCATED if before is None else MOST_BEYOND
        limits: dict[str, Any] = {"max_points": most, "work": WORK / self.system.n_states}
        followed = followed_from(equations, start, self.parameter, self.span, before=before, **limits)
        met = [cycle for _, cycle in followed.crossings(self.value)]
        cycles = [(solved(self.system, cycle) or cycle).orbit() for cycle in met]
        said = extent(f"{name}, by collocation,", followed.values, followed.ends)
        points = list(followed.points())
        ends = zip(followed.ends, (points[0], points[-1]), strict=True)
        small = tuple(judged(*point).orbit() for end, point in ends if end.kind == "vanishes")
        whole = all(end.complete for end in followed.ends)
        return Walked(said, whole, cycles, lambda: collocated_forks(followed, self.system), small)


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
