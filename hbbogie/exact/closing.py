"""The equations of cycles that share a sequence of contacts (eq-exact-cycle), for many cycles at once.

The unknowns of a cycle are the state at a crossing, the durations of the S phases, and one parameter, all scaled. The
equations require that the cycle closes and that each phase ends on its surface. If a phase begins and ends on the same
surface, its two conditions become the same as its duration vanishes. The second condition is therefore replaced by
their difference divided by the duration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.model import SwitchedLinear
from hbbogie.exact.sequence import Sequence
from hbbogie.exponential import exponentials_with_derivative

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Frame:
    """Scales of B cycles.

    Attributes
    ----------
    state : ndarray, shape (B, N)
        Typical size of each state, the last 1.
    rate : ndarray, shape (B,), 1/s
        The unit of time is 1 / rate.
    rows : ndarray, shape (B, K), unit of the laws' arguments
    parameter : ndarray, shape (B,), unit of the parameter
    """

    state: Array
    rate: Array
    rows: Array
    parameter: Array

    @cached_property
    def matrix_scale(self) -> Array:
        """Factors that scale a state matrix, shape (B, 1, N, N)."""
        return np.asarray((self.state[:, None, :] / (self.state * self.rate[:, None])[:, :, None])[:, None])

    @cached_property
    def row_scale(self) -> Array:
        """Factors that scale the surfaces, shape (B, 1, K, N)."""
        return np.asarray((self.state[:, None, :] / self.rows[:, :, None])[:, None])

    def of(self, which: NDArray[np.bool_] | NDArray[np.int_]) -> Frame:
        """Return the scales of some of the cycles."""
        return Frame(self.state[which], self.rate[which], self.rows[which], self.parameter[which])


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of B cycles and their derivatives, scaled; m = n + S.

    Attributes
    ----------
    F : ndarray, shape (B, m)
    J : ndarray, shape (B, m, m + 1)
    A, dA : ndarray, shape (B, U, N, N)
        State matrices of the contact states, and their derivatives in the parameter.
    rows, drows : ndarray, shape (B, U, K, N)
        Surfaces in each contact state, and their derivatives in the parameter.
    E : list of ndarray, each of shape (B, S, N, N)
        Transitions over 1/8, 1/4, 1/2 and the whole of each phase.
    L : ndarray, shape (B, S, N, N)
        Derivative of the transitions in the parameter.
    nodes : ndarray, shape (B, S + 1, N)
        States where phases meet.
    moved : ndarray, shape (S + 1, B, N, m + 1)
        Their derivatives in the unknowns.
    """

    F: Array
    J: Array
    A: Array
    dA: Array
    rows: Array
    drows: Array
    E: list[Array]
    L: Array
    nodes: Array
    moved: Array


@dataclass(frozen=True, eq=False)
class Closing:
    """The equations of B cycles that share a sequence of contacts.

    Attributes
    ----------
    model : SwitchedLinear
    sequence : Sequence
    p : ndarray, shape (B, number of parameters)
    place : int
        The parameter that is an unknown.
    frame : Frame
    """

    model: SwitchedLinear
    sequence: Sequence
    p: Array
    place: int
    frame: Frame

    @property
    def n(self) -> int:
        """Number of states."""
        return self.model.N - 1

    @property
    def m(self) -> int:
        """Number of equations."""
        return self.n + self.sequence.S

    def of(self, b: int) -> Closing:
        """Return the equations of one of the cycles."""
        return replace(self, p=self.p[[b]], frame=self.frame.of(np.array([b])))

    def parameters(self, y: Array) -> Array:
        """Return all parameters at the unknowns, shape (B, number of parameters)."""
        p = self.p.copy()
        p[:, self.place] = y[:, -1] * self.frame.parameter
        return p

    def matrices(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return scaled state matrices and surfaces of each contact state, and their derivatives in the parameter."""
        B, f = len(y), self.frame
        states = self.sequence.states
        sides = np.tile(states, (B, 1))
        p = np.repeat(self.parameters(y), len(states), axis=0)
        A, rows, dA, drows = self.model.with_slopes(sides, p, self.place)
        N, K = A.shape[-1], rows.shape[1]
        scale, row_scale = f.matrix_scale, f.row_scale
        by_parameter = f.parameter[:, None, None, None]
        return (
            A.reshape(B, -1, N, N) * scale,
            rows.reshape(B, -1, K, N) * row_scale,
            dA.reshape(B, -1, N, N) * (scale * by_parameter),
            drows.reshape(B, -1, K, N) * (row_scale * by_parameter),
        )

    def linearise(self, y: Array) -> Linearised:
        """Return residuals and derivatives at the unknowns y, shape (B, m + 1)."""
        n, S, sigma, of = self.n, self.sequence.S, self.sequence.sigma, self.sequence.of
        B, N = len(y), self.model.N
        A, rows, dA, drows = self.matrices(y)
        h = y[:, n : n + S]
        E, L = exponentials_with_derivative(A, dA, of, h)
        whole = E[-1]
        moved, nodes = np.zeros((S + 1, B, N, n + S + 1)), np.ones((B, S + 1, N, 1))
        nodes[:, 0, :n, 0] = y[:, :n]
        for i in range(S):
            np.matmul(whole[:, i], nodes[:, i], out=nodes[:, i + 1])
        k, phase = np.arange(n), np.arange(S)
        moved[0, :, k, k] = 1.0
        moved[phase + 1, :, :, n + phase] = (A[:, of] @ nodes[:, 1:])[..., 0].swapaxes(0, 1)
        moved[1:, ..., -1] = (L @ nodes[:, :-1])[..., 0].swapaxes(0, 1)
        for i in range(S):
            moved[i + 1] += whole[:, i] @ moved[i]
        F, J = np.empty((B, n + S)), np.empty((B, n + S, n + S + 1))
        F[:, :n] = nodes[:, S, :n, 0] - sigma * y[:, :n]
        J[:, :n] = moved[S, :, :n]
        J[:, k, k] -= sigma
        row = rows[:, of, self.sequence.events, None]
        F[:, n:] = (row @ nodes[:, 1:])[..., 0, 0]
        J[:, n:] = (row @ moved[1:].swapaxes(0, 1))[:, :, 0]
        J[:, n:, -1] += (drows[:, of, self.sequence.events, None] @ nodes[:, 1:])[..., 0, 0]
        found = Linearised(F, J, A, dA, rows, drows, E, L, nodes[..., 0], moved)
        self._divide(found, h)
        return found

    def _divide(self, at: Linearised, h: Array) -> None:
        """Replace the second condition of each contact on one surface by the difference over its duration."""
        n, touching = self.n, self.sequence.touching
        for i in reversed(touching):
            F, J = at.F[:, n + i], at.J[:, n + i]
            d = h[:, i]
            safe = np.where(d == 0, 1.0, d)
            F[:] = (F - at.F[:, n + i - 1]) / safe
            J[:] = (J - at.J[:, n + i - 1]) / safe[:, None]
            J[:, n + i] -= F / safe
            for b in np.flatnonzero(d == 0):  # the limit at a grazing is the rate of the depth
                u, e = self.sequence.of[i], self.sequence.events[i]
                row, A, x = at.rows[b, u, e], at.A[b, u], at.nodes[b, i]
                F[b] = row @ A @ x
                J[b] = row @ A @ at.moved[i, b]
                J[b, n + i] = row @ A @ A @ x / 2
                J[b, -1] += row @ at.dA[b, u] @ x + at.drows[b, u, e] @ A @ x
