"""The equations of a cycle and further conditions as a scaled root-finding problem, and Newton's method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.solving.linear import Matrix, scaled, solution, with_row

Array = NDArray[np.float64]
ROUND_OFF = 1e-4  # share of the tolerance below which no further step is needed
NEWTON_ITERATIONS, HALVINGS = 20, 5
FARTHEST = 100.0  # largest value of a free parameter, in units of its first value


@dataclass(frozen=True)
class Conditions:
    """Conditions besides the equations of the cycle: free parameters and a prescribed first-harmonic amplitude.

    Attributes
    ----------
    free : tuple of int
        Places of the free parameters in the parameter vector.
    amplitude : int or None
        Coordinate whose first-harmonic amplitude is prescribed.
    """

    free: tuple[int, ...] = ()
    amplitude: int | None = None


class Buffered:
    """A CasADi function with dense inputs, called on NumPy arrays without conversions; its outputs may be sparse."""

    def __init__(self, function: ca.Function):
        self.buffer, self.run = function.buffer()
        self.inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        self.patterns = [_pattern(function.sparsity_out(i)) for i in range(function.n_out())]
        for i, a in enumerate(self.inputs):
            self.buffer.set_arg(i, a.data)
        for i, a in enumerate(outputs):
            self.buffer.set_res(i, a.data)
        self.outputs = [
            a.reshape(function.size_out(i), order="F") if self.patterns[i] is None else a for i, a in enumerate(outputs)
        ]
        self.shapes = [function.size_out(i) for i in range(function.n_out())]

    def __call__(self, *values: Array) -> list[Any]:
        """Return the values of the function, each of its shape: arrays, or sparse matrices by columns."""
        for a, value in zip(self.inputs, values, strict=True):
            a[:] = value
        self.run()
        found = [a.copy() for a in self.outputs]
        return [
            a if pattern is None else csc_matrix((a, *pattern), shape=shape)
            for a, pattern, shape in zip(found, self.patterns, self.shapes, strict=True)
        ]


def _pattern(sparsity: ca.Sparsity) -> tuple[NDArray[np.int_], NDArray[np.int_]] | None:
    """Return rows and beginnings of columns of a sparse matrix; None for a full one."""
    return None if sparsity.is_dense() else (np.array(sparsity.row()), np.array(sparsity.colind()))


@dataclass(frozen=True)
class Bound:
    """A bound that an unknown has reached.

    Attributes
    ----------
    place : int
        Place of the unknown.
    name : str
        Name of the unknown, for messages.
    side : {"lower", "upper"}
    """

    place: int
    name: str
    side: str

    def __str__(self) -> str:
        return f"{self.name} at its {self.side} bound"


class Problem:
    """The equations and conditions as a scaled root-finding problem in y = (z, p[free]).

    Parameters
    ----------
    equations : Equations
    conditions : Conditions
    p : ndarray, shape (number of parameters,)
        Values of all parameters. The search begins at those of the free parameters.
    target : float, unit of the coordinate
        The prescribed first-harmonic amplitude.
    bounded : bool
        Whether the free parameters are limited to their bounds and to `FARTHEST` times their first values. False if
        something else bounds them.
    """

    def __init__(
        self,
        equations: Equations,
        conditions: Conditions,
        p: Array,
        target: float = 0.0,
        *,
        bounded: bool = True,
    ):
        self.equations, self.conditions, self.p, self.target = equations, conditions, p, target
        self.free = list(conditions.free)
        size = np.where(p[self.free] == 0, 1.0, np.abs(p[self.free]))
        self.scale = np.concatenate([equations.scale, size])
        low, high = np.full((2, len(self.free)), [[-np.inf], [np.inf]])
        if bounded:  # a free parameter that grows without limit is no solution either
            own = np.reshape([equations.system.parameters[i].bounds for i in self.free], (-1, 2))
            reach = FARTHEST * size
            low, high = np.maximum(own[:, 0], p[self.free] - reach), np.minimum(own[:, 1], p[self.free] + reach)
        self.lower = np.concatenate([equations.lower, low])
        self.upper = np.concatenate([equations.upper, high])
        self.row_scale = equations.residual_scale
        self.rows = equations.rows
        if conditions.amplitude is not None:
            self.row_scale = np.append(self.row_scale, target)
            self.rows = (*self.rows, "prescribed amplitude")
        self._jacobian = Buffered(equations.derivatives(conditions.free))

    def parameters(self, y: Array) -> Array:
        """Return the parameter vector that belongs to y."""
        p = self.p.copy()
        p[self.free] = y[self.equations.size :]
        return p

    def evaluate(self, y: Array) -> tuple[Array, Array]:
        """Return the residual and its Jacobian with respect to y, a full matrix."""
        F, J = self.linearise(y)
        return F, J.toarray() if isinstance(J, csc_matrix) else J

    def linearise(self, y: Array) -> tuple[Array, Matrix]:
        """Return the residual and its Jacobian with respect to y, a sparse matrix where the equations have one."""
        z, p = y[: self.equations.size], self.parameters(y)
        F, J = self._jacobian(z, p)
        F = F.ravel()
        if self.conditions.amplitude is not None:
            g, dg = first_harmonic(self.equations, self.conditions)(z, p)
            F, J = np.append(F, float(g) - self.target), with_row(J, dg.full())
        return F, J

    def orbit(self, y: Array, status: str) -> Orbit:
        """Return the orbit that belongs to y."""
        return self.equations.decode(y[: self.equations.size], self.parameters(y), status)

    def violated(self, y: Array, slack: float = 0.0) -> list[Bound]:
        """Return the bounds on or beyond which unknowns lie."""
        low, high = y <= self.lower + slack * self.scale, y >= self.upper - slack * self.scale
        if not (low | high).any():
            return []
        names = [*self.equations.unknowns, *(self.equations.system.parameter_names[i] for i in self.free)]
        return [Bound(int(i), names[i], "lower" if low[i] else "upper") for i in np.flatnonzero(low | high)]


def first_harmonic(equations: Equations, conditions: Conditions) -> ca.Function:
    """Return (z, p) -> first-harmonic amplitude of a coordinate and its derivative in (z, p[free])."""

    def build() -> ca.Function:
        z, p = ca.MX.sym("z", equations.size), ca.MX.sym("p", equations.residual.size1_in(1))
        c = equations.coefficients(z, p)[1:3, conditions.amplitude]
        g = ca.norm_2(c)
        derivative = [ca.jacobian(g, z)] + [ca.jacobian(g, p)[:, i] for i in conditions.free]
        return ca.Function("amplitude", [z, p], [g, ca.horzcat(*derivative)])

    return equations.once(("amplitude", conditions), build)


def newton(problem: Problem, y: Array, tolerance: float) -> tuple[Array, float, int]:
    """Newton's method with step halving.

    Returns
    -------
    y : ndarray, shape (m,)
        The last iterate, the best one.
    error : float
        Its largest scaled residual; at most ``tolerance`` when converged.
    iterations : int
    """
    F, J = problem.linearise(y)
    error, met = float(np.abs(F / problem.row_scale).max()), False
    for iteration in range(NEWTON_ITERATIONS):
        if (error <= tolerance and met) or error <= ROUND_OFF * tolerance or not np.isfinite(error):
            return y, error, iteration
        met = error <= tolerance  # one more step is cheap and reaches round-off
        try:
            step = solution(scaled(J, problem.row_scale, problem.scale), F / problem.row_scale)
        except np.linalg.LinAlgError:
            return y, error, iteration
        for halving in range(HALVINGS):
            trial = y - 0.5**halving * problem.scale * step
            F, J = problem.linearise(trial)
            new = float(np.abs(F / problem.row_scale).max())
            if new < error:
                break
        else:
            return y, error, iteration
        y, error = trial, new
    return y, error, NEWTON_ITERATIONS
