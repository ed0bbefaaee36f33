"""Normal form of a Hopf point: the first Lyapunov coefficient, whose sign tells sub- from supercritical onset."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
ROUND_OFF = 1e-11  # share of the terms below which their sum counts as zero
WORST = 1e14  # condition number that counts as singular
STEPS = (1e-5, 1e-6)  # distances from the equilibrium at which one-sided derivatives are compared


@door(system=System, hopf=SpecialPoint)
def first_lyapunov(system: System, hopf: SpecialPoint) -> float:
    """Return the first Lyapunov coefficient of a Hopf point (eq-lyapunov).

    Negative: supercritical, small stable cycles beside the unstable equilibrium. Positive: subcritical, small
    unstable cycles beside the stable equilibrium. Only the sign is free of the choice of units: the critical
    eigenvector has length 1 in the units of the states. The derivatives of second and third order are exact.

    Parameters
    ----------
    system : System
    hopf : SpecialPoint
        As from `hopf_points`; its orbit holds the equilibrium, the frequency and all parameter values.

    Returns
    -------
    float, 1
        Zero where the equations are linear about the equilibrium, as below a gap: the onset is then decided where the
        gap closes. NaN where there is no such coefficient: the equations have a kink at the equilibrium itself, or
        an eigenvalue 0 or 2 i omega besides.

    Raises
    ------
    ModelError
        When the point is no Hopf point.

    References
    ----------
    Yu. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 5.4 (eq-lyapunov).
    """
    if hopf.kind != "hopf":
        raise ModelError(f"first_lyapunov: got a special point of kind {hopf.kind!r}; give one of kind 'hopf'.")
    x = np.concatenate([hopf.orbit.coefficients[0], np.zeros(system.n_states - system.n)])
    return lyapunov_at(system, x, system.vector(**hopf.orbit.parameters), hopf.omega)


def lyapunov_at(system: System, x: Array, p: Array, omega: float) -> float:
    """Return the first Lyapunov coefficient at an equilibrium with a pair of eigenvalues +-i omega.

    Parameters
    ----------
    system : System
    x : ndarray, shape (n_states,), units of the states
        The equilibrium.
    p : ndarray, shape (number of parameters,)
    omega : float, rad/s
    """
    A = system.state_matrix(x, p)
    q = _eigenvector(A, 1j * omega)
    if _has_kink(system, x, p, q):
        return float("nan")
    w = _eigenvector(A.T, -1j * omega)
    w = w / np.conj(np.vdot(w, q))  # <w, q> = 1
    f = system.once("third derivatives", lambda: _directional(system))

    def second(a: Complex, b: Complex) -> Complex:
        rr, ii, ri, ir = (
            _pair(f(x, p, s, t, t))[0]
            for s, t in ((a.real, b.real), (a.imag, b.imag), (a.real, b.imag), (a.imag, b.real))
        )
        return np.asarray(rr - ii + 1j * (ri + ir))

    resonance = 2j * omega * np.eye(len(A)) - A
    if max(np.linalg.cond(A), np.linalg.cond(resonance)) > WORST:
        return float("nan")
    u, v, bar = q.real, q.imag, np.asarray(np.conj(q), dtype=complex)
    along = ((1, u, u), (1, u, v), (1j, v, u), (1j, v, v))  # q q bar(q) = (u u + v v) (u + i v)
    third = np.sum([factor * _pair(f(x, p, s, t, t))[1] for factor, s, t in along], axis=0)
    mean = np.asarray(np.linalg.solve(A, second(q, bar)))
    double = np.asarray(np.linalg.solve(resonance, second(q, q)))
    parts = np.array([third, -2 * second(q, mean), second(bar, double)])
    found, size = float((np.conj(w) @ parts.sum(axis=0)).real), float((np.abs(parts) @ np.abs(w)).sum())
    return found / (2 * omega) if abs(found) > ROUND_OFF * size else 0.0


def _pair(values: tuple[ca.DM, ca.DM]) -> tuple[Array, Array]:
    return values[0].full().ravel(), values[1].full().ravel()


def _eigenvector(A: Array, value: complex) -> Complex:
    """Return the unit eigenvector of the eigenvalue nearest to a value."""
    values, vectors = np.linalg.eig(A)
    vector = vectors[:, int(np.argmin(np.abs(values - value)))].astype(complex)
    return np.asarray(vector / np.linalg.norm(vector))


def _directional(system: System) -> ca.Function:
    """Return (x, p, a, b, c) -> second derivative of the rates along a, b and third along a, b, c."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    a, b, c = (ca.SX.sym(s, system.n_states) for s in "abc")
    two = ca.jtimes(ca.jtimes(system.ode(x, p), x, a), x, b)
    return ca.Function("third_derivatives", [x, p, a, b, c], [ca.densify(d) for d in (two, ca.jtimes(two, x, c))])


def _has_kink(system: System, x: Array, p: Array, q: Complex) -> bool:
    """Tell whether first or second derivatives jump at the equilibrium, in the plane of the critical mode.

    The difference between the two sides shrinks with the distance from the equilibrium where they are continuous.
    """
    f = system.once("third derivatives", lambda: _directional(system))

    def difference(direction: Array, distance: float) -> tuple[float, float]:
        y = [x + sign * distance * direction for sign in (1, -1)]
        A = [system.state_matrix(s, p) @ plane for s in y]
        B = [np.column_stack([_pair(f(s, p, d, d, d))[0] for d in plane.T]) for s in y]
        return float(np.abs(A[0] - A[1]).max()), float(np.abs(B[0] - B[1]).max())

    plane = np.column_stack([q.real, q.imag, q.real + q.imag])
    noise = 1e-9 * float(np.abs(system.state_matrix(x, p)).max())
    for direction in plane.T:
        far, near = (difference(direction, step) for step in STEPS)
        if any(b > noise and b > 0.5 * a for a, b in zip(far, near, strict=True)):
            return True
    return False
