"""The equations of a Hopf point, F = 0, P(i omega) z = 0, c.z = 1, and their solution by Newton's method."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.rest import Rest
from hbbogie.equilibria.spectrum import eigenpairs_near, state_matrices
from hbbogie.solving.newton import Buffered

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def confirm(rest: Rest, metric: Array, u: Array, value: complex) -> tuple[Array, Complex, float] | None:
    """Solve F = 0, P(i omega) z = 0, c.z = 1 by Newton's method from near by; return u, z and omega, or nothing."""
    n, k = rest.system.n, rest.level.k
    values, vectors = eigenpairs_near(state_matrices(rest, rest.pencil(u[None]))[0], value)
    nearest = int(np.argmin(np.abs(values - value)))
    z, omega = vectors[:n, nearest], float(value.imag)
    largest = np.abs(z / metric[:n]).max()
    if not largest > 0:
        return None
    z = z / largest
    c = np.conj(z / metric[:n]) / np.linalg.norm(z / metric[:n]) ** 2 / metric[:n]
    f = rest.system.once(("hopf equations", rest.place), lambda: Buffered(_hopf_equations(rest)))
    x = np.concatenate([u[:n], u[n:-1], z.real, z.imag, [omega], u[-1:]])
    size = np.concatenate([metric[:n], np.ones(k), metric[:n], metric[:n], [omega], metric[-1:]])
    for solve in (np.linalg.solve, _shortest):
        y, last = x.copy(), np.inf
        for _ in range(15):
            G, J = _bordered(rest, f, y, c)
            rows = np.abs(J * size).sum(axis=1)
            rows = np.where(rows > 0, rows, 1.0)
            try:
                step = solve(J * size / rows[:, None], -G / rows)
            except (np.linalg.LinAlgError, ValueError):
                break
            moved = float(np.abs(np.delete(step, np.s_[n : n + k])).max())
            if not moved < 10.0:
                break
            y = y + size * step
            if moved <= 1e-13 or (moved >= last and last <= 1e-9):
                v = np.concatenate([y[: n + k], y[-1:]])
                return v, y[n + k : 2 * n + k] + 1j * y[2 * n + k : 3 * n + k], float(y[-2])
            last = moved
    return None


def _shortest(J: Array, G: Array) -> Array:
    """Return the shortest step: of several pairs together, modes form a space."""
    return np.asarray(np.linalg.lstsq(J, G, rcond=1e-9)[0])


def _bordered(rest: Rest, f: Buffered, y: Array, c: Complex) -> tuple[Array, Array]:
    """Return the equations of a Hopf point and their Jacobian, with what is held and the norm of the mode."""
    n, k, level = rest.system.n, rest.level.k, rest.level
    re, im = slice(n + k, 2 * n + k), slice(2 * n + k, 3 * n + k)
    free = np.concatenate([y[:n], y[n + k :]])
    G0, J0 = f(free, rest.p)
    G, J = np.zeros(len(y)), np.zeros((len(y), len(y)))
    G[: 3 * n] = G0.ravel()
    G[:n] += level.directions @ y[n : n + k]
    J[: 3 * n, :n], J[: 3 * n, n + k :] = J0[:, :n], J0[:, n:]
    J[:n, n : n + k] = level.directions
    G[3 * n : 3 * n + k], J[3 * n : 3 * n + k, :n] = level.rows @ y[:n] - level.held, level.rows
    norm = c @ (y[re] + 1j * y[im]) - 1
    G[-2:] = norm.real, norm.imag
    J[-2, re], J[-2, im], J[-1, re], J[-1, im] = c.real, -c.imag, c.imag, c.real
    return G, J


def _hopf_equations(rest: Rest) -> ca.Function:
    """Return ((q, re z, im z, omega, parameter), p) -> (r, re P z, im P z) and its Jacobian, P = K + D s + M s^2."""
    n = rest.system.n
    x, p = ca.SX.sym("x", 3 * n + 2), ca.SX.sym("p", len(rest.p))
    q, v, a = (ca.SX.sym(s, n) for s in "qva")
    shifted = ca.SX(p)
    shifted[rest.place] = x[3 * n + 1]
    r, qva = rest.system.residual(q, v, a, shifted), ca.vertcat(q, v, a)
    re, im, omega = x[n : 2 * n], x[2 * n : 3 * n], x[3 * n]

    def along(real: ca.SX, imag: ca.SX) -> ca.SX:
        return ca.jtimes(r, qva, ca.vertcat(real, -omega * imag, -(omega**2) * real))

    G = ca.substitute(ca.vertcat(r, along(re, im), along(im, -re)), qva, ca.vertcat(x[:n], ca.SX.zeros(2 * n)))
    return ca.Function("hopf", [x, p], [ca.densify(G), ca.densify(ca.jacobian(G, x))])
