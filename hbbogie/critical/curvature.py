"""Exact second derivatives of critical values in the other parameters, by implicit differentiation."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.critical.folds import Critical
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint

Array = NDArray[np.float64]


def critical_hessian(equations: Equations, critical: Critical, names: Sequence[str]) -> Array:
    """Return the second derivatives of a critical value in some parameters, without differences.

    Parameters
    ----------
    equations : Equations
        Those with which a fold was found; of a Hopf point only their system is used.
    critical : Critical
        A fold or a Hopf point with its gradient.
    names : sequence of str
        Parameters other than the one whose critical value it is; k of them.

    Returns
    -------
    ndarray, shape (k, k), unit of the value per units of both parameters

    Notes
    -----
    At a fold the conditions of optimality (eq-fold-optimality) hold for all parameters pi. Their derivative is one
    linear system for dy/dpi and dlambda/dpi, y = (z, p), whose matrix is the one of Newton's method; the derivative of
    the gradient lambda . F_pi (eq-fold-gradient) follows from these and the second derivatives of lambda . F.
    A Hopf point is the root of as many equations as unknowns, those of the equilibrium and of the critical
    eigenvector.
    """
    system = equations.system
    places = tuple(system.parameter_names.index(system.parameter(n).name) for n in names)
    place = system.parameter_names.index(critical.parameter)
    p = system.vector(**critical.orbit.parameters)
    p[place] = critical.value
    if critical.kind == "hopf":
        return _of_hopf(system, critical, places, p)
    return _of_fold(equations, critical, place, places, p)


def fold_motion(equations: Equations, critical: Critical, names: Sequence[str]) -> Array:
    """Return the derivatives of a fold's unknowns z and of its value in k parameters, shape (m + 1, k).

    Parameters
    ----------
    equations : Equations
        Those with which the fold was found, in the phase of its orbit.
    critical : Critical
        A fold.
    names : sequence of str
        As of `critical_hessian`.
    """
    system = equations.system
    places = tuple(system.parameter_names.index(system.parameter(n).name) for n in names)
    p = system.vector(**critical.orbit.parameters)
    place = system.parameter_names.index(critical.parameter)
    p[place] = critical.value
    fold = _FoldConditions(equations, critical, place, places, p)
    m = equations.size
    return np.asarray(fold.moved[: m + 1] * fold.scale[: m + 1, None])


def _of_fold(equations: Equations, critical: Critical, place: int, places: tuple[int, ...], p: Array) -> Array:
    fold = _FoldConditions(equations.phased(critical.orbit), critical, place, places, p)
    result = fold.hessian + fold.slopes.T @ fold.moved
    return np.asarray((result + result.T) / 2)


class _FoldConditions:
    """The derivative of the scaled conditions of a fold in some parameters.

    Attributes
    ----------
    scale : ndarray, shape (m + 1 + k,)
    slopes : ndarray, shape (2 m + 1, k)
        Of the conditions of optimality and of the equations, in the parameters.
    hessian : ndarray, shape (k, k)
        Second derivatives of multipliers . F in the parameters.
    moved : ndarray, shape (2 m + 1, k)
        Derivatives of the unknowns, of the value and of the multipliers in the parameters.
    """

    def __init__(self, equations: Equations, critical: Critical, place: int, places: tuple[int, ...], p: Array):
        m, k = equations.size, len(places)
        z, free = equations.encode(critical.orbit), (place, *places)
        J = equations.derivatives(free)(z, p)[1].full()
        self.scale = scale = np.concatenate([equations.scale, [max(abs(critical.value), 1e-300)], np.ones(k)])
        rows = equations.residual_scale
        J = J / rows[:, None] * scale
        Jy, Jp = J[:, : m + 1], J[:, m + 1 :]
        # multipliers of the scaled equations, of the value as objective
        multipliers = np.linalg.lstsq(Jy.T, -np.append(np.zeros(m), scale[m]), rcond=None)[0]
        H = equations.hessian(free)(z, p, multipliers / rows).full() * np.outer(scale, scale)
        matrix = np.block([[H[: m + 1, : m + 1], Jy.T], [Jy, np.zeros((m, m))]])
        self.slopes, self.hessian = np.vstack([H[: m + 1, m + 1 :], Jp]), H[m + 1 :, m + 1 :]
        self.moved = np.linalg.solve(matrix, -self.slopes)


class HopfConditions:
    """The conditions of a Hopf point, at the point: their derivatives, and multipliers with its value as objective.

    Parameters
    ----------
    system : System
    hopf : Critical or SpecialPoint
    p : ndarray, shape (number of parameters,)

    Attributes
    ----------
    eigenvalue : complex, 1/s
    y : ndarray, shape (m,)
        The unknowns of `hopf_conditions`.
    w : tuple of ndarray, shape (n_states,)
        Real and imaginary part of the eigenvector, of length 1.
    by_unknowns, by_parameters : ndarray, shapes (m, m) and (m, number of parameters)
    kept : ndarray of int
        Equations and unknowns that count. Where the equilibrium stays, its equations may be singular and have nothing
        to say.
    multipliers : ndarray, shape (m,)
        Their product with ``by_parameters`` is the gradient of the value.
    """

    def __init__(self, system: System, hopf: Critical | SpecialPoint, p: Array):
        n, x = system.n, hopf.orbit.coefficients[0]
        self.p, self.place = p, system.parameter_names.index(hopf.parameter)
        values, vectors = np.linalg.eig(system.ode_jacobian(np.append(x, np.zeros(system.n_states - n)), p).full())
        k = int(np.argmin(np.abs(values - 1j * hopf.omega)))
        self.eigenvalue, v = complex(values[k]), vectors[:, k]  # of length 1
        self.y, self.w = np.concatenate([x, v.real, v.imag, [hopf.omega, hopf.value]]), (v.real, v.imag)
        first = system.once(("hopf conditions", self.place), lambda: hopf_conditions(system, self.place))[1]
        self.by_unknowns, self.by_parameters = (g.full() for g in first(self.y, p, *self.w))
        moves = np.any(self.by_parameters[:n]) or np.any(self.by_unknowns[:n, -1])
        self.kept = np.arange(0 if moves else n, len(self.y))
        along = np.zeros(len(self.kept))
        along[-1] = 1.0
        self.multipliers = np.zeros(len(self.y))
        self.multipliers[self.kept] = -np.linalg.solve(self.by_unknowns[np.ix_(self.kept, self.kept)].T, along)


def _of_hopf(system: System, critical: Critical, places: tuple[int, ...], p: Array) -> Array:
    at = HopfConditions(system, critical, p)
    second = system.once(("hopf curvature", at.place), lambda: _hopf_curvature(system, at.place))
    columns = np.array(places)
    moved = -np.linalg.solve(at.by_unknowns[np.ix_(at.kept, at.kept)], at.by_parameters[np.ix_(at.kept, columns)])
    both = np.concatenate([at.kept, len(at.y) + columns])
    H = second(at.y, p, *at.w, at.multipliers).full()[np.ix_(both, both)]
    T = np.vstack([moved, np.eye(len(columns))])
    return np.asarray(T.T @ H @ T)


def hopf_conditions(system: System, place: int) -> tuple[ca.Function, ca.Function]:
    """Return the equations of a Hopf point, as many as unknowns, and their derivatives.

    The unknowns y are equilibrium, real and imaginary part of the eigenvector v, omega and the value; the equations
    are those of the equilibrium, A v = i omega v, and w . v = 1 with a constant vector w.

    Parameters
    ----------
    system : System
    place : int
        Place of the parameter whose value is among the unknowns.

    Returns
    -------
    casadi.Function, (y, p, real w, imaginary w) -> equations
    casadi.Function, (y, p, real w, imaginary w) -> derivatives in y, in p
    """
    given, G = _symbolic_conditions(system, place)
    plain = ca.Function("hopf", given, [ca.densify(G)])
    return plain, ca.Function("hopf_slopes", given, [ca.densify(ca.jacobian(G, s)) for s in given[:2]])


def _hopf_curvature(system: System, place: int) -> ca.Function:
    """Return (y, p, real w, imaginary w, mu) -> second derivative of mu . equations in (y, p)."""
    given, G = _symbolic_conditions(system, place)
    mu = ca.SX.sym("mu", G.numel())
    hessian = ca.hessian(ca.dot(mu, G), ca.vertcat(*given[:2]))[0]
    return ca.Function("hopf_curvature", [*given, mu], [ca.densify(hessian)])


def _symbolic_conditions(system: System, place: int) -> tuple[list[ca.SX], ca.SX]:
    """Return y, p, real w, imaginary w, and the equations of a Hopf point in them."""
    n, N = system.n, system.n_states
    x, a, b = ca.SX.sym("x", n), ca.SX.sym("a", N), ca.SX.sym("b", N)
    omega, value = ca.SX.sym("omega"), ca.SX.sym("value")
    p, w_a, w_b = ca.SX.sym("p", len(system.parameters)), ca.SX.sym("w_a", N), ca.SX.sym("w_b", N)
    at = ca.SX(p)
    at[place] = value
    A = system.ode_jacobian(ca.vertcat(x, ca.SX.zeros(N - n)), at)
    G = ca.vertcat(
        system.residual(x, 0, 0, at),
        A @ a + omega * b,
        A @ b - omega * a,
        ca.dot(w_a, a) + ca.dot(w_b, b) - 1,
        ca.dot(w_a, b) - ca.dot(w_b, a),
    )
    return [ca.vertcat(x, a, b, omega, value), p, w_a, w_b], G
