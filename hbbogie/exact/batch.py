"""Folds of many designs at once, starting from the fold of a nominal design."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Frame
from hbbogie.exact.folding import FARTHEST, Folds, fold_step, gradients, null_vectors, shifts
from hbbogie.exact.points import Point
from hbbogie.exact.sequence import Sequence
from hbbogie.exact.touching import consistent, depths, repaired
from hbbogie.exact.walk import SHORT

Array = NDArray[np.float64]

CHUNK = 64  # cycles solved for together, as many as fit into the cache
ITERATIONS = 14
TOLERANCE = 1e-10  # largest scaled residual of a fold's conditions before the last correction
FINAL = 1e-9  # size of the last correction; the remaining error is of the order of its square
CHANGES = 6  # largest number of corrections of a sequence


@dataclass(frozen=True, eq=False)
class Start:
    """The starting point of a search: sequence, unknowns and null vectors."""

    sequence: Sequence
    y: Array
    v: Array
    w: Array
    changes: int = 0


@dataclass(frozen=True, eq=False)
class Fold:
    """The fold of one design.

    Attributes
    ----------
    closing : Closing
        Its equations.
    start : Start
        Its sequence, unknowns and null vectors.
    value : float, unit of the parameter
    omega : float, rad/s
    gradient : ndarray, shape (number of parameters,)
    """

    closing: Closing
    start: Start
    value: float
    omega: float
    gradient: Array

    @property
    def y(self) -> Array:
        """Its unknowns, shape (m + 1,)."""
        return self.start.y


class Nominal:
    """The fold of a nominal design, from which searches begin."""

    def __init__(self, point: Point):
        closing, y = point.closing, point.y[None]
        found, _ = fold_step(closing, y, *null_vectors(point.at))
        self.closing, self.p = closing, closing.parameters(y)[0]
        self.start = Start(closing.sequence, y[0], found.v[0], found.w[0])
        self.gradient, self._shifts = gradients(found)[0], shifts(found)

    def starts(self, p: Array) -> dict[int, Start]:
        """Return guesses for designs by first-order extrapolation in the logarithms of the parameters."""
        usable = (p * self.p > 0) & (np.arange(len(self.p)) != self.closing.place)
        change = np.log(np.where(usable, p, 1.0) / np.where(usable, self.p, 1.0)) * self.p
        y = self.start.y + change @ self._shifts.T
        y[:, -1] = self.start.y[-1] * np.exp(y[:, -1] / self.start.y[-1] - 1.0)
        return {d: replace(self.start, y=y[d]) for d in range(len(p))}

    def near(self, p: Array) -> dict[int, Fold]:
        """Return the folds of designs that Newton's method reaches from this one, by the number of the design."""
        return solve(self, p, self.starts(p))


def solve(nominal: Nominal, p: Array, starts: dict[int, Start]) -> dict[int, Fold]:
    """Return the folds that Newton's method reaches from the given starts, in batches with the same sequence."""
    found: dict[int, Fold] = {}
    while starts:
        groups: dict[Sequence, list[int]] = defaultdict(list)
        for d, start in starts.items():
            groups[start.sequence].append(d)
        again: dict[int, Start] = {}
        for sequence, members in groups.items():
            for i in range(0, len(members), CHUNK):
                some = members[i : i + CHUNK]
                closing = _closing(nominal, sequence, p[some])
                for folds, numbers in _newton(closing, np.array(some), [starts[d] for d in some]):
                    new, changed = _judged(folds, numbers, starts)
                    found |= new
                    again |= changed
        starts = again
    return found


def _closing(nominal: Nominal, sequence: Sequence, p: Array) -> Closing:
    """Return the equations of designs with the same sequence."""
    frame: Frame = nominal.closing.frame.of(np.zeros(len(p), dtype=int))
    return replace(nominal.closing, sequence=sequence, p=p, frame=frame)


def _newton(
    closing: Closing, members: NDArray[np.int_], starts: list[Start]
) -> Iterable[tuple[Folds, NDArray[np.int_]]]:
    """Yield folds as they are found, with the numbers of their designs. Failures are skipped."""
    y, v, w = (np.array([getattr(s, name) for s in starts]) for name in "yvw")
    for _ in range(ITERATIONS):
        try:
            found, step = fold_step(closing, y, v, w)
        except np.linalg.LinAlgError:
            return
        done = (found.error <= TOLERANCE) & (found.step <= FINAL)
        if done.any():
            yield replace(found, y=y + step).of(done), members[done]
        keep = ~done & np.isfinite(step).all(axis=1)
        if not keep.any():
            return
        y = y + step * np.minimum(1.0, FARTHEST / np.maximum(found.step, 1e-300))[:, None]
        y, v, w, members = y[keep], found.v[keep], found.w[keep], members[keep]
        closing = replace(closing, p=closing.p[keep], frame=closing.frame.of(keep))


def _judged(
    folds: Folds, numbers: NDArray[np.int_], starts: dict[int, Start]
) -> tuple[dict[int, Fold], dict[int, Start]]:
    """Return the folds that agree with their sequence, and starts with better sequences for those that do not."""
    closing, n, y = folds.closing, folds.closing.n, folds.y
    inside = depths(closing, y, folds.at)
    good = consistent(closing, y, folds.at, inside)
    short = np.any(y[:, [n + i for i in closing.sequence.touching]] < SHORT, axis=1)
    slopes, spans = gradients(folds), y[:, n:-1].sum(axis=1)
    turn = np.pi if closing.sequence.sigma < 0 else 2 * np.pi
    found: dict[int, Fold] = {}
    again: dict[int, Start] = {}
    for b, d in enumerate(map(int, numbers)):
        if good[b] and not short[b] and folds.curvature[b] > 0:
            value, omega = y[b, -1] * closing.frame.parameter[b], turn / spans[b] * closing.frame.rate[b]
            start = Start(closing.sequence, y[b], folds.v[b], folds.w[b])
            found[d] = Fold(closing.of(b), start, float(value), float(omega), slopes[b])
        elif not good[b] and starts[d].changes < CHANGES:
            changed = repaired(closing.sequence, y[b], n, closing.model, folds.at, inside, b)
            if changed is not None:
                one = replace(closing, sequence=changed[0]).of(b)
                v, w = null_vectors(one.linearise(changed[1][None]))
                again[d] = Start(*changed, v[0], w[0], starts[d].changes + 1)
    return found, again
