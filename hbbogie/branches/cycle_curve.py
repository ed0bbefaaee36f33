"""The curve of cycles over a parameter that `hbbogie.solving.arclength` follows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import issparse

from hbbogie.branches.homoclinic import homoclinic_ending
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.ending import Ending
from hbbogie.solving.curve import Dense, Point, Sparse
from hbbogie.solving.linear import scaled
from hbbogie.solving.newton import Buffered, Conditions, Problem

Array = NDArray[np.float64]
VERTICAL = 1e-9  # share of the parameter in the tangent below which it counts as constant
ROUND_OFF = 1e-12  # share of the parameter's scale up to which it is zero
FAR = 10.0  # amplitude, in units of its scale, above which steps grow with its square
GROWN = 2.0  # period, relative to that of the first point, from which a homoclinic motion is looked for
PATIENCE = 20  # points at one parameter value after which a branch counts as a family


class CycleCurve:
    """The cycles of equations over a parameter, as a curve in (z, parameter), scaled (eq-arclength).

    Parameters
    ----------
    equations : Equations
    parameter : str
    interval : (float, float), unit of the parameter
        Where the curve ends. A quarter of its width counts as much as one unit of amplitude.
    p : ndarray, shape (number of parameters,)
    tolerance : float
        Largest scaled residual of a point.
    families : bool
        Whether the curve goes on where the parameter does not vary along it.
    unresolved : float
        Share of the highest harmonics beyond which it ends.
    """

    def __init__(
        self,
        equations: Equations,
        parameter: str,
        interval: tuple[float, float],
        p: Array,
        tolerance: float,
        families: bool = True,
        unresolved: float = np.inf,
    ):
        place = equations.system.parameter_names.index(parameter)
        self.problem = Problem(equations, Conditions((place,)), p, bounded=False)  # the window bounds it
        self.equations, self.parameter, self.families, self.unresolved = equations, parameter, families, unresolved
        self.scale = np.append(equations.scale, (interval[1] - interval[0]) / 4)
        self.weights, self.window = np.ones(len(self.scale)), {equations.size: interval}
        self.rows, self.tolerance = equations.residual_scale, tolerance
        self._frequency = Buffered(equations.frequency)

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return scaled residual, shape (m,), and Jacobian, shape (m, m + 1)."""
        return self._scaled(*self.problem.evaluate(u))

    def linearise(self, u: Array) -> Dense | Sparse:
        """Return the equations and their derivative."""
        F, J = self.problem.linearise(u)
        if issparse(J):
            return Sparse(F / self.rows, scaled(J, self.rows, self.scale))
        return Dense(*self._scaled(F, J))

    def _scaled(self, F: Array, J: Array) -> tuple[Array, Array]:
        """Return residual and full Jacobian, which is changed in place, in scaled unknowns."""
        J /= self.rows[:, None]
        J *= self.scale
        return F / self.rows, J

    def settle(self, u: Array) -> None:
        """Take note of nothing."""

    def vertical(self, points: Sequence[Point]) -> bool:
        """Tell whether all points have one value of the parameter: a family, as of a conservative system."""
        return self.steady([float(point.u[-1]) for point in points])

    def steady(self, values: ArrayLike) -> bool:
        """Tell whether values of the parameter are one."""
        return np.size(values) > 1 and bool(np.ptp(values) <= VERTICAL * self.scale[-1])

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the branch ends before a point: it is a family, or a bound is met."""
        place, last = self.where(points[-1].u), points[-PATIENCE:]
        if not self.families and len(points) > PATIENCE and all(abs(p.tangent[-1]) < VERTICAL for p in last):
            constant = f"{place} does not vary along the branch"
            return Ending("family", f"{constant}: a family of cycles, as of a conservative system")
        if self._omega(points[0].u) >= GROWN * self._omega(there.u):
            approach = homoclinic_ending(self.equations.system, self.orbit(there), self.where(there.u))
            if approach is not None:
                return approach
        if self.unresolved < np.inf and self.orbit(there).tail > self.unresolved:
            return Ending("unresolved", f"{self.equations.method} no longer resolve the cycles beyond {place}")
        met = self.problem.violated(there.u)
        if any(bound.place == self.equations.leading and bound.side == "lower" for bound in met):
            first, higher = (
                np.abs(part).max(initial=0.0) for part in np.split(self.orbit(there).coefficients[1:], [2])
            )
            what = "the cycle shrinks to an equilibrium" if higher < first else "cycles of half the period follow"
            return Ending("vanishes", f"the first harmonic vanishes at {place}: {what}")
        return Ending("bound", f"a bound was reached at {place}: {', '.join(map(str, met))}") if met else None

    def _omega(self, u: Array) -> float:
        return float(self._frequency(u[:-1])[0][0, 0])

    def stretch(self, u: Array) -> float:
        """Return how many times longer than usual a step may be: at amplitudes far above their scale little happens."""
        first = list(self.equations.cosines.values())
        return max(1.0, float(np.abs(u[first] / self.scale[first]).max() / FAR) ** 2)

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of the parameter."""
        return Ending("interval", f"the end of the interval was reached, {self.parameter} = {value:.6g}")

    def where(self, u: Array) -> str:
        """Return the parameter's value, for people."""
        return f"{self.parameter} = {0.0 if abs(u[-1]) <= ROUND_OFF * self.scale[-1] else u[-1]:.6g}"

    def branching(self, point: Point) -> float:
        """Return a number that changes its sign where another branch crosses, never at a fold (eq-branching).

        The smallest singular value of the Jacobian bordered by the tangent, with the sign of the determinant.
        """
        return self.linearise(point.u).signed_size(point.tangent)

    def inaccuracy(self, point: Point, left: float) -> float:
        """Return the length of arc by which a point may be off for what is left of the equations there.

        Where branches cross that is the root of it.
        """
        size = abs(self.branching(point))
        return left / size if size > left**0.5 else left**0.5

    def orbits(self, points: Sequence[Point]) -> list[Orbit]:
        """Return the cycles of points."""
        m, status = self.equations.size, "converged by pseudo-arclength continuation"
        z, F = np.array([point.u[:m] for point in points]), np.array([point.residual for point in points]) * self.rows
        p = np.array([self.problem.parameters(point.u) for point in points])
        return self.equations.decode_each(z, p, F, status)

    def orbit(self, point: Point) -> Orbit:
        """Return the cycle of a point."""
        return self.orbits([point])[0]
