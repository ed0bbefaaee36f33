"""Equilibria and their eigenvalues over one parameter."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]

ELSEWHERE = (0.1, 1.0, 1.0, 10.0, 10.0)  # scatter of further starts in search of an equilibrium


class Linearisation:
    """Equilibrium and eigenvalues of a system over one parameter, all others at the system's values.

    Parameters
    ----------
    system : System
    parameter : str
        Name of the parameter.
    """

    def __init__(self, system: System, parameter: str):
        system.parameter(parameter)
        self.system, self.place = system, system.parameter_names.index(parameter)
        self.p = system.vector()
        self._guess = np.zeros(system.n)

    def parameters(self, value: float) -> Array:
        """Return the parameter vector at a value of the parameter."""
        p = self.p.copy()
        p[self.place] = value
        return p

    def equilibrium(self, value: float) -> Array:
        """Return the equilibrium followed from rest, shape (n,)."""
        p = self.parameters(value)
        zero = np.zeros(self.system.n)
        if not np.any(self.system.residual(zero, zero, zero, p).full()):
            return zero
        residual = self.system.once("equilibrium", lambda: _at_rest(self.system))
        rng = np.random.default_rng(0)
        for size in (0.0, *ELSEWHERE):
            start = self._guess + size * rng.standard_normal(self.system.n)
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                found = root(
                    lambda q: residual(q, p)[0].full().ravel(),
                    start,
                    jac=lambda q: residual(q, p)[1].full(),
                    tol=1e-13,
                )
            r, K = (m.full() for m in residual(found.x, p))
            if np.isfinite(r).all() and np.abs(r).max() <= 1e-9 * max(1.0, float(np.abs(K * found.x).max())):
                self._guess = np.asarray(found.x)
                return self._guess
        raise ConvergenceError(
            f"system {self.system.name!r}: no equilibrium found near {self._guess} at "
            f"{self.system.parameter_names[self.place]} = {value:g}; narrow the range of the parameter."
        )

    def _equilibrium_or_nan(self, value: float) -> Array:
        """Return the equilibrium, NaN where there is none: one value must not end the search over all."""
        try:
            return self.equilibrium(value)
        except ConvergenceError:
            return np.full(self.system.n, np.nan)

    def growth(self, values: Sequence[float] | Array) -> list[Array]:
        """Return the real parts of the oscillating modes [1/s], largest first, at each value of the parameter."""
        system, N = self.system, len(values)
        x, p = np.zeros((system.n_states, N)), np.repeat(self.p[:, None], N, axis=1)
        p[self.place] = values
        residual, jacobian = system.once(
            ("along", N), lambda: (system.residual.map(N), system.ode_jacobian.map(N))
        )  # one call for all values
        rest = np.zeros((system.n, N))
        if np.any(residual(rest, rest, rest, p).full()):
            x[: system.n] = np.transpose([self._equilibrium_or_nan(v) for v in values])
        A = jacobian(x, p).full().reshape(len(x), N, len(x)).swapaxes(0, 1)
        good, found = np.isfinite(A).all(axis=(1, 2)), []
        for k, eigenvalues in enumerate(np.linalg.eigvals(np.where(good[:, None, None], A, 0.0))):
            if not good[k]:
                found.append(np.empty(0))
                continue
            oscillating = eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max(initial=1e-300)
            found.append(-np.sort(-eigenvalues[oscillating].real))
        return found

    def eigen(self, value: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return eigenvalues [1/s], largest real part first, and eigenvectors (columns)."""
        x = np.concatenate([self.equilibrium(value), np.zeros(self.system.n_states - self.system.n)])
        eigenvalues, vectors = np.linalg.eig(self.system.ode_jacobian(x, self.parameters(value)).full())
        order = np.argsort(-eigenvalues.real, kind="stable")
        return eigenvalues[order].astype(complex), vectors[:, order].astype(complex)

    def pairs(self, value: float) -> tuple[Array, NDArray[np.complex128], NDArray[np.complex128]]:
        """Return real parts (largest first), eigenvalues and vectors of the oscillating modes."""
        eigenvalues, vectors = self.eigen(value)
        oscillating = eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max(initial=1e-300)
        return eigenvalues[oscillating].real, eigenvalues[oscillating], vectors[:, oscillating]


def _at_rest(system: System) -> ca.Function:
    """Return (q, p) -> the residual at rest and its derivative in q."""
    q, p = ca.SX.sym("q", system.n), ca.SX.sym("p", len(system.parameters))
    r = system.residual(q, 0, 0, p)
    return ca.Function("at_rest", [q, p], [ca.densify(r), ca.densify(ca.jacobian(r, q))])
