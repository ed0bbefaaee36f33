"""Transition matrices of the variational equations along an orbit.

They are exponentials if the system is linear between switchings, and otherwise those of Gauss collocation. Of many
states they are products of Runge-Kutta steps with a sparse state matrix.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.exponential import exponentials
from hbbogie.model.stacked import at_each
from hbbogie.stability.gauss_elements import Elements, over_elements
from hbbogie.stability.sparse_transitions import group_matrices, in_groups, runge_kutta_steps
from hbbogie.stability.variation import Waveforms

Array = NDArray[np.float64]

FIRST = 32  # elements of a period before any is divided
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


def transitions_along(
    waveforms: Waveforms, steps: int | None = None, *, half: bool = False, pieces: int = 1
) -> Iterable[Transitions]:
    """Return the transition matrices of each orbit over the period, or its first half.

    Parameters
    ----------
    waveforms : Waveforms
    steps : int or None
        Elements, or Runge-Kutta steps, per full period, even if the mesh covers only half of it. By default elements
        are divided until they are accurate, or exponentials are used if the system is linear between switchings.
    half : bool
        Whether the mesh ends at pi instead of 2 pi.
    pieces : int
        Into how many each element is divided in the end, for integrals over the mesh.
    """
    ends, of = waveforms.phases(np.pi if half else 2 * np.pi)
    grouped = in_groups(waveforms.system)
    if waveforms.straight and steps is None and not grouped:
        return _exact(waveforms, ends, of)
    own, parts = np.split(ends, np.flatnonzero(np.diff(of)) + 1), 2 if half else 1
    if grouped:
        # of one orbit after the other, since those of all would not fit into memory
        counts = (steps or runge_kutta_steps(waveforms, ends, k, parts) for k, ends in enumerate(own))
        fine = (_mesh(ends, max(-(-count // parts), len(ends) - 1)) for ends, count in zip(own, counts, strict=True))
        return (Transitions(mesh, *group_matrices(waveforms, mesh, k)) for k, mesh in enumerate(fine))
    meshes = [_mesh(ends, max(-(-(steps or FIRST) // parts), len(ends) - 1)) for ends in own]
    return _collocated(waveforms, meshes, steps is None, pieces)


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
    along = waveforms.states(middle, of), waveforms.lines(middle, of), waveforms.p[of]
    A = at_each(waveforms.system.once, waveforms.model.matrix, *along)
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


# --- elements -----------------------------------------------------------------------------------


def _collocated(waveforms: Waveforms, meshes: list[Array], divide: bool, pieces: int) -> list[Transitions]:
    """Return transition matrices of Gauss collocation over the intervals of one mesh of each orbit, or their parts."""
    sizes, ends = [len(mesh) - 1 for mesh in meshes], np.array([mesh[-1] for mesh in meshes])
    begin, length = (np.concatenate([part(mesh) for mesh in meshes]) for part in (lambda m: m[:-1], np.diff))
    given = Elements(np.repeat(np.arange(len(meshes)), sizes), begin, length)
    found, matrices, traces = over_elements(waveforms, given, divide=divide, pieces=pieces)
    first = np.flatnonzero(np.diff(found.of)) + 1
    every = zip(np.split(found.begin, first), np.split(matrices, first), np.split(traces, first), ends, strict=True)
    return [Transitions(np.append(mesh, end), own, float(trace.sum())) for mesh, own, trace, end in every]


def _mesh(ends: Array, N: int) -> Array:
    """Return the phases of a mesh of N steps that contains the ends."""
    if len(ends) == 2:
        return np.linspace(ends[0], ends[1], N + 1)
    end, lengths = ends[-1], np.diff(ends)
    counts = np.maximum(1, np.floor(N * lengths / end).astype(int))
    while counts.sum() < N:
        counts[np.argmax(lengths / counts)] += 1
    while counts.sum() > N:
        counts[np.argmin(np.where(counts > 1, lengths / counts, np.inf))] -= 1
    pieces = [np.linspace(a, b, c, endpoint=False) for a, b, c in zip(ends, ends[1:], counts, strict=False)]
    return np.append(np.concatenate(pieces), end)
