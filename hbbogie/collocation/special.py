"""Special points of branches of collocated cycles: located by test functions, folds with their gradient."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.collocation.adaption import Placed, chord, located_between
from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.multipliers import TRUSTED
from hbbogie.collocation.solving import finished
from hbbogie.solving.arclength import distance, located, product
from hbbogie.solving.curve import Point
from hbbogie.stability.crossing import description

Array = NDArray[np.float64]
LOCATED = 1e-2  # share to which a test function has fallen where it is located, else it jumps
FLAT = 1e-9  # size of a test function that is round-off
KINDS = ("fold", "branch point", "period doubling", "Neimark-Sacker")


@dataclass(frozen=True, eq=False)
class Special:
    """A point of a branch at which something happens.

    Attributes
    ----------
    kind : {"fold", "branch point", "period doubling", "Neimark-Sacker"}
    curve : OnMeshCurve
    point : Point
    chord : ndarray
        From the point before it to the one behind, in scaled unknowns.
    value, error : float, unit of the parameter
    extremum : {"minimum", "maximum", ""}
    status : str
    curvature : float
        Of a fold: second derivative of the parameter along the branch in scaled arclength, by the points beside it.
    place : int
        Of the last point before it, among those it was looked for.
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
    return finished(curve.equations, point.u, point.error, errors, (curve.spectrum(point), finer, None))


def special_between(curve: OnMeshCurve, points: list[Point], kinds: tuple[str, ...]) -> Iterator[Special]:
    """Locate what happens between successive points of a curve, in their order."""
    found = []
    for kind in kinds:
        values = [curve.value(kind, point) for point in points]
        for (a, b), (x, y) in zip(pairwise(points), pairwise(values), strict=True):
            if x * y < 0 and (special := _located(curve, kind, a, b, min(abs(x), abs(y)))) is not None:
                place = next(i for i, point in enumerate(points) if point is a)
                found.append((place, distance(curve, a, special.point), replace(special, place=place)))
    yield from (special for *_, special in sorted(found, key=lambda f: f[:2]))


def turning(found: list[Special], values: Array, noise: float) -> list[Special]:
    """Return the special points without folds between which the parameter varies by no more than its error."""
    while folds := [s for s in found if s.kind == "fold"]:
        ends = [values[0], *(s.value for s in folds), values[-1]]
        rises = np.abs(np.diff(np.array(ends, dtype=float)))
        i = int(np.argmin(rises))
        if rises[i] > noise:
            break
        false = [id(s) for s in folds[max(i - 1, 0) : i + 1]]
        found = [s for s in found if id(s) not in false]
    return found


def special_along(points: list[Placed], kinds: tuple[str, ...]) -> list[Special]:
    """Locate what happens between successive points that have meshes of their own, in their order."""
    found = []
    for kind in kinds:
        values = [curve.value(kind, point) for curve, point in points]
        for k in range(len(values) - 2, -1, -1):  # next to a family the sign of what is zero is round-off
            values[k] = values[k] if abs(values[k]) > FLAT else FLAT * float(np.sign(values[k + 1]))
        for place, (x, y) in enumerate(pairwise(values)):
            if not x * y < 0:
                continue
            a, b = points[place : place + 2]
            (curve, point), error = located_between(a, b, partial(_value, kind))
            way = chord(a, b, curve.equations)
            turn = b[1].tangent[-1] - a[1].tangent[-1]
            special = _special(curve, kind, point, error, min(abs(x), abs(y)), way, float(turn))
            found += [] if special is None else [replace(special, place=place)]
    return sorted(found, key=lambda s: s.place)


def _value(kind: str, curve: OnMeshCurve, point: Point) -> float:
    return curve.value(kind, point)


def _located(curve: OnMeshCurve, kind: str, a: Point, b: Point, size: float) -> Special | None:
    """Return the special point between two others; None where the test function jumps."""
    met = located(curve, a, b, lambda point: curve.value(kind, point))
    if met is None:
        return None
    way, turn = (b.u - a.u) / curve.scale, float(b.tangent[-1] - a.tangent[-1])
    return _special(curve, kind, *met, size, way, turn)


def _special(
    curve: OnMeshCurve, kind: str, point: Point, error: float, size: float, way: Array, turn: float
) -> Special | None:
    """Return a special point located with an error; None where the test function, at most some size, has jumped.

    ``way`` goes from the point before it to the one behind, over which the share of the parameter in the tangent
    changes by ``turn``.
    """
    left = abs(curve.value(kind, point))
    if left > max(LOCATED * size, 1e-7):
        return None
    value, extremum, curvature = float(point.u[-1]), "", float("nan")
    reach = error * abs(float(point.tangent[-1])) * curve.equations.width + 1e-12 * abs(value)
    if kind == "fold":
        extremum = "minimum" if turn > 0 else "maximum"
        curvature = turn / product(curve, point.tangent, way) * curve.equations.width
        named = "smallest" if extremum == "minimum" else "largest"
        status = f"{named} value of {curve.parameter} along the branch; slope {left:.1e} where located"
    elif kind == "Neimark-Sacker":
        values = curve.spectrum(point).others
        pair = values[np.argsort(np.abs(np.abs(values) - 1))[:2]]
        if np.abs(pair.imag).min() < 1e-6 or not _trusted(curve, point, pair[0]):
            return None  # two real multipliers with product 1: nothing changes
        status = description(kind, pair[0], half=False)
    elif kind == "period doubling":
        values = curve.spectrum(point).others
        pair = values[[np.argmin(np.abs(values + 1))]]
        if not _trusted(curve, point, pair[0]):
            return None
        status = description(kind, pair[0], half=False)
    else:
        status = f"another branch crosses; smallest singular value {left:.1e} where located"
    return Special(kind, curve, point, way, value, reach, extremum, status, curvature)


def _trusted(curve: OnMeshCurve, point: Point, multiplier: complex) -> bool:
    """Tell whether a multiplier is resolved: where the period is very long it may be round-off."""
    own, finer = curve.spectrum(point), curve.estimate(point)[1]
    errors = [abs(s.values[s.trivial] - 1) for s in (own, finer)] + [np.abs(finer.others - multiplier).min()]
    return bool(max(errors) <= TRUSTED)


def fold_gradient(curve: OnMeshCurve, point: Point) -> dict[str, float]:
    """Return the derivatives of a fold's value in all other parameters, by the adjoint."""
    e, line = curve.equations, curve.line(point)
    factors = line.adjoint(curve.weights * point.tangent)
    values, T, _ = e.unpack(point.u)
    weights = np.einsum("ijn,jk->ikn", factors, e.gauss.a) * (np.diff(e.mesh) * T)[:, None, None] * e.width / e.size
    slopes = e.rates.sensitivity(
        values[:, 1:].reshape(-1, e.n), e.parameters(point.u), weights.reshape(-1, e.n), e.sides_of_stages
    )
    names = e.rates.system.parameter_names
    return {name: float(s) for name, s in zip(names, slopes, strict=True) if name != e.rates.parameter}
