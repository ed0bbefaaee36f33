"""Transition matrices of smooth variational equations: Gauss collocation on elements, those of all orbits at once.

The elements do not depend on each other, since each begins with the identity matrix. What is left of the equations at
both ends of an element tells its error. Elements with too large an error are divided, and the others are kept. Most of
those that are divided are recognised by their state matrix, before anything is solved for.

The unknowns at the Gauss points are the rates of the coordinates of first order and the accelerations of the others,
whose velocities and positions are integrals. The time is the phase, and every state is taken in units of its size.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import casadi as ca
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from hbbogie.model.stacked import at_each
from hbbogie.model.system import System
from hbbogie.stability.variation import Model, Waveforms

Array = NDArray[np.float64]
Places = NDArray[np.int_]

STAGES = 6  # Gauss points of an element, which give order 12 at its end
TOLERANCE = 1e-9  # largest error of an element's transition matrix, in states of size 1
PIECES, ROUNDS = 4, 12  # most pieces of an element that is divided, and how often that is done
MOST = 2**14  # elements of an orbit beyond which none is divided
AT_REST = 1e-6  # smallest size of a coordinate that counts, relative to the largest
FEW, BLOCK = 2**16, 4  # numbers of the matrices that are factorised together, and blocks evaluated together
HOPELESS = 4.0  # errors of which the state matrix alone tells, in tolerances, from which nothing is solved for


def _weights() -> tuple[Array, Array, Array, Array, Array]:
    """Return the Gauss points, points beside them, what the values at the Gauss points give there, and weights.

    The values give the polynomial through them, its integral from 0 and the integral of that, each of shape (points,
    STAGES): at the Gauss points, and at both ends and in between. The weights are those of the latter in a quadrature
    of all points, by which it differs from Gauss's.
    """
    x = legendre.leggauss(STAGES)[0]
    beside = np.r_[-1.0, 0.5 * (x[1:] + x[:-1]), 1.0]
    polynomials = [np.linalg.inv(legendre.legvander(x, STAGES - 1))]
    for _ in range(2):
        polynomials.append(0.5 * legendre.legint(polynomials[-1], lbnd=-1))
    inside, around = (np.stack([legendre.legval(at, c).T for c in polynomials]) for at in (x, beside))
    every = np.r_[x, beside]
    weights = np.linalg.inv(legendre.legvander(every, len(every) - 1))[0, STAGES:]  # of the mean over the element
    return (x + 1) / 2, (beside + 1) / 2, inside, around, np.asarray(weights)


NODES, BESIDE, INSIDE, AROUND, WEIGHTS = _weights()
SAMPLES = np.r_[NODES, BESIDE]  # where the state matrix is needed
MEAN = legendre.leggauss(STAGES)[1] / 2
BETWEEN = AROUND[0]  # from values at the Gauss points to those beside
PADE = factorial(STAGES) ** 2 / (factorial(2 * STAGES) * factorial(2 * STAGES + 1))  # error of an exponential


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of the periods of some orbits, one after the other.

    Attributes
    ----------
    of : ndarray of int, shape (E,)
        The place of the orbit of each.
    begin, length : ndarray, shape (E,), rad
    """

    of: Places
    begin: Array
    length: Array

    def __getitem__(self, chosen: NDArray[np.bool_] | Places | slice) -> Elements:
        """Return some of the elements."""
        return Elements(self.of[chosen], self.begin[chosen], self.length[chosen])

    def divided(self, parts: Places) -> Elements:
        """Return the elements divided into parts of the same length."""
        place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        length = np.repeat(self.length / parts, parts)
        return Elements(np.repeat(self.of, parts), np.repeat(self.begin, parts) + place * length, length)


