"""Transition matrices of the variational equations along an orbit.

They are exponentials if the system is linear between switchings, and otherwise single Runge-Kutta steps of a fine mesh.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.exponential import exponentials
from hbbogie.model.system import System
from hbbogie.stability.sparse_transitions import group_matrices, in_groups, spectral_radius
from hbbogie.stability.variation import Model, Waveforms

Array = NDArray[np.float64]

# numbers of steps per period
SIZES = tuple(sorted(s * 2**k for s in (256, 384) for k in range(9)))
CHUNK = 64  # steps of one call
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
        Transition matrix of each interval, or, of many states, of each group of neighbouring intervals.
    trace : float
        Integral of the trace of the state matrix over the mesh.
    """

    mesh: Array
    matrices: Array
    trace: float


def transitions_along(waveforms: Waveforms, steps: int | None = None, *, half: bool = False) -> Iterable[Transitions]:
    """Return the transition matrices of each orbit over the period, or its first half.

    Parameters
    ----------
    waveforms : Waveforms
    steps : int or None
        Runge-Kutta steps per full period, even if the mesh covers only half of it. By default the number is chosen
        automatically, or exponentials are used if the system is linear between switchings.
    half : bool
        Whether the mesh ends at pi instead of 2 pi.
    """
    ends, of = waveforms.phases(np.pi if half else 2 * np.pi)
    grouped = in_groups(waveforms.system)
    if waveforms.straight and steps is None and not grouped:
        return _exact(waveforms, ends, of)
    own = np.split(ends, np.flatnonzero(np.diff(of)) + 1)
    meshes = _meshes(waveforms, own, steps, 2 if half else 1)
    if grouped:
        # of one orbit after the other, since those of all would not fit into memory
        return (Transitions(mesh, *group_matrices(waveforms, mesh, k)) for k, mesh in enumerate(meshes))
    return _stepped(waveforms, meshes)


