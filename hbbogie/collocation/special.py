"""Special points of branches of collocated cycles: located by test functions, folds with their gradient."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.collocation.adaption import Placed, chord, curve_at, error_at, located_between, refined
from hbbogie.collocation.contacts import through_contacts
from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.folding import Fold, fold_from, fold_gradient
from hbbogie.collocation.multipliers import TRUSTED
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.solving import ADAPTIONS, FIRST, SHRUNK, Guess, finished, on_mesh
from hbbogie.results.branch import SpecialPoint
from hbbogie.solving.arclength import located, product
from hbbogie.solving.curve import Point
from hbbogie.stability.crossing import description

Array = NDArray[np.float64]
LOCATED = 1e-2  # share to which a test function has fallen where it is located, else it jumps
FLAT = 1e-9  # size of a test function that is round-off
KINDS = ("fold", "branch point", "period doubling", "Neimark-Sacker", "grazing")


Some = TypeVar("Some", "Special", SpecialPoint)


@dataclass(frozen=True, eq=False)
class Special:
    """A point of a branch at which something happens.

    Attributes
    ----------
    kind : {"fold", "branch point", "period doubling", "Neimark-Sacker", "grazing"}
    curve : OnMeshCurve
    point : Point
    chord : ndarray
        From the point before it to the one behind, in scaled unknowns; of a fold its tangent.
    value, error : float, unit of the parameter
    extremum : {"minimum", "maximum", ""}
    status : str
    curvature : float
        Of a fold: second derivative of the parameter along the branch in scaled arclength.
    place : int
        Of the last point before it, among those it was looked for.
    along : float
        Distance from that point, in scaled arclength.
    """

    kind: str
    curve: OnMeshCurve
    point: Point
    chord: Array
    value: float
    error: float
    extremum: str
    status: str
    curvature: float = float("nan")
    place: int = 0
    along: float = 0.0

    __repr__ = brief

    @property
    def cycle(self) -> CollocatedCycle:
        """The cycle at the point."""
        return judged(self.curve, self.point)

    @property
    def discretisation(self) -> float:
        """Estimated error of the value that the mesh makes, by a step at the next degree [unit of the parameter]."""
        return self.curve.estimate(self.point)[0][3] * self.curve.equations.width

    @property
    def gradient(self) -> dict[str, float]:
        """Of a fold: derivatives of its value in all other parameters, by their names (eq-fold-gradient)."""
        return fold_gradient(self.curve, self.point)


def judged(curve: OnMeshCurve, point: Point) -> CollocatedCycle:
    """Return the cycle of a point with its stability and its error estimates, those at its value of the parameter.

    The error of the parameter is one along the branch, which is long where that is steep, and its root at a fold.
    """
    (period, states, waveform, parameter), finer = curve.estimate(point)
    along = min(parameter / max(abs(float(point.tangent[-1])), 1e-300), parameter**0.5)
    of_T, of_states = abs(float(point.tangent[-2])), float(np.abs(point.tangent[:-2]).max())
    errors = period + along * of_T, states + along * of_states, waveform + along * of_states, parameter
    own = curve.spectrum(point)
    return finished(curve.equations, point.u, point.error, errors, (own, finer, own.transitions))


def special_between(points: list[Placed], kinds: tuple[str, ...]) -> list[Special]:
    """Locate what happens between successive points of a branch.

    Where elements are piecewise linear the points have meshes of their own; else they have the same.
    """
    found: list[Special] = []
    for kind in kinds:
        values = [curve.value(kind, point) for curve, point in points]
        if points[0][0].equations.rates.kinked:  # next to a family the sign of what is zero is round-off
            for k in range(len(values) - 2, -1, -1):
                values[k] = values[k] if abs(values[k]) > FLAT else FLAT * float(np.sign(values[k + 1]))
        for place, (x, y) in enumerate(pairwise(values)):
            if (
                x * y < 0
                and (special := _located(kind, points[place], points[place + 1], min(abs(x), abs(y)))) is not None
            ):
                found.append(replace(special, place=place))
    return found


def turning(found: list[Some], values: Array, noise: float) -> list[Some]:
    """Return the special points without folds between which the parameter varies by no more than its error.

    Of several together, as where a branch of canards is steep to round-off, one is kept where the parameter turns.
    """
    folds = sorted((i for i, s in enumerate(found) if s.kind == "fold"))
    groups: list[list[int]] = []
    for i in folds:
        if groups and abs(found[groups[-1][-1]].value - found[i].value) <= noise:
            groups[-1].append(i)
        else:
            groups.append([i])
    means: list[float] = [float(np.mean([found[i].value for i in group])) for group in groups]
    ends: list[float] = [float(values[0]), *means, float(values[-1])]
    kept = set[int]()
    for group, before, here, after in zip(groups, ends, ends[1:], ends[2:], strict=False):
        rises = here - before, here - after
        if min(map(abs, rises)) <= noise or (len(group) > 1 and rises[0] * rises[1] < 0):
            continue
        extremum = "maximum" if rises[1] > 0 else "minimum"
        kept.add(max(group, key=lambda i: (found[i].extremum == extremum, np.sign(rises[1]) * found[i].value)))
    return [s for i, s in enumerate(found) if s.kind != "fold" or i in kept]


def _located(kind: str, a: Placed, b: Placed, size: float) -> Special | None:
    """Return the special point between two others; None where the test function, at most some size, jumps."""
    if kind == "fold" and (fold := _fold_between(a, b)) is not None:
        return folded(fold, a)
    test = partial(_value, kind)
    if a[0].equations.rates.kinked:
        met, error = located_between(a, b, test)
    elif (on_curve := located(a[0], a[1], b[1], partial(test, a[0]))) is not None:
        met, error = (a[0], on_curve[0]), on_curve[1]
    else:
        return None
    left = abs(test(*met))
    if left > max(LOCATED * size, 1e-7):
        return None
    if kind == "fold":
        curve, point = met
        turn, whole = float(b[1].tangent[-1] - a[1].tangent[-1]), between(a, b)
        return folded(Fold(curve, point, turn / whole, error * abs(float(point.tangent[-1]))), a)
    status = _status(kind, *met, left)
    return None if status is None else marked(kind, met, error, status, a, b)


def _value(kind: str, curve: OnMeshCurve, point: Point) -> float:
    return curve.value(kind, point)


def between(a: Placed, b: Placed) -> float:
    """Return how far one point lies from another, along the tangent at that."""
    return product(a[0], a[1].tangent, chord(a, b, a[0].equations))


def _fold_between(a: Placed, b: Placed) -> Fold | None:
    """Return the fold between two points by Newton's method from where it should lie; None where it finds another."""
    x, y = (point.tangent[-1] for _, point in (a, b))
    share, whole = float(x / (x - y)), between(a, b)
    near = int(share > 0.5)
    curve, point = (a, b)[near]
    fold = fold_from(curve, point.u + (share - near) * whole * curve.scale * point.tangent, point.tangent)
    if fold is None or fold.curvature * (y - x) <= 0:
        return None
    return fold if 0 <= between(a, (fold.curve, fold.point)) <= whole else None


