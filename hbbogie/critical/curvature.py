"""Exact second derivatives of critical values in the other parameters, by implicit differentiation."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.critical.folds import Critical
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System

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
        return _of_hopf(system, critical, place, places, p)
    return _of_fold(equations, critical, place, places, p)


def _of_fold(equations: Equations, critical: Critical, place: int, places: tuple[int, ...], p: Array) -> Array:
    equations = equations.phased(critical.orbit)
    m, k = equations.size, len(places)
    z, free = equations.encode(critical.orbit), (place, *places)
    J = equations.derivatives(free)(z, p)[1].full()
    scale = np.concatenate([equations.scale, [max(abs(critical.value), 1e-300)], np.ones(k)])
    rows = equations.residual_scale
    J = J / rows[:, None] * scale
    Jy, Jp = J[:, : m + 1], J[:, m + 1 :]
    # multipliers of the scaled equations, of the value as objective
    multipliers = np.linalg.lstsq(Jy.T, -np.append(np.zeros(m), scale[m]), rcond=None)[0]
    H = equations.hessian(free)(z, p, multipliers / rows).full() * np.outer(scale, scale)
    Hyy, Hyp, Hpp = H[: m + 1, : m + 1], H[: m + 1, m + 1 :], H[m + 1 :, m + 1 :]
    matrix = np.block([[Hyy, Jy.T], [Jy, np.zeros((m, m))]])
    moved = np.linalg.solve(matrix, -np.vstack([Hyp, Jp]))
    result = Hpp + Hyp.T @ moved[: m + 1] + Jp.T @ moved[m + 1 :]
    return np.asarray((result + result.T) / 2)


def _of_hopf(system: System, critical: Critical, place: int, places: tuple[int, ...], p: Array) -> Array:
    n, x = system.n, critical.orbit.coefficients[0]
    v = critical_vector(system, critical, p)
    y = np.concatenate([x, v.real, v.imag, [critical.omega, critical.value]])
    _, first, second = system.once(("hopf conditions", place), lambda: hopf_conditions(system, place))
    Gy, Gp = (g.full() for g in first(y, p, v.real, v.imag))
    # where the equilibrium stays, its equations may be singular and have nothing to say
    kept = np.arange(len(y)) if np.any(Gp[:n]) else np.arange(n, len(y))
    Gy = Gy[np.ix_(kept, kept)]
    along = np.zeros(len(kept))
    along[-1] = 1.0
    mu = np.zeros(len(y))
    mu[kept] = -np.linalg.solve(Gy.T, along)
    columns = np.array(places)
    moved = -np.linalg.solve(Gy, Gp[np.ix_(kept, columns)])
    both = np.concatenate([kept, len(y) + columns])
    H = second(y, p, v.real, v.imag, mu).full()[np.ix_(both, both)]
    T = np.vstack([moved, np.eye(len(columns))])
    return np.asarray(T.T @ H @ T)


def critical_vector(system: System, critical: Critical, p: Array) -> NDArray[np.complex128]:
    """Return the eigenvector of length 1 of a Hopf point, shape (n_states,)."""
    x = np.append(critical.orbit.coefficients[0], np.zeros(system.n_states - system.n))
    values, vectors = np.linalg.eig(system.ode_jacobian(x, p).full())
    v = vectors[:, int(np.argmin(np.abs(values - 1j * critical.omega)))]
    return np.asarray(v / np.linalg.norm(v), dtype=complex)


def hopf_conditions(system: System, place: int) -> tuple[ca.Function, ca.Function, ca.Function]:
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
    casadi.Function, (y, p, real w, imaginary w, mu) -> second derivative of mu . equations in (y, p)
    """
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
    y, mu = ca.vertcat(x, a, b, omega, value), ca.SX.sym("mu", G.numel())
    given = [y, p, w_a, w_b]
    plain = ca.Function("hopf", given, [ca.densify(G)])
    first = ca.Function("hopf_slopes", given, [ca.densify(ca.jacobian(G, s)) for s in (y, p)])
    hessian = ca.hessian(ca.dot(mu, G), ca.vertcat(y, p))[0]
    return plain, first, ca.Function("hopf_curvature", [*given, mu], [ca.densify(hessian)])