def over_elements(
    waveforms: Waveforms, elements: Elements, *, divide: bool, pieces: int = 1
) -> tuple[Elements, Array, Array]:
    """Return elements, their transition matrices, and the integrals of the state matrix's trace.

    Parameters
    ----------
    waveforms : Waveforms
    elements : Elements
    divide : bool
        Whether elements with too large an error are divided.
    pieces : int
        Into how many each of those that are left is divided in the end.

    Returns
    -------
    elements : Elements
        E elements in the order of the phase.
    matrices : ndarray, shape (E, n_states, n_states)
    traces : ndarray, shape (E,)
    """
    done: list[tuple[Elements, Array, Array]] = []
    for left in reversed(range(ROUNDS if divide else 1)):
        matrices, traces, error, solved = _solved(waveforms, elements, every=left == 0)
        with np.errstate(invalid="ignore"):
            parts = np.ceil((error / TOLERANCE) ** (0.5 / STAGES))
        # what overflows is not finite in pieces either
        parts = np.clip(np.nan_to_num(parts, nan=1.0, posinf=1.0), 1, PIECES).astype(int)
        parts[(np.bincount(elements.of, parts) > MOST)[elements.of]] = 1
        kept = parts == 1 if left else np.ones(len(parts), dtype=bool)
        if (lost := kept & ~solved).any():
            matrices[lost], traces[lost], *_ = _solved(waveforms, elements[lost])
        done.append((elements[kept], matrices[kept], traces[kept]))
        if kept.all():
            break
        elements = elements[~kept].divided(parts[~kept])
    of, begin, length = (np.concatenate([getattr(e, name) for e, _, _ in done]) for name in ("of", "begin", "length"))
    order = np.lexsort((begin, of))
    elements = Elements(of, begin, length)[order]
    if pieces == 1:
        matrices, traces = (np.concatenate(parts)[order] for parts in list(zip(*done, strict=True))[1:])
        return elements, matrices, traces
    elements = elements.divided(np.full(len(order), pieces))
    matrices, traces, *_ = _solved(waveforms, elements)
    return elements, matrices, traces