def folded(fold: Fold, before: Placed | None = None) -> Special:
    """Return a fold as a special point, that behind another point where one is given."""
    curve, point, width = fold.curve, fold.point, fold.curve.equations.width
    value, extremum = float(point.u[-1]), "minimum" if fold.curvature > 0 else "maximum"
    named = "smallest" if extremum == "minimum" else "largest"
    status = f"{named} value of {curve.parameter} along the branch; slope {abs(point.tangent[-1]):.1e} where located"
    along = 0.0 if before is None else between(before, (curve, point))
    error, curvature = fold.error * width + 1e-12 * abs(value), fold.curvature * width
    return Special("fold", curve, point, point.tangent, value, error, extremum, status, curvature, along=along)


def fold_near(
    guess: Guess, rates: Rates, interval: tuple[float, float], *, degree: int, tolerance: float
) -> Special | None:
    """Return the fold near a cycle by Newton's method, on a mesh that meets a tolerance; None where there is none.

    Parameters
    ----------
    guess : Guess
        A `CollocatedCycle` is taken on its own mesh.
    rates : Rates
        With the parameter.
    interval : (float, float), unit of the parameter
        Four times what counts as much as one of a scaled state.
    degree : int
    tolerance : float
        Estimated error of the period, of the states where intervals begin and of the parameter.
    """
    first = guess if isinstance(guess, CollocatedCycle) and guess.degree == degree else guess.on(FIRST, degree)
    equations, u = on_mesh(rates, first, (interval[1] - interval[0]) / 4)
    if (mesh := through_contacts(equations, u)) is not None:
        equations, u = equations.moved(mesh, degree, u)
    curve = curve_at(equations, u, interval, np.inf, equations.size)
    deviation = np.zeros(len(u))  # along the branch the cycle grows
    growth = curve.deviation(u) * np.sqrt(equations.measure)[..., None]
    deviation[: growth.size] = growth.ravel()
    try:
        tangent, _ = curve.linearise(u).solve(deviation, np.append(np.zeros(len(u) - 1), 1.0))
    except np.linalg.LinAlgError:
        return None
    fold = fold_from(curve, u, tangent)
    for _ in range(ADAPTIONS):
        if fold is None:
            return None
        e = fold.curve.equations
        if (np.ptp(e.unpack(fold.point.u)[0], axis=(0, 1)) < SHRUNK * equations.size).all():
            return None  # a Hopf point
        if error_at(fold.curve, fold.point) <= tolerance:
            return folded(fold)
        there = refined(fold.curve, fold.point, tolerance)
        fold = None if there is None else fold_from(there[0], there[1].u, there[1].tangent)
    return None


def marked(kind: str, at: Placed, error: float, status: str, a: Placed, b: Placed) -> Special:
    """Return a special point located with an error, in scaled arclength, between two others."""
    (curve, point), value = at, float(at[1].u[-1])
    reach = error * abs(float(point.tangent[-1])) * curve.equations.width + 1e-12 * abs(value)
    return Special(kind, curve, point, chord(a, b, curve.equations), value, reach, "", status, along=between(a, at))


def _status(kind: str, curve: OnMeshCurve, point: Point, left: float) -> str | None:
    """Return what happens at a point where a test function has fallen to some size; None where that is nothing."""
    if kind == "branch point":
        return f"another branch crosses; smallest singular value {left:.1e} where located"
    values = curve.spectrum(point).others
    pair = values[np.argsort(np.abs(np.abs(values) - 1))[:2]]
    if kind == "Neimark-Sacker" and np.abs(pair.imag).min() < 1e-6:
        return None  # two real multipliers with product 1: nothing changes
    critical = pair[0] if kind == "Neimark-Sacker" else values[np.argmin(np.abs(values + 1))]
    return description(kind, critical, half=False) if _trusted(curve, point, critical) else None


def _trusted(curve: OnMeshCurve, point: Point, multiplier: complex) -> bool:
    """Tell whether a multiplier is resolved: where the period is very long it may be round-off."""
    own, finer = curve.spectrum(point), curve.estimate(point)[1]
    errors = [abs(s.values[s.trivial] - 1) for s in (own, finer)] + [np.abs(finer.others - multiplier).min()]
    return bool(max(errors) <= TRUSTED)
