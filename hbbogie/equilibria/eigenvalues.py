"""Eigenvalues of the linearisation at an equilibrium, with their first and second derivatives in the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class Eigenvalues:
    """Eigenvalues at an equilibrium and their derivatives, for simple eigenvalues.

    Parameters
    ----------
    system : System
    rest : ndarray, shape (n,)
        The equilibrium.
    p : ndarray, shape (number of parameters,)

    Attributes
    ----------
    values : ndarray of complex, shape (n_states,), 1/s
    slopes : ndarray of complex, shape (n_states, number of parameters)
        First derivatives; an equilibrium that moves with the parameters is taken along.
    moving : bool
        Whether it does; second derivatives are then not known.

    Raises
    ------
    ConvergenceError
        Where eigenvectors coincide, so that there are no derivatives.
    """

    def __init__(self, system: System, rest: Array, p: Array):
        N = system.n_states
        self.system, self.x, self.p = system, np.append(rest, np.zeros(N - system.n)), p
        first, self._second = system.once("state matrix slopes", lambda: _state_matrix_slopes(system))
        A_p, A_x, K, r_p = (m.full() for m in first(self.x, p))
        self.moving = bool(np.any(r_p))
        if self.moving:
            A_p = A_p - A_x @ np.linalg.solve(K, r_p)
        values, V = np.linalg.eig(system.state_matrix(self.x, p))
        try:
            W = np.linalg.inv(V)
        except np.linalg.LinAlgError:
            raise ConvergenceError(
                f"system {system.name!r}: eigenvectors coincide, their derivatives do not exist."
            ) from None
        self.values: Complex = values.astype(complex)
        # W A_k V for every parameter k, shape (N, N, number of parameters)
        self._turned = np.einsum("ia,abk,bj->ijk", W, A_p.reshape(N, N, -1, order="F"), V)
        self.slopes: Complex = np.einsum("iik->ik", self._turned).astype(complex)
        self._V, self._W = V.astype(complex), W.astype(complex)

    def hessian(self, i: int, places: Sequence[int]) -> Complex:
        """Return the second derivatives of an eigenvalue in some parameters, shape (k, k).

        Parameters
        ----------
        i : int
            Place of the eigenvalue.
        places : sequence of int
            Of the parameters.
        """
        v, w = self._V[:, i], self._W[i]
        curved = np.zeros((len(places), len(places)), dtype=complex)
        for a, factor in ((w.real, 1.0), (w.imag, 1j)):
            for b, other in ((v.real, 1.0), (v.imag, 1j)):
                H = self._second(self.x, self.p, a, b).full()
                curved += factor * other * H[np.ix_(places, places)]
        others = np.arange(len(self.values)) != i
        out, back = self._turned[i][others][:, places], self._turned[others, i][:, places]
        mixed = (out / (self.values[i] - self.values[others])[:, None]).T @ back
        return np.asarray(curved + mixed + mixed.T)


def _state_matrix_slopes(system: System) -> tuple[ca.Function, ca.Function]:
    """Return (x, p) -> derivatives of the state matrix A in p and q, and of the residual at rest in q and p.

    And (x, p, a, b) -> second derivatives of a . A b in p.
    """
    n, N = system.n, system.n_states
    x, p, a, b = ca.SX.sym("x", N), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("a", N), ca.SX.sym("b", N)
    A = ca.densify(system.ode_jacobian(x, p))
    r = system.residual(x[:n], 0, 0, p)
    out = [ca.jacobian(ca.vec(A), p), ca.jacobian(ca.vec(A), x)[:, :n], ca.jacobian(r, x)[:, :n], ca.jacobian(r, p)]
    first = ca.Function("state_matrix_slopes", [x, p], [ca.densify(m) for m in out])
    second = ca.hessian(ca.bilin(A, a, b), p)[0]
    return first, ca.Function("state_matrix_curvature", [x, p, a, b], [ca.densify(second)])
