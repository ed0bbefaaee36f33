"""Curves of folds of exact cycles over two parameters, for systems that are linear between switchings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.closed_form import exact_walk_through
from hbbogie.critical.fold_curve import ASTRAY, LEAPS, VICINITY, FoldState
from hbbogie.exact.closing import Closing, Linearised
from hbbogie.exact.folding import condition_slope, null_vectors
from hbbogie.exact.points import Point as ExactPoint
from hbbogie.exact.starting import cycle_of
from hbbogie.exact.touching import consistent, depths
from hbbogie.exact.walk import SHORT
from hbbogie.results.ending import Ending
from hbbogie.results.failure import FAILURES
from hbbogie.solving.arclength import correct
from hbbogie.solving.curve import Dense, Point

Array = NDArray[np.float64]


class ExactFoldCurve:
    """The folds of exact cycles over two parameters, as a curve in one sequence of contacts (eq-fold-curve).

    The unknowns are omega, both parameters, and those of the cycle. The equations are those of the cycle, the condition
    of a fold with null vectors of the last point as its border, and that of omega.

    Parameters
    ----------
    names : (str, str)
        The two parameters; the first is that of the fold's equations.
    span, interval : (float, float), units of the parameters
        Where the curve ends.
    fold : Point
        A fold of exact cycles.
    tolerance : float
        Largest scaled residual.
    """

    corners = 30  # changes of the sequence across which a curve is followed

    def __init__(
        self,
        names: tuple[str, str],
        span: tuple[float, float],
        interval: tuple[float, float],
        fold: ExactPoint,
        tolerance: float = 1e-11,
    ):
        self.names, self.tolerance, self.closing = names, tolerance, fold.closing
        self.place = fold.closing.model.system.parameter_names.index(names[1])
        self.widths = np.array([(high - low) / 4 for low, high in (span, interval)])
        self.scale = np.concatenate([[fold.omega], self.widths, np.ones(fold.closing.m)])
        self.weights = np.concatenate([[0.0], np.ones(fold.closing.m + 2)])  # omega follows from the rest
        self.window = {1: span, 2: interval}
        p = fold.closing.parameters(fold.y[None])[0]
        self.start = np.concatenate([[fold.omega, fold.value, p[self.place]], fold.y[:-1]])
        v, w = null_vectors(fold.closing.linearise(fold.y[None]))
        self._nulls = {self.start.tobytes(): (v, w)}
        self.v, self.w = v, w

    def equations(self, u: Array, place: int | None = None) -> tuple[Closing, Array]:
        """Return the equations of the cycle at the unknowns, with one of the two parameters as theirs."""
        closing, over = self.closing, place is not None
        p = closing.p.copy()
        p[:, closing.place], p[:, self.place] = u[1], u[2]
        frame = replace(closing.frame, parameter=self.widths[1:]) if over else closing.frame
        y = np.append(u[3:], u[2 if over else 1] / frame.parameter[0])
        return replace(closing, p=p, place=self.place if over else closing.place, frame=frame), y[None]

    def linearise(self, u: Array) -> Dense:
        """Return the equations and their derivative."""
        n, m = self.closing.n, self.closing.m
        (one, y), (two, y2) = self.equations(u), self.equations(u, self.place)
        at, at2 = one.linearise(y), two.linearise(y2)
        g, v, w = self._bordered(at)
        slope, by_over = condition_slope(one, y, at, v, w)[0], condition_slope(two, y2, at2, v, w)[0, -1]
        slope = np.append(slope, by_over)
        for i in self.closing.sequence.touching:  # a vanishing contact meets the condition, too: divide it out
            h = u[3 + n + i]
            g, slope = g / h, slope / h
            slope[n + i] -= g / h
        span, turn = u[3 + n :].sum(), np.pi if self.closing.sequence.sigma < 0 else 2 * np.pi
        rate = float(self.closing.frame.rate[0])
        D = np.zeros((m + 2, m + 3))
        D[:m, 3:], D[m, 3:] = at.J[0, :, :m], slope[:m]
        by_value = self.widths[0] / float(self.closing.frame.parameter[0])
        D[:m, 1], D[m, 1] = at.J[0, :, m] * by_value, slope[m] * by_value
        D[:m, 2], D[m, 2] = at2.J[0, :, m], slope[m + 1]
        D[m + 1, 0], D[m + 1, 3 + n :] = self.scale[0] * span / (rate * turn), u[0] / (rate * turn)
        return Dense(np.concatenate([at.F[0], [g, u[0] * span / (rate * turn) - 1]]), D)

    def _bordered(self, at: Linearised) -> tuple[float, Array, Array]:
        """Return the condition of a fold, and the null vectors, each of shape (1, m)."""
        m = self.closing.m
        K = np.zeros((m + 1, m + 1))
        K[:m, :m], K[:m, m], K[m, :m] = at.J[0, :, :m], self.w[0], self.v[0]
        inverse = np.asarray(np.linalg.inv(K), dtype=np.float64)
        return float(inverse[m, m]), inverse[None, :m, m], inverse[None, m, :m]

    def settle(self, u: Array) -> None:
        """Take the null vectors here as the border."""
        known = self._nulls.get(u.tobytes())
        if known is None:
            closing, y = self.equations(u)
            _, v, w = self._bordered(closing.linearise(y))
            known = v / np.linalg.norm(v), w / np.linalg.norm(w)
            self._nulls[u.tobytes()] = known
        self.v, self.w = known

    def doubt(self, point: Point) -> str:
        """Return why a fold is not resolved: the equations hold exactly, so there is nothing."""
        return ""

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the curve ends before a point: its motion agrees with another sequence of contacts."""
        closing, y = self.equations(there.u)
        at = closing.linearise(y)
        durations = there.u[[3 + closing.n + i for i in closing.sequence.touching]]
        if (durations >= SHORT).all() and consistent(closing, y, at, depths(closing, y, at))[0]:
            return None
        return Ending("stuck", f"the order of contacts changes near {self.where(there.u)}")

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of a parameter."""
        return Ending("interval", f"the end of the chart was reached, {self.names[index - 1]} = {value:g}")

    def where(self, u: Array) -> str:
        """Return the second parameter's value, for people."""
        return f"{self.names[1]} = {u[2]:.6g}"

    def first(self) -> Point | None:
        """Return the fold where the curve begins, its tangent towards growing values; None where it is lost."""
        across = np.zeros(len(self.start))
        across[2] = 1.0
        found = correct(self, self.start, across)[0]
        return None if found is None or self.leaves([], found) else found

    def state(self, point: Point) -> FoldState:
        """Return what is to be known about a point of the curve."""
        self.settle(point.u)
        (one, y), (two, y2) = self.equations(point.u), self.equations(point.u, self.place)
        at = one.linearise(y)
        _, v, w = self._bordered(at)
        v, w = v / np.linalg.norm(v), w / np.linalg.norm(w)
        bend = -float(condition_slope(one, y, at, v, w)[0, :-1] @ v[0])
        first = float(w[0] @ at.J[0, :, -1]) / float(one.frame.parameter[0])
        second = float(w[0] @ two.linearise(y2).J[0, :, -1]) / self.widths[1]
        with np.errstate(divide="ignore"):
            slope = -float(np.divide(second, first))
        return FoldState(bend, first, slope)

    def beyond(self, point: Point) -> tuple[ExactFoldCurve, Point] | None:
        """Return the curve beyond a change of the sequence, and a point of it; None where no fold is found there."""
        direction = np.sign(point.tangent[2])
        (low, high), height = self.window[2], float(np.ptp(self.window[1]))
        for leap in LEAPS:
            change = direction * leap * (high - low)
            value, expected = point.u[2] + change, point.u[1] + self.state(point).slope * change
            if not low <= value <= high:
                continue
            for fold in self._folds_at(point, float(value)):
                if abs(fold.value - expected) > ASTRAY * leap * height:  # there is another curve
                    continue
                curve = ExactFoldCurve(self.names, self.window[1], self.window[2], fold)
                if (found := curve.first()) is not None:
                    return curve, found if found.tangent[2] * direction >= 0 else found.turned()
        return None

    def _folds_at(self, point: Point, value: float) -> list[ExactPoint]:
        """Return the folds at a value of the second parameter near a point, the nearest first, by following cycles."""
        closing, y = self.equations(point.u)
        here = ExactPoint(closing, y[0], np.zeros(len(y[0])), closing.linearise(y))
        orbit = cycle_of(here)
        p = {**orbit.parameters, self.names[1]: value}
        low, high = self.window[1]
        reach = VICINITY * (high - low)
        span = max(low, here.value - reach), min(high, here.value + reach)
        try:
            system = closing.model.system.with_parameters(**p)
            walk = exact_walk_through(system, orbit.replace(parameters=p), self.names[0], span, most=60)
        except FAILURES:
            return []
        return sorted(
            walk.marked("fold"),
            key=lambda q: abs(q.value - here.value) / reach + abs(q.omega / here.omega - 1),
        )