def _solved(
    waveforms: Waveforms, elements: Elements, every: bool = True
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return transition matrices, integrals of the trace, errors of the matrices in states of size 1, and which.

    Unless every element is asked for, those of which the state matrix alone tells that they will be divided are not
    solved for; their errors are what it tells.
    """
    system, n, E = waveforms.system, waveforms.system.n_states, len(elements.of)
    matrices, traces, errors, solved = np.empty((E, n, n)), np.empty(E), np.empty(E), np.ones(E, dtype=bool)
    sizes, few = _sizes(waveforms), max(1, FEW // (STAGES * system.n) ** 2)
    units = np.where(system.second_order, waveforms.omega[:, None] * sizes, sizes)  # of rates' integrals
    units = np.hstack([units, sizes[:, list(system.second_order)]])
    for k in range(0, E, BLOCK * few):
        block = elements[k : k + BLOCK * few]
        columns = units[block.of]
        rows = _rows(waveforms, block)
        rows *= (columns[:, None] / (waveforms.omega[block.of, None] * columns[:, : system.n])[:, :, None])[:, None]
        place = np.arange(k, k + len(block.of))
        if not every:
            with np.errstate(over="ignore", invalid="ignore"):
                errors[place] = told = _told(system, block.length, rows)
            solved[place] = ~(np.isfinite(told) & (told > HOPELESS * TOLERANCE))
            place = place[solved[place]]
        for j in range(0, len(place), few):
            own = place[j : j + few]
            matrices[own], traces[own], errors[own] = _some_solved(
                system, elements.length[own], rows[own - k], columns[own - k]
            )
    return matrices, traces, errors, solved


def _told(system: System, length: Array, A: Array) -> Array:
    """Return what the state matrix alone tells of errors: where the Gauss points leave it, and were it constant."""
    off = A[:, STAGES:] - (BETWEEN @ A[:, :STAGES].reshape(len(A), STAGES, -1)).reshape(A[:, STAGES:].shape)
    errors = length * np.abs(np.einsum("k,ekij->eij", WEIGHTS, off)).max(axis=(1, 2))
    errors += (length * np.abs(off).max(axis=(1, 2, 3))) ** 2 / (2 * STAGES + 1)
    n, second = system.n, np.flatnonzero(system.second_order)
    whole = np.zeros((len(A), A.shape[3], A.shape[3]))
    whole[:, :n], whole[:, n + np.arange(len(second)), second] = A[:, STAGES // 2], 1.0
    whole = whole @ whole
    whole = whole @ whole
    size = length * np.einsum("eij,eij->e", whole, whole) ** 0.125
    return np.asarray(errors + PADE * size ** (2 * STAGES + 1))


def _some_solved(system: System, length: Array, A: Array, units: Array) -> tuple[Array, Array, Array]:
    """Return the first of what `_solved` does, for as many elements as fit into the cache."""
    E, h = len(length), length[:, None, None]
    n, second = system.n, np.flatnonzero(system.second_order)
    inner, around = A[:, :STAGES], A[:, STAGES:]
    of_rates, of_positions = inner[..., :n], np.zeros((E, STAGES, n, n))
    of_positions[..., second] = inner[..., n:]
    # the rates at the Gauss points are those of the beginning and what follows from themselves; those of one
    # coordinate are neighbours among the unknowns
    both = np.stack([h[..., None] * of_rates, h[..., None] ** 2 * of_positions], axis=-1)
    stage, row, unknowns = np.arange(STAGES)[:, None], np.arange(n), STAGES * n
    M = (both.reshape(E, STAGES, n * n, 2) @ -INSIDE[1:].swapaxes(0, 1)).reshape(E, STAGES, n, n, STAGES)
    M[:, stage, row, row, stage] += 1.0
    right = inner.copy()
    right[..., :n] += (h * NODES[:, None])[..., None] * of_positions
    rates = np.linalg.solve(M.reshape(E, unknowns, unknowns), right.reshape(E, unknowns, -1))
    # rates, velocities and positions beside the Gauss points, shape (E, points, n or n_states, n_states)
    sums = (AROUND.reshape(-1, STAGES) @ rates.reshape(E, n, STAGES, -1)).reshape(E, n, 3, len(BESIDE), -1)
    sums = sums.transpose(2, 0, 3, 1, 4)
    states = np.concatenate([h[..., None] * sums[1], h[..., None] ** 2 * sums[2][:, :, second]], axis=2)
    states[:, :, n + np.arange(len(second)), second] += h * BESIDE[:, None]
    diagonal = np.arange(system.n_states)
    states[:, :, diagonal, diagonal] += 1.0
    left = sums[0] - around @ states
    ends = states[:, -1]
    # the error at the end is the integral of what is left of these equations times the adjoint solution: the part
    # that is constant, and what is left of the adjoint equations, which are orthogonal to polynomials
    constant = np.abs(np.einsum("k,ekij->eij", WEIGHTS, left)).max(axis=(1, 2))
    error = length * constant
    error += (length * np.abs(left).max(axis=(1, 2, 3))) ** 2 / (2 * STAGES + 1)
    error /= np.maximum(np.abs(ends).max(axis=(1, 2)), 1.0)
    traces = length * np.einsum("ejii,j->e", of_rates, MEAN)
    return _of_states(system, ends, units), traces, error


def _of_states(system: System, ends: Array, units: Array) -> Array:
    """Return transition matrices of the states, given those of what the rates belong to, then of positions."""
    n = system.n
    second = np.flatnonzero(system.second_order)
    place = np.arange(system.n_states)  # of each state in the given order
    place[second] = n + np.arange(len(second))
    place[n:] = second
    matrices = ends * (units[:, :, None] / units[:, None])
    return np.asarray(matrices[:, place[:, None], place])


def _sizes(waveforms: Waveforms) -> Array:
    """Return the size of each coordinate of each orbit, at least `AT_REST` of the largest."""
    size = waveforms.all_states.size[:, : waveforms.system.n]
    size = np.maximum(size, AT_REST * size.max(axis=1, keepdims=True))
    return np.where(size > 0, size, 1.0)


def _rows(waveforms: Waveforms, elements: Elements) -> Array:
    """Return the rows of the state matrix that are not those of velocities, shape (E, samples, n, n_states).

    The columns are velocities and coordinates of first order, then the other coordinates.
    """
    system, E, S = waveforms.system, len(elements.of), len(SAMPLES)
    rows = system.once("rows of the state matrix", lambda: _rows_of(system, waveforms.model))
    tau, of = elements.begin[:, None] + elements.length[:, None] * SAMPLES, np.repeat(elements.of, S)
    lines = np.repeat(waveforms.lines(elements.begin + 0.5 * elements.length, elements.of), S, axis=0)
    out = at_each(system.once, rows, waveforms.states(tau.ravel(), of), lines, waveforms.p[of])
    return out.reshape(E, S, system.n, system.n_states)


def _rows_of(system: System, model: Model) -> ca.Function:
    """Return the function (varying states, lines, p) -> those rows, one after the other."""
    second, n = [i for i, s in enumerate(system.second_order) if s], system.n
    of_rates = [n + second.index(i) if i in second else i for i in range(n)]
    x, lines = ca.SX.sym("x", len(model.varying)), ca.SX.sym("lines", model.matrix.size1_in(1))
    p = ca.SX.sym("p", len(system.parameters))
    rows = model.matrix(x, lines, p)[of_rates, of_rates + second]
    return ca.Function("rows_of_A", [x, lines, p], [ca.vec(rows.T)])
