"""Branches followed for a census: in closed form, by harmonic balance or by collocation, whichever comes to an end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hbbogie.branches.closed_form import exact_crossings, exact_walk, exact_walk_through
from hbbogie.branches.collocated import branch_of, followed_from
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings, extent, from_hopf
from hbbogie.branches.same import alike, once_each
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
MOST = 200  # points of a branch from a cycle, to either side
UNRESOLVED = 1e-2  # share of the harmonics left out with which a branch is not followed
LIKE = 0.05  # distance up to which a cycle of the branch is the one from which it was followed
SAME = 1e-8  # share of the interval up to which values of the parameter are one
BESIDE = 0.01  # share of the interval beside a homoclinic motion in which cycles are looked for by collocation


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
    """

    said: str
    complete: bool
    cycles: list[Orbit]


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
            yield self._balanced(equations, branch, leaving, before)

    def through(self, orbit: Orbit, name: str) -> Walked:
        """Follow the branch of a cycle at the value, in both directions; tell where it does not lead through that."""
        best, why = None, "no method leads from it to a branch"
        for attempt in (
            self._through_exact,
            self._through_balance(COARSE),
            self._through_balance(FINER),
            self._collocated,
        ):
            if time_is_over():
                why = "the time limit was reached"
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

    def _exact(self, walk: Walk, name: str) -> Walked | None:
        """Return an exact branch; None where the parameter does not vary along it."""
        values = [point.value for point in walk.points]
        low, high = min(values), max(values)
        if high - low <= SAME * (self.span[1] - self.span[0]):
            return None
        lost = walk.marked("not located") + walk.marked("fold not located")
        ends = str(walk.end) if walk.beginning.kind == "began" else f"{walk.beginning}; {walk.end}"
        said = f"{name} was followed in closed form from {low:.6g} to {high:.6g}: {ends}"
        complete = not lost and walk.end.complete and walk.beginning.complete
        return Walked(said, complete, [orbit for _, orbit in exact_crossings(walk, self.value)])

    def _through_exact(self, orbit: Orbit, name: str) -> Walked | None:
        return self._exact(exact_walk_through(self.system, orbit, self.parameter, self.span), name)

    def _through_balance(self, H: int) -> Callable[[Orbit, str], Walked | None]:
        def attempt(orbit: Orbit, name: str) -> Walked | None:
            if _beyond(orbit, H) > UNRESOLVED:
                return None
            equations = HarmonicBalance(H).equations(self.system)
            options: dict[str, Any] = {"families": False, "stability": False, "max_points": MOST}
            return self._balanced(equations, trace(equations, orbit, self.parameter, self.span, **options), name, [])

        return attempt

    def _balanced(self, equations: Equations, branch: Branch, name: str, cycles: list[Orbit]) -> Walked:
        """Return a branch of harmonic balance; beside a homoclinic motion its cycles are those of collocation."""
        cycles = once_each([*cycles, *crossings(equations, branch, self.value)])
        near = BESIDE * (self.span[1] - self.span[0])
        for end, last in zip(branch.ends, (branch.orbits[0], branch.orbits[-1]), strict=True):
            if end.kind == "homoclinic" and abs(last.parameters[self.parameter] - self.value) <= near:
                at = last.parameters[self.parameter]
                part = max(self.span[0], at - 2 * near), min(self.span[1], at + 2 * near)
                try:
                    cycles += replace(self, span=part)._collocated(last, name).cycles
                except FAILURES:
                    continue
        return Walked(extent(name, branch), all(end.complete for end in branch.ends), cycles)

    def _collocated(self, orbit: Orbit, name: str) -> Walked:
        equations = Collocation().equations(self.system)
        followed = followed_from(equations, orbit, self.parameter, self.span, max_points=MOST)
        branch = branch_of(followed, self.system, orbit, stability=False)
        cycles = [cycle.orbit() for _, cycle in followed.crossings(self.value)]
        return Walked(extent(f"{name}, by collocation,", branch), all(end.complete for end in branch.ends), cycles)


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
