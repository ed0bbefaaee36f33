"""Transition matrices of the variational equations along an orbit.

They are exponentials if the system is linear between switchings, and otherwise single Runge-Kutta steps of a fine mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.exponential import exponentials
from hbbogie.model.system import System
from hbbogie.stability.variation import Model, Waveform

Array = NDArray[np.float64]

# numbers of steps per period; each one used has its own function
SIZES = tuple(sorted(s * 2**k for s in (256, 384) for k in range(9)))
STEP_TIMES_EIGENVALUE = 0.075
LONGEST = 4.0  # size of A h up to which the determinant of an exponential is accurate to round-off


@dataclass(frozen=True, eq=False)
class Transitions:
    """The variational equations over the N intervals of a mesh.

    Attributes
    ----------
    mesh : ndarray, shape (N + 1,), rad
        Its phases include every switching.
    matrices : ndarray, shape (N, n_states, n_states)
        Transition matrix of each interval.
    trace : float
        Integral of the trace of the state matrix over the mesh.
    """

    mesh: Array
    matrices: Array
    trace: float


def transitions_along(waveform: Waveform, steps: int | None = None, *, half: bool = False) -> Transitions:
    """Return the transition matrices over the period, or its first half.

    Parameters
    ----------
    waveform : Waveform
    steps : int or None
        Runge-Kutta steps per full period, even if the mesh covers only half of it. By default the number is chosen
        automatically, or exponentials are used if the system is linear between switchings.
    half : bool
        Whether the mesh ends at pi instead of 2 pi.
    """
    ends = waveform.phases(np.pi if half else 2 * np.pi)
    if waveform.straight and steps is None:
        return _exact(waveform, ends)
    mesh = _mesh(waveform, ends, steps, 2 if half else 1)
    return _stepped(waveform, mesh)


def product(transitions: Array) -> Array:
    """Return the product of the transition matrices, the last one leftmost; not finite where it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        while len(transitions) > 1:
            odd = transitions[len(transitions) // 2 * 2 :]
            transitions = np.concatenate([transitions[1::2] @ transitions[: len(transitions) // 2 * 2 : 2], odd])
    return np.asarray(transitions[0])


# --- exponentials -----------------------------------------------------------------------------


def _exact(waveform: Waveform, ends: Array) -> Transitions:
    """Return exponentials over pieces of each phase, short enough for accurate determinants."""
    h, middle = np.diff(ends) / waveform.omega, 0.5 * (ends[:-1] + ends[1:])
    A = _matrices(waveform, waveform.states(middle), waveform.lines(middle))
    A2 = A @ A
    A4 = A2 @ A2
    sizes = np.einsum("sij,sij->s", A4, A4) ** 0.125
    parts = np.maximum(1, np.ceil(sizes * h / LONGEST)).astype(int)
    E = exponentials(A[None], np.arange(len(h)), (h / parts)[None])[-1][0]
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    mesh = np.repeat(ends[:-1], parts) + place * np.repeat(np.diff(ends) / parts, parts)
    trace = float(np.trace(A, axis1=1, axis2=2) @ h)
    return Transitions(np.append(mesh, ends[-1]), np.repeat(E, parts, axis=0), trace)


def _matrices(waveform: Waveform, x: Array, lines: Array) -> Array:
    """Return the state matrices at varying states, shape (M, m), and lines, shape (M, n_states, n_states)."""
    n, M = waveform.system.n_states, len(lines)
    stacked = waveform.model.matrix(x.T, lines.T, waveform.p).full()
    return np.asarray(stacked.reshape(n, M, n).swapaxes(0, 1))


# --- Runge-Kutta steps ------------------------------------------------------------------------


def _mesh(waveform: Waveform, ends: Array, steps: int | None, parts: int) -> Array:
    """Return the phases of a mesh that contains the ends, with the given number of steps in the whole period."""
    end = ends[-1]
    lengths = np.diff(ends)
    if steps is None:
        fastest = _fastest_eigenvalue(waveform, 0.5 * (ends[:-1] + ends[1:]))
        wanted = 2 * np.pi / waveform.omega * fastest / STEP_TIMES_EIGENVALUE
        wanted = max(wanted, 10 * waveform.H, 4 * parts * len(lengths))
        N = next((s for s in SIZES if s >= wanted), SIZES[-1]) // parts
    else:
        N = max(-(-int(steps) // parts), len(lengths))
    counts = np.maximum(1, np.floor(N * lengths / end).astype(int))
    while counts.sum() < N:
        counts[np.argmax(lengths / counts)] += 1
    while counts.sum() > N:
        counts[np.argmin(np.where(counts > 1, lengths / counts, np.inf))] -= 1
    pieces = [np.linspace(a, b, c, endpoint=False) for a, b, c in zip(ends, ends[1:], counts, strict=False)]
    return np.append(np.concatenate(pieces), end)


def _fastest_eigenvalue(waveform: Waveform, midpoints: Array) -> float:
    """Return the largest eigenvalue modulus of A at the midpoints and where its norm is large [1/s]."""
    grid = np.r_[midpoints[:48], fourier.phases(128)]
    x, lines = waveform.states(grid), waveform.lines(grid)
    norms = waveform.model.norm(x.T, lines.T, waveform.p).full().ravel()
    some = np.r_[: len(grid) - 128, len(grid) - 128 + np.argsort(norms[-128:])[-16:]]
    return float(np.abs(np.linalg.eigvals(_matrices(waveform, x[some], lines[some]))).max())


def _variation(system: System, model: Model) -> ca.Function:
    """Return one interval's transition matrix and integral of the trace, functions of (h, states, lines, p).

    The varying states are given at the start, the middle and the end of the interval, where the Runge-Kutta stages, and
    Simpson's rule for the trace, need them.
    """
    size, m = system.n_states, len(model.varying)
    Phi, s, h = ca.SX.sym("Phi", size**2), ca.SX.sym("s"), ca.SX.sym("h")
    start, middle, end = (ca.SX.sym(name, m) for name in ("start", "middle", "end"))
    lines = ca.SX.sym("lines", model.matrix.size1_in(1))
    p = ca.SX.sym("p", len(system.parameters))
    x = (2 * s - 1) * (s - 1) * start + 4 * s * (1 - s) * middle + s * (2 * s - 1) * end
    rate = h * ca.mtimes(model.matrix(x, lines, p), ca.reshape(Phi, size, size))
    given = ca.vertcat(h, start, middle, end, lines, p)
    problem = {"x": Phi, "t": s, "p": given, "ode": ca.vec(rate)}
    options = {"number_of_finite_elements": 1, "simplify": True}
    integrator = ca.integrator("variation", "rk", problem, 0.0, 1.0, options)
    # starting from the identity matrix, expansion to scalar operations is twice as fast
    matrix = integrator(x0=ca.vec(ca.DM.eye(size)), p=given)["xf"]
    traces = [weight * ca.trace(model.matrix(x, lines, p)) for weight, x in ((1, start), (4, middle), (1, end))]
    return ca.Function("transition", [given], [matrix, h / 6 * ca.sum1(ca.vertcat(*traces))])


def _stepped(waveform: Waveform, mesh: Array) -> Transitions:
    """Return the transition matrix of each interval of a mesh, and the integral of the trace by Simpson's rule."""
    system, N = waveform.system, len(mesh) - 1
    one = system.once("variation", lambda: _variation(system, waveform.model))
    buffer, run = system.once(("variation", N), lambda: one.map(N)).buffer()
    middle = 0.5 * (mesh[:-1] + mesh[1:])
    x, x_middle = np.split(waveform.states(np.r_[mesh, middle]), [N + 1])
    h = np.diff(mesh)[:, None] / waveform.omega
    p = np.broadcast_to(waveform.p, (N, len(waveform.p)))
    given = np.hstack([h, x[:-1], x_middle, x[1:], waveform.lines(middle), p])
    out, traces = np.empty((N, system.n_states, system.n_states)), np.empty(N)
    # memory is shared with CasADi, whose columns are the rows here; conversion would cost as much as the work
    buffer.set_arg(0, given.data)
    buffer.set_res(0, out.data)
    buffer.set_res(1, traces.data)
    run()
    return Transitions(mesh, out.transpose(0, 2, 1), float(traces.sum()))
