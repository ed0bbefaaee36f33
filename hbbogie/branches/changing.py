"""Branches of harmonic balance that go on by collocation where harmonics no longer resolve them, and change back."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.collocated import branch_of, followed_from
from hbbogie.branches.continuation import Progress, balanced_trace
from hbbogie.collocation.method import Collocation
from hbbogie.collocation.special import judged, turning
from hbbogie.collocation.walk import Followed
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results import Branch, Orbit, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import FAILURES

Array = NDArray[np.float64]
UNRESOLVED = 1e-4  # share of the highest harmonics from which collocation goes on
BACK = 0.1  # part of that from which harmonic balance does
PART = 12  # points by collocation after which is asked whether harmonics resolve the cycles again
NOISE = 2.5e-9  # share of the interval by which the parameter varies at least between two folds
CHANGES = 8  # from harmonic balance to collocation and back, to either side


@dataclass(frozen=True, eq=False)
class Changing:
    """Branches by harmonic balance where its harmonics resolve the cycles, else by collocation.

    Each orbit says by its ``method`` what it is by.

    Attributes
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    harmonics : int
    max_points : int
        Of a branch by one method to one side.
    stability : bool
    progress : callable, optional
    """

    system: System
    parameter: str
    interval: tuple[float, float]
    harmonics: int
    max_points: int = 500
    stability: bool = True
    progress: Progress | None = None

    def trace(self, start: Orbit | SpecialPoint) -> Branch:
        """Follow the branch from a start; errors as of `hbbogie.trace`."""
        whole = turned(self._ahead(turned(self._ahead(self._balanced(start)))))
        noise = NOISE * (self.interval[1] - self.interval[0])
        return replace(whole, special=tuple(turning(list(whole.special), whole.values, noise)))

    def _balanced(self, start: Orbit | SpecialPoint) -> Branch:
        options: dict[str, Any] = {"max_points": self.max_points, "stability": self.stability}
        equations = HarmonicBalance(self.harmonics).equations(self.system)
        options |= {"progress": self.progress, "unresolved": UNRESOLVED}
        return balanced_trace(equations, start, self.parameter, self.interval, **options)

    def _ahead(self, branch: Branch) -> Branch:
        """Return a branch that goes on behind its end for as long as one of the methods leads on."""
        for _ in range(CHANGES):
            if branch.ends[1].kind != "unresolved" or len(branch.orbits) < 2:
                break
            kept = max((i for i, o in enumerate(branch.orbits) if o.tail <= BACK * UNRESOLVED), default=len(branch) - 1)
            try:
                branch = first_part(branch, max(kept, 1))
                branch = joined(branch, self._collocated(*branch.orbits[-2:]))
            except FAILURES as error:
                end = branch.ends[1]
                why = f"{end.what}, and collocation does not go on: {str(error).partition(chr(10))[0]}"
                return replace(branch, ends=(branch.ends[0], replace(end, what=why)))
            if branch.ends[1].kind != "points":
                break
            before, last = branch.orbits[-2:]
            with suppress(*FAILURES):
                there = self._balanced(self._series(last))
                branch = joined(branch, _away(there, last, before))
        return branch

    def _collocated(self, before: Orbit, last: Orbit) -> Branch:
        """Return how a branch goes on by collocation, until harmonics resolve its cycles again or it ends."""
        equations, found, room = Collocation().equations(self.system), list[Followed](), self.max_points
        start = last
        while not found or (found[-1].ends[1].kind == "points" and room > 1 and not self._resolved(last)):
            options: dict[str, Any] = {"max_points": min(PART, room), "progress": self.progress}
            found.append(followed_from(equations, last, self.parameter, self.interval, before=before, **options))
            *_, (curve, point), end = found[-1].points()
            before, last = judged(curve, point).orbit(), judged(*end).orbit()
            room -= len(found[-1].values)
        stretches = [stretch for followed in found for stretch in followed.stretches]
        # which of its folds are noise is told by the whole branch
        whole = Followed(stretches, 0, (found[0].ends[0], found[-1].ends[1]), 0.0)
        return branch_of(whole, self.system, start, stability=self.stability)

    def _series(self, orbit: Orbit) -> Orbit:
        return orbit.replace(coefficients=orbit.harmonics(self.harmonics))

    def _resolved(self, orbit: Orbit) -> bool:
        return self._series(orbit).tail <= BACK * UNRESOLVED


def turned(branch: Branch) -> Branch:
    """Return a branch in the opposite order."""
    return replace(branch, orbits=branch.orbits[::-1], special=branch.special[::-1], ends=branch.ends[::-1])


def joined(branch: Branch, beyond: Branch) -> Branch:
    """Return a branch and another that begins at its last cycle."""
    orbits = (*branch.orbits, *beyond.orbits[1:])
    kept = tuple(s for s in beyond.special if s.orbit is not beyond.orbits[0])
    return Branch(orbits, branch.parameter, (*branch.special, *kept), (branch.ends[0], beyond.ends[1]))


def first_part(branch: Branch, last: int) -> Branch:
    """Return a branch up to one of its cycles."""
    orbits = branch.orbits[: last + 1]
    kept = {id(o) for o in orbits}
    return replace(branch, orbits=orbits, special=tuple(s for s in branch.special if id(s.orbit) in kept))


def _away(branch: Branch, start: Orbit, before: Orbit) -> Branch:
    """Return the part of a branch from the cycle next to its start on that leads away from another cycle."""
    marks = np.array([_mark(o, branch.parameter) for o in (*branch.orbits, start, before)])
    marks /= np.maximum(np.ptp(marks, axis=0), np.finfo(float).tiny)
    k = int(np.argmin(np.linalg.norm(marks[:-2] - marks[-2], axis=1)))
    way = marks[k] - marks[-1]
    onward = (marks[min(k + 1, len(marks) - 3)] - marks[k]) @ way, (marks[max(k - 1, 0)] - marks[k]) @ way
    if onward[1] > onward[0]:
        branch, k = turned(branch), len(branch.orbits) - 1 - k
    kept = {id(o) for o in branch.orbits[k:]}
    special = tuple(s for s in branch.special if id(s.orbit) in kept)
    return Branch(branch.orbits[k:], branch.parameter, special, (Ending("began", "began here"), branch.ends[1]))


def _mark(orbit: Orbit, parameter: str) -> Array:
    return np.array([orbit.parameters[parameter], orbit.omega, *(orbit.amplitude(c) for c in orbit.coordinates)])
