"""Folds of many designs at once, starting from the fold of a nominal design."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing, Frame
from hbbogie.exact.folding import FARTHEST, Folds, fold_step, gradients, null_vectors, shifts
from hbbogie.exact.points import Point
from hbbogie.exact.sequence import Sequence
from hbbogie.exact.touching import consistent, depths, repaired
from hbbogie.exact.walk import SHORT

Array = NDArray[np.float64]

LESSONS = 2  # designs for each coefficient of a polynomial from which guesses for others follow
CHUNK = 20  # cycles solved for together, as many as fit into the cache
REFILLED = 4  # free places among them at which new ones come in
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
        self.gradient, self._found = gradients(found)[0], found

    @cached_property
    def _shifts(self) -> Array:
        """Derivative of the unknowns in all parameters, shape (m + 1, number of parameters)."""
        return shifts(self._found)

    def starts(self, p: Array) -> dict[int, Start]:
        """Return guesses for designs by first-order extrapolation in the logarithms of the parameters."""
        change = self._changes(p) * self.p
        y = self.start.y + (change @ self._shifts.T if change.any() else np.zeros((len(p), 1)))
        y[:, -1] = self.start.y[-1] * np.exp(y[:, -1] / self.start.y[-1] - 1.0)
        return {d: replace(self.start, y=y[d]) for d in range(len(p))}

    def near(self, p: Array) -> dict[int, Fold]:
        """Return the folds of designs that Newton's method reaches from this one, by the number of the design.

        Of many designs, the folds of a few tell better guesses for the others, by a polynomial of the second degree.
        """
        starts = self.starts(p)
        forms = quadratics(self._changes(p))
        first = list(map(int, lessons(forms)))
        if not first:
            return solve(self, p, starts)
        found = solve(self, p, {d: starts[d] for d in first})
        if not found:  # nor will others
            return {}
        alike = [d for d, fold in found.items() if fold.closing.sequence == self.start.sequence]
        if len(alike) > forms.shape[1]:
            learnt = []
            for name in "yvw":
                guess = np.array([getattr(start, name) for start in starts.values()])
                missing = np.array([getattr(found[d].start, name) for d in alike]) - guess[alike]
                learnt.append(guess + forms @ np.linalg.lstsq(forms[alike], missing, rcond=1e-9)[0])
            starts = {d: Start(self.start.sequence, *(guess[d] for guess in learnt)) for d in starts}
        return found | solve(self, p, {d: start for d, start in starts.items() if d not in first})

    def _changes(self, p: Array) -> Array:
        """Return the changes of the logarithms of the parameters, 0 of the parameter itself and where there is none."""
        usable = (p * self.p > 0) & (np.arange(len(self.p)) != self.closing.place)
        return np.log(np.where(usable, p, 1.0) / np.where(usable, self.p, 1.0))


def quadratics(x: Array) -> Array:
    """Return the monomials up to the second degree in the columns that are not constant, one row for each of x."""
    x = x[:, np.ptp(x, axis=0) > 0]
    i, j = np.triu_indices(x.shape[1])
    return np.hstack([np.ones((len(x), 1)), x, x[:, i] * x[:, j]])


def lessons(forms: Array) -> NDArray[np.int_]:
    """Return the numbers of a few of many designs from which guesses for the others follow; none where all are few."""
    few = LESSONS * forms.shape[1]
    return np.linspace(0, len(forms) - 1, few if 2 * few <= len(forms) else 0).astype(int)


def solve(nominal: Nominal, p: Array, starts: dict[int, Start]) -> dict[int, Fold]:
    """Return the folds that Newton's method reaches from the given starts, in batches with the same sequence."""
    found: dict[int, Fold] = {}
    waiting: dict[Sequence, dict[int, Start]] = defaultdict(dict)
    for d, start in starts.items():
        waiting[start.sequence][d] = start
    while waiting:
        sequence = max(waiting, key=lambda s: len(waiting[s]))
        given = waiting.pop(sequence)
        for folds, numbers in _newton(nominal, sequence, p, given):
            new, changed = _judged(folds, numbers, given)
            found |= new
            for d, start in changed.items():
                waiting[start.sequence][d] = start
    return found


def _newton(
    nominal: Nominal, sequence: Sequence, p: Array, starts: dict[int, Start]
) -> Iterable[tuple[Folds, NDArray[np.int_]]]:
    """Yield folds as they are found, with the numbers of their designs. Failures are skipped.

    As many designs as `CHUNK` are solved for together; new ones come in for those that are done.
    """
    waiting = np.array(list(starts))
    every = [np.array([getattr(start, name) for start in starts.values()]) for name in "yvw"]
    y, v, w = (a[:0] for a in every)
    members, steps = waiting[:0], waiting[:0]
    ready: list[tuple[Folds, NDArray[np.int_]]] = []
    while len(members) or len(waiting):
        free = CHUNK - len(members)
        if free >= REFILLED or not len(members):
            y, v, w = (np.concatenate([a, b[:free]]) for a, b in zip((y, v, w), every, strict=True))
            members, every = np.append(members, waiting[:free]), [a[free:] for a in every]
            steps, waiting = np.append(steps, 0 * waiting[:free]), waiting[free:]
            frame: Frame = nominal.closing.frame.of(np.zeros(len(members), dtype=int))
            closing = replace(nominal.closing, sequence=sequence, p=p[members], frame=frame)
        try:
            found, step = fold_step(closing, y, v, w)
        except np.linalg.LinAlgError:
            y, v, w, members, steps = y[:0], v[:0], w[:0], members[:0], steps[:0]
        else:
            steps = steps + 1
            done = (found.error <= TOLERANCE) & (found.step <= FINAL)
            if done.any():
                ready.append((replace(found, y=y + step).of(done), members[done]))
            keep = ~done & np.isfinite(step).all(axis=1) & (steps < ITERATIONS)
            y = y + step * np.minimum(1.0, FARTHEST / np.maximum(found.step, 1e-300))[:, None]
            y, v, w, members, steps = y[keep], found.v[keep], found.w[keep], members[keep], steps[keep]
            closing = replace(closing, p=closing.p[keep], frame=closing.frame.of(keep))
        if ready and (sum(len(numbers) for _, numbers in ready) >= CHUNK or not len(members) + len(waiting)):
            folds, numbers = zip(*ready, strict=True)
            yield Folds.joined(list(folds)), np.concatenate(numbers)
            ready = []


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
