"""Curves of folds over two parameters, with their cusps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from hbbogie.branches.continuation import trace
from hbbogie.branches.fold_error import doubt_on_branch
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.arclength import correct
from hbbogie.solving.curve import Dense, Point
from hbbogie.solving.newton import Conditions, Problem
from hbbogie.solving.solvers import solve

Array = NDArray[np.float64]
SMALLEST = 1e-3  # first-harmonic amplitude, in units of its scale, at which a curve ends
LINEAR = 1e-12  # bend, in units of the largest second derivative beside it, at which the cycles are linear ones
LEAPS = (1e-3, 1e-2)  # distances beyond a grazing contact at which the curve is taken up again, of the chart's width
ASTRAY = 0.2  # distance from the expected value, in units of the leap, up to which a fold is one of the same curve
VICINITY = 0.1  # of the chart's height: where the fold is looked for there


class FoldCurve:
    """The folds of the equations over two parameters, as a curve (eq-fold-curve).

    The unknowns are those of the cycle and both parameters. The condition of a fold follows from a bordered system; its
    derivative takes one product with the second derivatives.

    Parameters
    ----------
    equations : Equations
    names : (str, str)
        The two parameters.
    span, interval : (float, float), units of the parameters
        Where the curve ends.
    p : ndarray, shape (number of parameters,)
        All parameter values; those of the two are where the scales are taken.
    tolerance : float
        Largest scaled residual.
    """

    corners = 3  # grazing contacts that a curve of folds is followed across

    def __init__(
        self,
        equations: Equations,
        names: tuple[str, str],
        span: tuple[float, float],
        interval: tuple[float, float],
        p: Array,
        tolerance: float = 1e-10,
    ):
        self.equations, self.names, self.tolerance = equations, names, tolerance
        places = tuple(equations.system.parameter_names.index(name) for name in names)
        self.problem = Problem(equations, Conditions(places), p, bounded=False)  # the window bounds them
        self.m = equations.size
        m, self.rows = self.m, equations.residual_scale
        self.size = np.concatenate([equations.scale, [(high - low) / 4 for low, high in (span, interval)]])
        self.scale, self.weights = self.size, np.ones(m + 2)
        self.window = {m: span, m + 1: interval}
        self._second = equations.hessian_times(places)
        self.border = np.zeros(m), np.zeros(m)  # right and left null vector of the last point
        self._states: dict[bytes, FoldState] = {}

    def linearise(self, u: Array) -> Dense:
        """Return the equations and their derivative."""
        F, J = self._derivatives(u)
        g, v, w = self._bordered(J)
        return Dense(np.append(F, g), np.vstack([J, -self._curvature(u, v, w)]))

    def _derivatives(self, u: Array) -> tuple[Array, Array]:
        """Return F and its derivative, both scaled."""
        F, J = self.problem.evaluate(u)
        return F / self.rows, J / self.rows[:, None] * self.size

    def _bordered(self, J: Array) -> tuple[float, Array, Array]:
        """Return the condition of a fold, g = 0, and the right and the left null vector."""
        m, (v, w) = self.m, self.border
        factors = lu_factor(np.block([[J[:, :m], w[:, None]], [v, np.zeros(1)]]), check_finite=False)
        last = np.append(np.zeros(m), 1.0)
        right, left = (lu_solve(factors, last, trans=trans, check_finite=False) for trans in (0, 1))
        return float(right[m]), right[:m], left[:m]

    def _curvature(self, u: Array, v: Array, w: Array) -> Array:
        """Return the second derivative of w . F, scaled, times v, in all unknowns."""
        z, p = u[: self.m], self.problem.parameters(u)
        along = self.size * np.append(v, [0.0, 0.0])
        return np.asarray(self._second(z, p, w / self.rows, along).full().ravel() * self.size)

    def doubt(self, point: Point) -> str:
        """Return why the cycle at a point is not resolved; empty where it is."""
        orbit, name = self.orbit(point), self.names[0]
        value = orbit.parameters[name]
        special = SpecialPoint("fold", name, value, (value, value), orbit, "", extremum=self.state(point).extremum)
        return doubt_on_branch(self.equations.system.with_parameters(**orbit.parameters), special)

    def settle(self, u: Array) -> None:
        """Take the null vectors here as the border of those near by."""
        _, v, w = self._bordered(self._derivatives(u)[1])
        self.border = v / np.linalg.norm(v), w / np.linalg.norm(w)

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the curve ends before a point, or None."""
        return self._end(there.u)

    def _end(self, u: Array) -> Ending | None:
        y, leading = u.copy(), self.equations.leading
        y[leading] -= SMALLEST * self.size[leading]
        met = self.problem.violated(y)
        if any(bound.place == leading and bound.side == "lower" for bound in met):
            return Ending("vanishes", f"the cycle shrinks to the equilibrium near {self.where(u)}")
        if met:
            return Ending("bound", f"a bound was reached near {self.where(u)}: {', '.join(map(str, met))}")
        linear = self._state_at(u).linear
        return Ending("contact", f"the cycle no longer reaches a contact near {self.where(u)}") if linear else None

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of a parameter."""
        return Ending("interval", f"the end of the chart was reached, {self.names[index - self.m]} = {value:g}")

    def where(self, u: Array) -> str:
        """Return the second parameter's value, for people."""
        return f"{self.names[1]} = {u[self.m + 1]:.6g}"

    def first(self, orbit: Orbit) -> Point:
        """Return the fold at an orbit's second parameter, near the orbit, its tangent towards growing values.

        Raises
        ------
        ConvergenceError
            When it is not found.
        """
        u = np.concatenate([self.equations.encode(orbit), [orbit.parameters[n] for n in self.names]])
        left, _, right = np.linalg.svd(self._derivatives(u)[1][:, : self.m])
        self.border = right[-1], left[:, -1]
        across = np.zeros(len(u))
        across[self.m + 1] = 1.0
        found, iterations = correct(self, u, across)
        if found is None:
            raise ConvergenceError(
                f"no fold was found from this cycle in {iterations} iterations; locate it with fold."
            )
        return found

    def orbit(self, point: Point) -> Orbit:
        """Return the cycle at a point."""
        return self.problem.orbit(point.u, "fold on a curve of folds")

    def state(self, point: Point) -> FoldState:
        """Return what is to be known about a point of the curve."""
        return self._state_at(point.u)

    def _state_at(self, u: Array) -> FoldState:
        if (known := self._states.get(u.tobytes())) is not None:
            return known
        _, J = self._derivatives(u)
        _, v, w = self._bordered(J)
        v, w = v / np.linalg.norm(v), w / np.linalg.norm(w)
        curvature = self._curvature(u, v, w)
        bend, (first, second) = float(curvature[: self.m] @ v), w @ J[:, self.m :]
        with np.errstate(divide="ignore"):
            slope = -float(second * self.size[self.m] / (first * self.size[self.m + 1]))
        linear = abs(bend) <= LINEAR * float(np.abs(curvature).max())
        state = self._states[u.tobytes()] = FoldState(bend, float(first), slope, linear)
        return state

    def beyond(self, point: Point) -> tuple[FoldCurve, Point] | None:
        """Return this curve and a point beyond one at which it is not smooth, where a contact grazes at the fold.

        The branch of cycles is smooth there even so: it is followed at a slightly different value of the second
        parameter, and its fold taken. None where no fold is found.
        """
        direction = np.sign(point.tangent[self.m + 1])
        (low, high), height = self.window[self.m + 1], float(np.ptp(self.window[self.m]))
        for leap in LEAPS:
            value = float(point.u[self.m + 1]) + direction * leap * (high - low)
            expected = float(point.u[self.m]) + self.state(point).slope * direction * leap * (high - low)
            if not low <= value <= high or (found := self._fold_at(point, value)) is None:
                continue
            if abs(found.u[self.m] - expected) <= ASTRAY * leap * height:  # farther away there is another curve
                return self, found if found.tangent[self.m + 1] * direction >= 0 else found.turned()
        return None

    def _fold_at(self, point: Point, value: float) -> Point | None:
        """Return the fold at a value of the second parameter that is nearest to a point, by tracing the branch."""
        (name, over), orbit = self.names, self.orbit(point)
        system = self.equations.system.with_parameters(**(orbit.parameters | {over: value}))
        equations, leader = replace(self.equations, system=system), system.coordinate_names[self.equations.phase or 0]
        low, high = self.window[self.m]
        reach, here = VICINITY * (high - low), orbit.parameters[name]
        span = max(low, here - reach), min(high, here + reach)
        try:
            amplitude = {leader: orbit.first_harmonic(leader)}
            start = solve(equations, orbit, amplitude=amplitude, free=name, method="newton")
            branch = trace(equations, start, name, span, families=False, stability=False, max_points=60)
        except (ConvergenceError, ModelError):
            return None
        for special in sorted(
            branch.folds(), key=lambda s: abs(s.value - here) / reach + abs(s.omega / orbit.omega - 1)
        ):
            try:
                found = self.first(special.orbit)
            except ConvergenceError:
                continue
            if self._end(found.u) is None:
                return found
        return None


@dataclass(frozen=True)
class FoldState:
    """What is to be known about a point of a curve of folds, in scaled unknowns.

    Attributes
    ----------
    bend : float
        psi^T F_zz phi phi, with the null vectors of F_z: it changes its sign at a cusp.
    first : float
        psi^T F_p for the first parameter: it changes its sign where the curve turns back in the second.
    slope : float, unit of the first per unit of the second parameter
        Derivative along the curve (eq-fold-gradient).
    linear : bool
        Whether the cycles are those of a linear system.
    """

    bend: float
    first: float
    slope: float
    linear: bool = False

    @property
    def extremum(self) -> str:
        """Whether cycles exist above ("minimum") or below ("maximum") the first parameter's value."""
        return "minimum" if -self.bend * self.first > 0 else "maximum"
