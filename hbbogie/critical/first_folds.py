"""Curves of folds from where they begin: on the branch from a Hopf point, by each method that follows such curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.closed_form import exact_walk
from hbbogie.branches.continuation import trace
from hbbogie.critical.exact_fold_curve import ExactFoldCurve
from hbbogie.critical.fold_curve import FoldCurve
from hbbogie.critical.following import Followed, Test, both_ways, follow, plane, unresolved
from hbbogie.exact.points import Point as ExactPoint
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.progress import Progress
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
Fold = SpecialPoint | ExactPoint
POINTS = 200  # of a branch in search of folds: enough for cycles many gaps large
NEAR = 0.03  # of the chart's width and height: how far a curve of folds may stop from its end on a Hopf curve
TESTS: dict[str, Test] = {
    "cusp": lambda state, point: state.bend,
    "turning point": lambda state, point: state.first,
}


@dataclass(frozen=True, eq=False)
class FoldSearch:
    """The search for folds, and for their curves, in a chart.

    Attributes
    ----------
    system : System
    names : (str, str)
        Both parameters of the chart.
    span, interval : (float, float), units of the parameters
    harmonics : int
    methods : sequence of {"exact", "mhb"}
        Tried in turn, for as long as one does not find all folds of a branch.
    longest : float
        Longest step along a curve.
    onsets : tuple of (ndarray, shape (3,), and float)
        Frequency, both parameters and slope where the onset changes along a curve of Hopf points.
    """

    system: System
    names: tuple[str, str]
    span: tuple[float, float]
    interval: tuple[float, float]
    harmonics: int
    methods: Sequence[str]
    longest: float
    onsets: tuple[tuple[Array, float], ...] = ()

    def equations(self, value: float) -> Equations:
        """Return the equations of harmonic balance at a value of the second parameter."""
        return HarmonicBalance(self.harmonics).equations(self.system.with_parameters(**{self.names[1]: value}))

    def on_branch(self, hopf: SpecialPoint, value: float) -> tuple[list[Fold], str]:
        """Return the folds of a branch, and why there may be more; nothing where all are found.

        Parameters
        ----------
        hopf : SpecialPoint
            Where the branch begins.
        value : float, unit of the second parameter
        """
        found, why = list[Fold](), ""
        for method in self.methods:
            try:
                folds, why = (self._exact if method == "exact" else self._harmonic)(hopf, value)
            except FAILURES as error:
                why = f": {error}"
                continue
            found += folds
            if not why:
                break
        return found, why

    def _exact(self, hopf: SpecialPoint, value: float) -> tuple[Sequence[Fold], str]:
        walk = exact_walk(self.system.with_parameters(**{self.names[1]: value}), hopf, self.span, POINTS)
        why = "" if walk.end.complete else f" was not followed to its end: {walk.end}."
        if not why and (walk.marked("fold not located") or walk.marked("not located")):
            why = " changes the order of its contacts in a way that was not resolved."
        return walk.marked("fold"), why

    def _harmonic(self, hopf: SpecialPoint, value: float) -> tuple[Sequence[Fold], str]:
        equations, name = self.equations(value), self.names[0]
        branch = trace(equations, hopf, name, self.span, families=False, stability=False, max_points=POINTS)
        cut = branch.ends[1].kind == "points"
        why = f" was cut off after {POINTS} points: folds farther along it are not found." if cut else ""
        return branch.folds(), why

    def begin(self, fold: Fold, value: float) -> tuple[FoldCurve | ExactFoldCurve, Point]:
        """Return the curve through a fold, and its first point; raise `ConvergenceError` where it is not found."""
        if isinstance(fold, ExactPoint):
            curve = ExactFoldCurve(self.names, self.span, self.interval, fold)
            if (first := curve.first()) is None:
                raise ConvergenceError("no curve of folds in closed form begins there.")
            return curve, first
        equations = self.equations(value)
        p = equations.system.vector(**{self.names[0]: fold.value})
        led = _led_by_largest(equations.phased(fold.orbit), fold.orbit)
        harmonic = FoldCurve(led, self.names, self.span, self.interval, p)
        return harmonic, harmonic.first(fold.orbit)

    def curve(self, fold: Fold, value: float) -> tuple[Followed, str]:
        """Return the curve through a fold, followed both ways, and a sentence about folds of it that are not resolved.

        Raises
        ------
        ConvergenceError
            Where it cannot be begun.
        """
        curve, first = self.begin(fold, value)
        found = both_ways(first, lambda start: self._pieces(curve, start))
        return found, unresolved(found, self.names[1])

    def _pieces(self, curve: FoldCurve | ExactFoldCurve, start: Point) -> list[Followed]:
        """Follow a curve of folds one way, across grazing contacts and other changes of their order."""
        pieces = [follow(curve, start, TESTS, (), self.longest)]
        while len(pieces) <= curve.corners:
            curve, last = pieces[-1].curves[-1], pieces[-1].points[-1]
            stuck = pieces[-1].ends[1].kind == "stuck" and self.onset_near(plane(curve, last)) is None
            if not stuck or (found := curve.beyond(last)) is None:
                break
            pieces.append(follow(found[0], found[1], TESTS, (), self.longest))
        return pieces

    def onset_near(self, here: Array) -> tuple[Array, float] | None:
        """Return (omega, both parameters) and slope of the onset's change that is near a point, or None."""
        reach = NEAR * np.array([here[0], self.span[1] - self.span[0], self.interval[1] - self.interval[0]])
        return next((onset for onset in self.onsets if (np.abs(onset[0] - here) <= reach).all()), None)


def folds_of(search: FoldSearch, hopf: SpecialPoint, value: float, progress: Progress) -> tuple[list[Any], str]:
    """Return what `FoldSearch.on_branch` does."""
    return search.on_branch(hopf, value)


def curve_of(
    search: FoldSearch, fold: Fold, value: float, apart: bool, progress: Progress
) -> tuple[Followed, str] | str:
    """Return what `FoldSearch.curve` does, or why there is none; ``apart`` without the curve of harmonic balance.

    Its equations take longer to send than to build: `with_curve` adds it.
    """
    try:
        found, said = search.curve(fold, value)
    except FAILURES as error:
        return str(error)
    if apart and not isinstance(fold, ExactPoint):
        marks = [(kind, point, state, None) for kind, point, state, _ in found.marks]
        found = replace(found, curves=[None] * len(found.curves), marks=marks)
    return found, said


def with_curve(search: FoldSearch, fold: Fold, value: float, found: Followed) -> Followed:
    """Return a curve that came from another process without its equations, with them."""
    if found.curves[0] is not None:
        return found
    curve, _ = search.begin(fold, value)
    marks = [(kind, point, state, curve) for kind, point, state, _ in found.marks]
    return replace(found, curves=[curve] * len(found.curves), marks=marks)


def _led_by_largest(equations: Equations, orbit: Orbit) -> Equations:
    """Return the equations with the phase set by what moves most: it moves along most of the curve, too."""
    if equations.with_phase is None:
        return equations
    places = equations.cosines
    largest = max(places, key=lambda i: float(np.hypot(*orbit.coefficients[1:3, i]) / equations.scale[places[i]]))
    return equations.with_phase(equations.system.coordinate_names[largest], equations.system)
