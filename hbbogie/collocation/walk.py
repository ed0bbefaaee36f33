"""Branches of collocated cycles: walks on one mesh at a time, which is adapted every few points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.collocation.adaption import Placed, adapted_to, curve_at, error_at, refined
from hbbogie.collocation.crossings import away_from, closes, crossings_of, off, reaches, signature
from hbbogie.collocation.curve import OnMeshCurve, homoclinic
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.logarithms import positive_coordinates
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.solving import FIRST, MOST, Guess, check_guess, on_mesh
from hbbogie.collocation.special import KINDS, Special, judged, special_between, turning
from hbbogie.collocation.starting import Sampled
from hbbogie.collocation.touching import grazings
from hbbogie.errors import ModelError, door, pair
from hbbogie.model.ranges import check_interval, check_start
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.arclength import correct, gap, located, walk
from hbbogie.solving.curve import Point

Array = NDArray[np.float64]
FEW = 5  # points between two adaptions of the mesh
LEAST = 4  # points of a stretch that is tried
SLACK = 10.0  # by which the error may exceed the tolerance between two adaptions
COARSEST = 1e3  # error of a first point that is round-off, as of a small cycle about a large mean, and not a wrong one
SHORTEST = 1e-5  # first step of a stretch, and one that is not shortened any more for contacts that change
NEAR = 0.3  # distance, in units of a step, by which contacts that change may move its end
PATIENCE = 6  # points at one value of the parameter after which a branch counts as a family
FLAT, MEMBER = 1e-8, 1e-3  # share of the parameter in their tangents, and distance of a further multiplier from 1
AT = {"interval": -1, "period": -2}  # which unknown has reached its limit at an ending
GROWN = 1e4  # period, relative to that of the start, at which a branch ends


@dataclass(frozen=True, eq=False)
class Stretch:
    """Successive points on one mesh."""

    curve: OnMeshCurve
    points: list[Point]

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Followed:
    """A branch of collocated cycles.

    Attributes
    ----------
    stretches : list of Stretch
        In the order of the branch; the last point of one is the first of the next, on another mesh.
    begun : int
        Place of the stretch at the beginning of which the branch was begun, from where it was followed both ways.
    ends : (Ending, Ending)
    tolerance : float
        Error of period, states and parameter that was asked for.
    """

    stretches: list[Stretch]
    begun: int
    ends: tuple[Ending, Ending]
    tolerance: float

    __repr__ = brief

    def points(self) -> Iterator[tuple[OnMeshCurve, Point]]:
        """Yield the points in order, each once, those on two meshes on the one that was adapted to them."""
        last = len(self.stretches) - 1
        for k, stretch in enumerate(self.stretches):
            begin, end = 0 < k < self.begun, k + 1 == self.begun or self.begun <= k < last
            yield from ((stretch.curve, point) for point in stretch.points[begin : len(stretch.points) - end])

    @property
    def kinked(self) -> bool:
        """Whether elements are piecewise linear, so that each point has a mesh of its own."""
        return self.stretches[0].curve.equations.rates.kinked

    @property
    def values(self) -> Array:
        """Values of the parameter, shape (points,)."""
        return np.array([point.u[-1] for _, point in self.points()])

    @property
    def periods(self) -> Array:
        """Periods, shape (points,), s."""
        return np.exp([point.u[-2] for _, point in self.points()])

    def special(self, kinds: tuple[str, ...] = KINDS) -> list[Special]:
        """Locate what happens between the points, in the order of the branch."""
        smooth = tuple(kind for kind in kinds if kind != "grazing")
        if self.kinked:
            points = list(self.points())
            found = special_between(points, smooth) + (grazings(points) if "grazing" in kinds else [])
        else:
            found, first = [], 0
            for stretch in self.stretches:
                points = [(stretch.curve, point) for point in stretch.points]
                found += [replace(s, place=first + s.place) for s in special_between(points, smooth)]
                first += len(stretch.points) - 1
        found.sort(key=lambda s: (s.place, s.along))
        width = self.stretches[0].curve.equations.width
        return turning(found, self.values, SLACK * self.tolerance * width)

    def crossings(self, value: float) -> Iterator[tuple[int, CollocatedCycle]]:
        """Yield the cycles at a value of the parameter, each with the number of folds before it."""
        if not any(reaches(stretch.curve, stretch.points, value) for stretch in self.stretches):
            return
        folds = self.special(("fold",))
        if self.kinked:
            yield from crossings_of(list(self.points()), folds, value)
            return
        first = part = 0
        for stretch in self.stretches:
            for k, (a, b) in enumerate(pairwise(stretch.points), first):
                inside = [fold.point for fold in folds if fold.place == k]
                for i, (here, there) in enumerate(pairwise([a, *inside, b])):
                    part += i > 0
                    low, high = sorted((here.u[-1], there.u[-1]))
                    if low <= value < high and (met := located(stretch.curve, here, there, partial(off, value))):
                        yield part, judged(stretch.curve, met[0])
            first += len(stretch.points) - 1


@door(guess=(Sampled, CollocatedCycle), rates=Rates)
def follow(
    guess: Guess,
    rates: Rates,
    interval: tuple[float, float],
    *,
    grows: bool = False,
    before: Sampled | None = None,
    degree: int = 4,
    tolerance: float = 1e-9,
    step: float = 0.05,
    longest: float = 0.5,
    most: int = 400,
    work: float = np.inf,
    progress: Callable[[float], None] | None = None,
) -> Followed:
    """Follow a branch of cycles over a parameter in both directions.

    Parameters
    ----------
    guess : Guess
        Near the branch.
    rates : Rates
        With the parameter.
    interval : (float, float), unit of the parameter
    grows : bool
        Whether the branch begins at the guess, a small cycle, and is followed only towards larger ones; the parameter
        is then free from the first.
    before : Sampled, optional
        A cycle of the branch next to the guess, in the same phase, away from which only it is followed.
    degree : int
    tolerance : float
        Estimated error of the period, and of the states where intervals begin, at which the mesh is kept.
    step, longest : float
        First and longest step in scaled arclength.
    most : int
        Largest number of points.
    work : float
        Largest number of their intervals, all together, in one direction.
    progress : callable, optional
        Called with the value of the parameter.

    Raises
    ------
    ConvergenceError
        When no cycle is found near the guess.
    ModelError
        When the system jumps, or conserves a quantity; for a reversed interval, or a guess outside it or
        of another kind.
    """
    if rates.parameter is None:
        raise ModelError("follow: the rates know no parameter to vary; give Rates(system, parameter), with its name.")
    check_guess(rates.system, guess)
    interval = check_interval(rates.system, rates.parameter, pair(f"interval of {rates.parameter!r}", interval))
    check_start(rates.parameter, guess.parameters[rates.parameter], interval)
    curve, first = _first(guess, rates, interval, degree, tolerance, grows)
    options = {"step": step, "longest": longest, "most": most, "work": work, "progress": progress}
    if before is not None:
        first = away_from(curve, first, before)
    ahead, end = _walk(curve, first, tolerance, **options)  # type: ignore[arg-type]
    if grows or before is not None:
        what = "began here, with a small cycle" if grows else "began here"
        return Followed(ahead, 0, (Ending("began", what), end), tolerance)
    if end.kind == "closed":
        return Followed(ahead, 0, (end, end), tolerance)
    back, beginning = _walk(curve, first.turned(), tolerance, **options)  # type: ignore[arg-type]
    turned = [Stretch(s.curve, [p.turned() for p in s.points[::-1]]) for s in back[::-1]]
    return Followed([*turned, *ahead], len(turned), (beginning, end), tolerance)


def _first(
    guess: Guess, rates: Rates, interval: tuple[float, float], degree: int, tolerance: float, grows: bool
) -> tuple[OnMeshCurve, Point]:
    """Return the first point, with as many intervals as the tolerance takes."""
    N, width = FIRST, (interval[1] - interval[0]) / 4
    while N <= MOST:
        equations, u = on_mesh(rates, guess.on(N, degree), width)
        curve = curve_at(equations, u, interval, np.inf, equations.size)
        # at the value of the parameter, or, as beside a fold and a Hopf point, at the size of the guess
        fixed, sized = np.zeros(len(u)), np.zeros(len(u))
        fixed[-1] = 1.0
        deviation = curve.deviation(u) * np.sqrt(equations.measure)[..., None]
        sized[: deviation.size] = deviation.ravel()
        tried = (correct(curve, u, plane)[0] for plane in ((sized,) if grows else (fixed, sized)))
        found = next((point for point in tried if point is not None), None)
        there = None if found is None else refined(curve, found, tolerance)
        if there is not None and error_at(*there) <= COARSEST * tolerance:
            curve, point = there
            longest = GROWN * float(np.exp(point.u[-2]))
            return curve_at(curve.equations, point.u, interval, longest, curve.largest), point
        N *= 2
    raise ConvergenceError(
        f"system {rates.system.name!r}: no cycle was found near the guess with up to {MOST} intervals of degree "
        f"{degree}."
    )


def _walk(
    curve: OnMeshCurve,
    first: Point,
    tolerance: float,
    *,
    step: float,
    longest: float,
    most: int,
    work: float,
    progress: Callable[[float], None] | None,
) -> tuple[list[Stretch], Ending]:
    """Follow a branch in one direction, in stretches of a few points."""
    stretches: list[Stretch] = []
    start, length, count = signature(curve, first), step, 0
    second: Array | None = None
    kinked = curve.equations.rates.kinked
    few = most_few = 2 if kinked else FEW + 1

    def say(point: Point) -> None:
        if progress:
            progress(float(point.u[-1]))

    while True:
        points, end = walk(curve.predicting(), first, step=length, longest=longest, most=few, progress=say)
        if end.kind == "stuck" and len(points) == 1 and (finer := adapted_to(curve, first, 2 * curve.equations.N)):
            curve, first = finer
            points, end = walk(curve.predicting(), first, step=length, longest=longest, most=few, progress=say)
        while len(points) > 2 and error_at(curve, points[-1]) > SLACK * tolerance:  # the mesh is no longer right
            points, end = points[: len(points) // 2 + 1], Ending("points")
            few = max(len(points), LEAST) - 1
        few = min(few + 1, most_few)  # as many as the mesh was right for, and one more
        over, there, growth = end.kind not in ("points", "stuck") or len(points) == 1, None, 1.0
        if kinked and len(points) > 1:
            there = _settled(curve, points, end, tolerance)
            moved = _moved(curve, points[-1], *there) / length if there else np.inf
            if length > SHORTEST and moved > NEAR:
                length /= 4  # the contacts change by too much
                continue
            growth = 1.5 if moved < 0.2 * NEAR else 1.0
            if there is None:
                what = f"no further point was found beyond {curve.where(first.u)}: its contact times do not settle"
                points, end, over = points[:1], Ending("stuck", what), True
        stretches.append(Stretch(curve, points))
        count, work = count + len(points) - 1, work - curve.equations.N * (len(points) - 1)
        if over:
            stretches += [Stretch(there[0], [there[1]])] if there else []
            return stretches, _said(curve, points[-1], end)
        marks = [signature(curve, point) for point in points]
        second = marks[1] if second is None else second
        if count > 10 and closes(start, second, marks, curve.largest):
            return stretches, Ending("closed", "the branch closes on itself")
        if count >= most or work <= 0:
            return stretches, Ending("points", f"the largest number of points, {min(count, most)}, was reached")
        settled = slice(1) if kinked else slice(1, None)
        if _family([(s.curve, point) for s in stretches[-PATIENCE:] for point in s.points[settled]]):
            what = f"{curve.where(points[-1].u)} does not vary along the branch: a family of cycles"
            return stretches, Ending("family", f"{what}, as of a conservative or a linear system")
        length = min(max(growth * gap(curve, points[-2], points[-1]), SHORTEST), longest)
        there = there or refined(curve, points[-1], tolerance)
        if there is None:
            what = f"no further point was found beyond {curve.where(points[-1].u)}: the mesh could not be adapted"
            return stretches, _said(curve, points[-1], Ending("stuck", what))
        curve, first = there


def _settled(curve: OnMeshCurve, points: list[Point], end: Ending, tolerance: float) -> Placed | None:
    """Return the last point with its own contact times on the mesh, at a limit with the unknown that has reached it."""
    if end.kind in AT:
        return adapted_to(curve, points[-1], curve.equations.N, AT[end.kind])
    return refined(curve, points[-1], tolerance, points[0])


def _moved(curve: OnMeshCurve, point: Point, there: OnMeshCurve, found: Point) -> float:
    """Return by how much contact times on the mesh have moved a point."""
    sizes = []
    for c, p in ((curve, point), (there, found)):
        e, stages = c.equations, c.equations.unpack(p.u)[0][:, 1:] / there.largest
        means = [np.einsum("ij,ijn->n", e.measure, power) for power in (stages, stages**2)]
        sizes.append(np.concatenate([[p.u[-1] / e.width, p.u[-2]], means[0], np.sqrt(means[1])]))
    return float(np.linalg.norm(sizes[1] - sizes[0]))


def _family(points: list[tuple[OnMeshCurve, Point]]) -> bool:
    """Tell whether the last cycles are members of a family, and not of a branch that is steep, as that of canards."""
    last = points[-PATIENCE:]
    if len(last) < PATIENCE or any(abs(point.tangent[-1]) > FLAT for _, point in last):
        return False
    return all(np.abs(curve.spectrum(point).others - 1).min(initial=np.inf) < MEMBER for curve, point in last)


def _said(curve: OnMeshCurve, point: Point, end: Ending) -> Ending:
    """Return an ending, that of a homoclinic approach where it is one."""
    system, T = curve.equations.rates.system, float(np.exp(point.u[-2]))
    if end.kind not in ("period", "stuck"):
        return end
    names, advice = ", ".join(positive_coordinates(system)), ""
    if names:
        advice = f"{names} are positive: their logarithms, hbbogie.collocation.in_logarithms, may lead farther"
    rest = homoclinic(system, curve.equations, point.u) if 10 * curve.longest / GROWN < T else ""
    if not rest:
        return replace(end, advice=advice or end.advice)
    what = f"homoclinic approach near {curve.where(point.u)}, at {rest}; the period is {T:.4g} s"
    return Ending("homoclinic", what, "; ".join(filter(None, ["" if end.kind == "period" else end.what, advice])))
