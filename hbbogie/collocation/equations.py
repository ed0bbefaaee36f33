"""The equations of a cycle on a mesh: collocation, closing and phase, linearised and solved by elimination."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.collocation.elimination import Reduced, reduced
from hbbogie.collocation.rates import Rates
from hbbogie.polynomials import Gauss, evaluated, gauss, moved, slopes_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OnMesh:
    """The equations of a cycle on one mesh, in unknowns u: stages, states, log T, parameter (eq-collocation).

    Attributes
    ----------
    rates : Rates
    mesh : ndarray, shape (N + 1,)
        From 0 to 1.
    m : int
        Degree.
    size : ndarray, shape (n_states,)
        Size of each state.
    width : float, unit of the parameter
        What counts as much as one unit of a scaled state.
    p : ndarray, shape (number of parameters,)
        Values of the others.
    reference : ndarray, shape (N, m + 1, n_states)
        A cycle near by, whose phase is taken.
    advance : tuple of float
        By how much each coordinate grows in a period; empty where none runs on.
    sides : ndarray, shape (N, number of ramps), optional
        1 where a ramp of a piecewise-linear law acts in an interval, else 0; where left out by the states.
    """

    rates: Rates
    mesh: Array
    m: int
    size: Array
    width: float
    p: Array
    reference: Array
    advance: tuple[float, ...] = ()
    sides: Array | None = None

    __repr__ = brief

    @property
    def N(self) -> int:
        """Number of intervals."""
        return len(self.mesh) - 1

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.size)

    @cached_property
    def gauss(self) -> Gauss:
        """Points and weights."""
        return gauss(self.m)

    @cached_property
    def scale(self) -> Array:
        """Size of each unknown."""
        return np.concatenate([np.tile(self.size, self.N * (self.m + 1)), [1.0, self.width]])

    @cached_property
    def measure(self) -> Array:
        """Weights of the stages in integrals over the period, shape (N, m)."""
        return np.asarray(np.diff(self.mesh)[:, None] * self.gauss.b)

    @cached_property
    def weights(self) -> Array:
        """Weights of the unknowns in the inner product: an integral over the period, T and the parameter."""
        stages = np.repeat(self.measure, self.n)
        return np.concatenate([stages, np.zeros(self.N * self.n), [1.0, 1.0]])

    @cached_property
    def _phase(self) -> tuple[Array, Array]:
        """The row of the phase, shape (N, m, n), and the scaled stages of the reference."""
        slope = self.reference - self.reference[:, :1]
        rate = slopes_of(self.m)[1:] @ slope / np.diff(self.mesh)[:, None, None]
        row = self.measure[..., None] * rate / self.size
        norm = float(np.sqrt((row * rate / self.size).sum()))
        return row / norm, self.reference[:, 1:] / self.size

    def pack(self, values: Array, T: float, parameter: float) -> Array:
        """Return the unknowns of values at the beginnings and Gauss points, shape (N, m + 1, n_states)."""
        return np.concatenate([values[:, 1:].ravel(), values[:, 0].ravel(), [np.log(T), parameter]])

    def unpack(self, u: Array) -> tuple[Array, float, float]:
        """Return values, shape (N, m + 1, n_states), period [s] and parameter of unknowns."""
        k = self.N * self.m * self.n
        stages, states = u[:k].reshape(self.N, self.m, self.n), u[k:-2].reshape(self.N, 1, self.n)
        return np.concatenate([states, stages], axis=1), float(np.exp(u[-2])), float(u[-1])

    def parameters(self, u: Array) -> Array:
        """Return all parameters at unknowns."""
        p = self.p.copy()
        if self.rates.place is not None:
            p[self.rates.place] = u[-1]
        return p

    def moved(self, mesh: Array, m: int, u: Array) -> tuple[OnMesh, Array]:
        """Return the equations on another mesh or of another degree, and the unknowns carried over to it."""
        values, T, parameter = self.unpack(u)
        values = moved(self.mesh, values, mesh, m)
        sides = self.sides if mesh is self.mesh else self.sides_at(mesh, u)
        there = replace(self, mesh=mesh, m=m, reference=values, sides=sides)
        return there, there.pack(values, T, parameter)

    def sides_at(self, mesh: Array, u: Array) -> Array | None:
        """Return where ramps act amid the intervals of some mesh, shape (N, number of ramps)."""
        middle = evaluated(self.mesh, self.unpack(u)[0], 0.5 * (mesh[:-1] + mesh[1:]))
        return self.rates.sides(middle, self.parameters(u))

    @property
    def sides_of_stages(self) -> Array | None:
        """Where ramps act, for each stage, shape (N m, number of ramps)."""
        return None if self.sides is None else np.repeat(self.sides, self.m, axis=0)

    @property
    def kinks(self) -> NDArray[np.bool_] | None:
        """Whether ramps act differently before and behind the beginning of each interval, shape (N,)."""
        return None if self.sides is None else (self.sides != np.roll(self.sides, 1, axis=0)).any(axis=1)

    def at_phase(self, u: Array) -> OnMesh:
        """Return the equations with the phase taken from unknowns."""
        return replace(self, reference=self.unpack(u)[0])

    def linearise(self, u: Array) -> Linearised:
        """Return the equations and their derivative at unknowns."""
        g = self.gauss
        values, T, _ = self.unpack(u)
        stages, states = values[:, 1:], values[:, 0]
        f, A, slope = self.rates(stages.reshape(-1, self.n), self.parameters(u), self.sides_of_stages)
        shape, h = stages.shape, np.diff(self.mesh)[:, None, None] * T
        f = h * (f / self.size).reshape(shape)
        slope = h * (slope * (self.width / self.size)).reshape(shape)
        A = A.reshape(*shape, self.n) * (h[..., None] * (self.size / self.size[:, None]))
        ahead = g.a @ f
        x, X = states / self.size, stages / self.size
        end = np.roll(x, -1, axis=0)
        if self.advance:
            end[-1, : len(self.advance)] += np.array(self.advance) / self.size[: len(self.advance)]
        row, reference = self._phase
        residual: list[Array | list[float]] = [
            (X - x[:, None] - ahead).ravel(),
            (end - g.begin * x - g.d @ X).ravel(),
            [float((row * (X - reference)).sum())],
        ]
        rate = slopes_of(self.m)[0] @ values[0] / self.size
        return Linearised(self, np.concatenate(residual), A, ahead, g.a @ slope, row, rate)


@dataclass(eq=False)
class Linearised:
    """The equations at a point, see `hbbogie.solving.curve.Linearised`.

    Attributes
    ----------
    equations : OnMesh
    residual : ndarray, shape (N (m + 1) n_states + 1,)
        Scaled.
    A : ndarray, shape (N, m, n_states, n_states)
        Derivative of the rates at the stages, scaled, times the length of the interval.
    ahead, slope : ndarray, shape (N, m, n_states)
        Integrals of the rates and of their derivative in the parameter from the beginning to each stage.
    phase : ndarray, shape (N, m, n_states)
        The row of the phase.
    rate : ndarray, shape (n_states,)
        Scaled derivative at the beginning of the period, in shares of the first interval.
    """

    equations: OnMesh
    residual: Array
    A: Array
    ahead: Array
    slope: Array
    phase: Array
    rate: Array
    reduced: Reduced | None = None
    transitions: Array | None = None

    __repr__ = brief

    @property
    def stages(self) -> Array:
        """Derivative of the equations of the stages in the stages, shape (N, m n, m n)."""
        e = self.equations
        S = e.gauss.a[None, :, None, :, None] * -self.A.swapaxes(1, 2)[:, None]
        S = S.reshape(e.N, e.m * e.n, e.m * e.n)
        k = np.arange(e.m * e.n)
        S[:, k, k] += 1
        return S

    def solve(self, plane: Array, right: Array, shortest: bool = False) -> tuple[Array, float]:
        """Solve the equations bordered by one more row, see `hbbogie.solving.curve.Linearised` and `Reduced.solve`."""
        e, g = self.equations, self.equations.gauss
        N, m, n, k = e.N, e.m, e.n, e.N * e.m * e.n
        columns = np.empty((N, m, n, n + 3))
        columns[..., :n] = np.eye(n)
        columns[..., n], columns[..., n + 1] = self.ahead, self.slope
        columns[..., n + 2] = right[:k].reshape(N, m, n)
        halved = all(e.rates.system.second_order)
        response = self._halved(columns) if halved else np.linalg.solve(self.stages, columns.reshape(N, m * n, n + 3))
        end = (g.d @ response.reshape(N, m, n * (n + 3))).reshape(N, n, n + 3)
        self.transitions = end[..., :n] + g.begin * np.eye(n)
        G = -end[..., n:]
        G[..., 2] = right[k:-2].reshape(N, n) - G[..., 2]
        rows = np.stack([self.phase.reshape(N, m * n), plane[:k].reshape(N, m * n)], axis=1)
        border = rows @ response
        corner = border[..., n:].sum(axis=0)
        corner[1, :2] += plane[-2:]
        corner[:, 2] = right[-2:] - corner[:, 2]
        border = border[..., :n]
        border[:, 1] += plane[k:-2].reshape(N, n)
        self.reduced = reduced(self.transitions, G, border, corner)
        states, rest = self.reduced.solve(shortest)
        factors = np.ones((N, n + 3, 1))
        factors[:, :n, 0], factors[:, n : n + 2, 0] = states, rest
        stages = response @ factors
        return np.concatenate([stages.ravel(), states.ravel(), rest]), self.reduced.sign

    def _halved(self, right: Array) -> Array:
        """Solve for the stages of a system of second order, whose velocities alone are unknown.

        Parameters
        ----------
        right : ndarray, shape (N, m, n_states, columns)

        Returns
        -------
        ndarray, shape (N, m n_states, columns)
        """
        e, a = self.equations, self.equations.gauss.a
        N, m, k, width = e.N, e.m, e.n // 2, right.shape[-1]
        S = np.diagonal(self.A[:, 0, :k, k:], axis1=1, axis2=2)[:, None, :, None]  # of positions by velocities
        to_q, to_v = self.A[..., k:, :k], self.A[..., k:, k:]
        twice = (a[:, None] * a.T).reshape(m * m, m)  # from stage l by each stage to j
        through_q = twice @ (to_q * S[:, :, None, :, 0]).reshape(N, m, k * k)
        M = -a[:, None, :, None] * to_v.swapaxes(1, 2)[:, None]
        M -= through_q.reshape(N, m, m, k, k).swapaxes(2, 3)
        M = M.reshape(N, m * k, m * k)
        each = np.arange(m * k)
        M[:, each, each] += 1
        forced = (to_q @ right[:, :, :k]).reshape(N, m, k * width)
        v = np.linalg.solve(M, (right[:, :, k:] + (a @ forced).reshape(N, m, k, width)).reshape(N, m * k, width))
        v = v.reshape(N, m, k, width)
        q = right[:, :, :k] + S * (a @ v.reshape(N, m, k * width)).reshape(N, m, k, width)
        return np.concatenate([q, v], axis=2).reshape(N, m * e.n, width)

    def adjoint(self, plane: Array) -> tuple[Array, Array]:
        """Return the factors of the equations in the combination of all that is zero but for the parameter.

        They belong to the solution last computed with this bordering row.

        Returns
        -------
        ndarray, shape (N, m, n_states)
            Those of the stages.
        ndarray, shape (N, n_states)
            Those of the ends of the intervals.
        """
        assert self.reduced is not None
        e = self.equations
        states, border = self.reduced.adjoint()
        right = e.gauss.d[:, None] * states[:, None] - border[0] * self.phase
        right -= border[1] * plane[: right.size].reshape(right.shape)
        stages = np.linalg.solve(self.stages.swapaxes(1, 2), right.reshape(e.N, -1, 1)).reshape(right.shape)
        return stages, states
