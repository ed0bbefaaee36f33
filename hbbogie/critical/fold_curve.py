"""Curves of folds over two parameters, with their cusps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
LINEAR = 1e-12  # bend, in units of the largest second derivative, at which the cycles are those of a linear system
LEAPS = (1e-3, 1e-2)  # distances beyond a grazing contact at which the curve is taken up again, of the chart's width
ASTRAY = 0.2  # distance from the expected value, in units of the leap, up to which a fold is one of the same curve
NEAR = 3e-3  # scaled distance up to which second derivatives serve to correct a point
VICINITY = 0.1  # of the chart's height: where the fold is looked for there


class FoldCurve:
    """The folds of the equations over two parameters, as a curve (eq-fold-curve).

    The unknowns are those of the cycle, both parameters and the left null vector of the derivative in the former.

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
        self.scale = np.concatenate([self.size, np.ones(m)])
        # the null vector follows from the rest, and does not count as distance
        self.weights = np.concatenate([np.ones(m + 2), np.zeros(m)])
        self.window = {m: span, m + 1: interval}
        self._second = equations.hessian(places)
        self.normal = np.ones(m)
        self._kept: tuple[Array, Array] | None = None  # unknowns, and second derivatives there
        self._states: dict[bytes, FoldState] = {}

    def linearise(self, u: Array) -> Dense:
        """Return the equations and their derivative."""
        m, psi = self.m, u[self.m + 2 :]
        F, J, H = self._derivatives(u, NEAR)
        G = np.concatenate([F, psi @ J[:, :m], [self.normal @ psi - 1]])
        D = np.zeros((2 * m + 1, 2 * m + 2))
        D[:m, : m + 2], D[m : 2 * m, : m + 2], D[m : 2 * m, m + 2 :], D[2 * m, m + 2 :] = (
            J,
            H[:m],
            J[:, :m].T,
            self.normal,
        )
        return Dense(G, D)

    def _derivatives(self, u: Array, near: float = 0.0) -> tuple[Array, Array, Array]:
        """Return F, its derivative and the second derivative of psi . F, all scaled.

        The last costs twenty times as much as the others. It may be that of a place up to a distance away: corrections
        of points with it converge as well.
        """
        y, psi = u[: self.m + 2], u[self.m + 2 :]
        F, J = self.problem.evaluate(y)
        scaled = F / self.rows, J / self.rows[:, None] * self.size
        if self._kept is None or np.abs((u - self._kept[0]) / self.scale).max() > near:
            H = self._second(y[: self.m], self.problem.parameters(y), psi / self.rows).full()
            self._kept = u.copy(), H * np.outer(self.size, self.size)
        return *scaled, self._kept[1]

    def doubt(self, point: Point) -> str:
        """Return why the cycle at a point is not resolved; empty where it is."""
        orbit, name = self.orbit(point), self.names[0]
        value = orbit.parameters[name]
        special = SpecialPoint("fold", name, value, (value, value), orbit, "", extremum=self.state(point).extremum)
        return doubt_on_branch(self.equations.system.with_parameters(**orbit.parameters), special)

    def settle(self, u: Array) -> None:
        """Normalise the null vector by its value here."""
        psi = u[self.m + 2 :]
        self.normal = psi / (psi @ psi)

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the curve ends before a point, or None."""
        return self._end(there.u)

    def _end(self, u: Array) -> Ending | None:
        y, leading = u[: self.m + 2].copy(), self.equations.leading
        y[leading] -= SMALLEST * self.size[leading]
        met = self.problem.violated(y)
        if any(bound.place == leading and bound.side == "lower" for bound in met):
            return Ending("vanishes", f"the cycle shrinks to the equilibrium near {self.where(u)}")
        if met:
            return Ending("bound", f"a bound was reached near {self.where(u)}: {', '.join(map(str, met))}")
        linear = abs(self._state_at(u).bend) <= LINEAR * float(np.abs(self._derivatives(u)[2]).max())
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
        y = np.concatenate([self.equations.encode(orbit), [orbit.parameters[n] for n in self.names]])
        J = self.problem.evaluate(y)[1] / self.rows[:, None] * self.size
        u = np.concatenate([y, np.linalg.svd(J[:, : self.m])[0][:, -1]])
        self.settle(u)
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
        return self.problem.orbit(point.u[: self.m + 2], "fold on a curve of folds")

    def state(self, point: Point) -> FoldState:
        """Return what is to be known about a point of the curve."""
        return self._state_at(point.u)

    def _state_at(self, u: Array) -> FoldState:
        if (known := self._states.get(u.tobytes())) is not None:
            return known
        _, J, H = self._derivatives(u)
        first, second = u[self.m + 2 :] @ J[:, self.m :]
        phi = np.linalg.svd(J[:, : self.m])[2][-1]
        with np.errstate(divide="ignore"):
            slope = -float(second * self.size[self.m] / (first * self.size[self.m + 1]))
        state = FoldState(float(phi @ H[: self.m, : self.m] @ phi), float(first), slope)
        self._states[u.tobytes()] = state
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
    """

    bend: float
    first: float
    slope: float

    @property
    def extremum(self) -> str:
        """Whether cycles exist above ("minimum") or below ("maximum") the first parameter's value."""
        return "minimum" if -self.bend * self.first > 0 else "maximum"