def product(transitions: Array) -> Array:
    """Return the product of the transition matrices, the last one leftmost; not finite where it overflows."""
    with np.errstate(over="ignore", invalid="ignore"):
        while len(transitions) > 1:
            odd = transitions[len(transitions) // 2 * 2 :]
            transitions = np.concatenate([transitions[1::2] @ transitions[: len(transitions) // 2 * 2 : 2], odd])
    return np.asarray(transitions[0])


# --- exponentials -----------------------------------------------------------------------------


def _exact(waveforms: Waveforms, ends: Array, of: NDArray[np.int_]) -> list[Transitions]:
    """Return exponentials over pieces of each phase, short enough for accurate determinants."""
    inner = of[1:] == of[:-1]
    low, length, of = ends[:-1][inner], np.diff(ends)[inner], of[1:][inner]
    h, middle = length / waveforms.omega[of], low + 0.5 * length
    A = _matrices(waveforms, waveforms.states(middle, of), waveforms.lines(middle, of), of)
    A2 = A @ A
    A4 = A2 @ A2
    sizes = np.einsum("sij,sij->s", A4, A4) ** 0.125
    parts = np.maximum(1, np.ceil(sizes * h / LONGEST)).astype(int)
    E = exponentials(A[None], np.arange(len(h)), (h / parts)[None])[-1][0]
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    mesh = np.repeat(low, parts) + place * np.repeat(length / parts, parts)
    traces = np.bincount(of, np.trace(A, axis1=1, axis2=2) * h)
    matrices, begins = np.repeat(E, parts, axis=0), np.flatnonzero(np.diff(np.repeat(of, parts))) + 1
    meshes = (np.append(own, ends[-1]) for own in np.split(mesh, begins))
    return [Transitions(*one) for one in zip(meshes, np.split(matrices, begins), traces.tolist(), strict=True)]


def _matrices(waveforms: Waveforms, x: Array, lines: Array, of: NDArray[np.int_]) -> Array:
    """Return the state matrices at varying states, shape (M, m), and lines, shape (M, n_states, n_states)."""
    n, M = waveforms.system.n_states, len(lines)
    stacked = waveforms.model.matrix(x.T, lines.T, waveforms.p[of].T).full()
    return np.asarray(stacked.reshape(n, M, n).swapaxes(0, 1))


# --- Runge-Kutta steps ------------------------------------------------------------------------


def _meshes(waveforms: Waveforms, ends: list[Array], steps: int | None, parts: int) -> list[Array]:
    """Return the phases of meshes that contain the ends, with the given number of steps in the whole period."""
    if steps is not None:
        return [_mesh(own, max(-(-int(steps) // parts), len(own) - 1)) for own in ends]
    fastest = _fastest_eigenvalues(waveforms, [0.5 * (own[:-1] + own[1:]) for own in ends])
    wanted = 2 * np.pi / waveforms.omega * fastest / STEP_TIMES_EIGENVALUE
    least = [max(N, 10 * waveforms.H, 4 * parts * (len(own) - 1)) for N, own in zip(wanted, ends, strict=True)]
    sizes = [next((s for s in SIZES if s >= N), SIZES[-1]) // parts for N in least]
    return [_mesh(own, N) for own, N in zip(ends, sizes, strict=True)]


def _mesh(ends: Array, N: int) -> Array:
    """Return the phases of a mesh of N steps that contains the ends."""
    end, lengths = ends[-1], np.diff(ends)
    counts = np.maximum(1, np.floor(N * lengths / end).astype(int))
    while counts.sum() < N:
        counts[np.argmax(lengths / counts)] += 1
    while counts.sum() > N:
        counts[np.argmin(np.where(counts > 1, lengths / counts, np.inf))] -= 1
    pieces = [np.linspace(a, b, c, endpoint=False) for a, b, c in zip(ends, ends[1:], counts, strict=False)]
    return np.append(np.concatenate(pieces), end)


def _fastest_eigenvalues(waveforms: Waveforms, midpoints: list[Array]) -> Array:
    """Return the largest eigenvalue modulus of A along each orbit, at midpoints and where its norm is large [1/s]."""
    grids = [np.r_[own[:48], fourier.phases(128)] for own in midpoints]
    of = np.repeat(np.arange(len(grids)), [len(grid) for grid in grids])
    tau = np.concatenate(grids)
    x, lines = waveforms.states(tau, of), waveforms.lines(tau, of)
    norms = waveforms.model.norm(x.T, lines.T, waveforms.p[of].T).full().ravel()
    last = np.cumsum([len(grid) for grid in grids])
    some = [
        np.r_[end - len(grid) : end - 128, end - 128 + np.argsort(norms[end - 128 : end])[-16:]]
        for grid, end in zip(grids, last, strict=True)
    ]
    places = np.concatenate(some)
    if in_groups(waveforms.system):
        last_some = [own[-16:] for own in some]
        return np.array([spectral_radius(waveforms, x[own], lines[own], k) for k, own in enumerate(last_some)])
    A = _matrices(waveforms, x[places], lines[places], of[places])
    first = np.cumsum([0, *map(len, some[:-1])])
    return np.asarray(np.maximum.reduceat(np.abs(np.linalg.eigvals(A)).max(axis=1), first))


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


def _stepped(waveforms: Waveforms, meshes: list[Array]) -> list[Transitions]:
    """Return the transition matrix of each interval of each mesh, and the integrals of the trace by Simpson's rule."""
    system, sizes = waveforms.system, np.array([len(mesh) - 1 for mesh in meshes])
    one = system.once("variation", lambda: _variation(system, waveforms.model))
    buffer, run = system.once(("variation", CHUNK), lambda: one.map(CHUNK)).buffer()
    nodes, whose = np.concatenate(meshes), np.repeat(np.arange(len(meshes)), sizes + 1)
    inner = whose[1:] == whose[:-1]
    of, N, h = whose[1:][inner], int(sizes.sum()), np.diff(nodes)[inner]
    middle, x = nodes[:-1][inner] + 0.5 * h, waveforms.states(nodes, whose)
    states = x[:-1][inner], waveforms.states(middle, of), x[1:][inner]
    given = np.hstack([(h / waveforms.omega[of])[:, None], *states, waveforms.lines(middle, of), waveforms.p[of]])
    given = np.vstack([given, np.repeat(given[-1:], -N % CHUNK, axis=0)])
    out, traces = np.empty((len(given), system.n_states, system.n_states)), np.empty(len(given))
    # memory is shared with CasADi, whose columns are the rows here; conversion would cost as much as the work
    for k in range(0, len(given), CHUNK):
        chunk = slice(k, k + CHUNK)
        buffer.set_arg(0, given[chunk].data)
        buffer.set_res(0, out[chunk].data)
        buffer.set_res(1, traces[chunk].data)
        run()
    begins = np.cumsum(sizes)[:-1]
    matrices, own = np.split(out[:N].transpose(0, 2, 1), begins), np.bincount(of, traces[:N])
    return [Transitions(*one) for one in zip(meshes, matrices, own.tolist(), strict=True)]
