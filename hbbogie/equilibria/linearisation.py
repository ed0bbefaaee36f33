"""The equilibrium and its eigenvalues at successive values of a parameter, followed from rest."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from hbbogie.equilibria import spectrum
from hbbogie.equilibria.rest import Level, Rest
from hbbogie.equilibria.spectrum import state_matrices
from hbbogie.model.singular import singular_terms
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

    def eigen(self, value: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return eigenvalues [1/s], largest real part first, and eigenvectors (columns).

        Raises
        ------
        ConvergenceError
            Where the equations have no derivative at the equilibrium; the message says why.
        """
        system = self.system
        rest = Rest(system, system.parameter_names[self.place], Level.none(system.n))
        q = self.equilibrium(value)
        with np.errstate(all="ignore"):
            A = state_matrices(rest, rest.pencil(np.append(q, value)[None]))[0]
        if not np.isfinite(A).all():
            guilty = ", ".join(singular_terms(system).vanishing(q, self.parameters(value)))
            raise ConvergenceError(
                f"system {system.name!r}: the equations have no derivative at the equilibrium at {rest.parameter} = "
                f"{value:g}{': ' + guilty + ', zero or negative there' if guilty else ''}; look about another one."
            )
        eigenvalues, vectors = spectrum.eigenpairs(A)
        order = np.argsort(-eigenvalues.real, kind="stable")
        return eigenvalues[order], vectors[:, order]

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
