"""Floquet multipliers of a collocated cycle: those of the last pencil, tiny ones by Liouville's formula."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.linalg.lapack import dgeqrf, dorgqr

from hbbogie.brief import brief
from hbbogie.collocation.equations import Linearised
from hbbogie.results.orbit import Stability
from hbbogie.stability.verdicts import sides, trivial_of

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
TRUSTED = 1e-2  # largest error of the trivial multiplier, and estimated error of the others
SWEEPS, SETTLED = 40, 1e-11  # of an orthogonal iteration, and the change of a logarithm after which it ends
ROUND_OFF = 1e-9  # multiplier below which another way is taken
MILD = 1e6  # condition up to which transitions are multiplied
TOGETHER = 7.0  # range of logarithms of multipliers that are of nearly the same size


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The multipliers of a cycle.

    Attributes
    ----------
    values : ndarray of complex, shape (n_states,)
        Largest modulus first.
    vectors : ndarray of complex, shape (n_states, n_states)
        Scaled disturbances at the beginning of the period that belong to them, by columns.
    divergence : float
        Integral of the trace of the state matrix over the period, the sum of their logarithms.
    singular : float
        Smallest singular value of the bordered equations with the sign of their determinant, which changes where
        branches cross.
    rate : ndarray, shape (n_states,)
        Scaled rate at the beginning of the period: the direction of the trivial multiplier.
    transitions : ndarray, shape (N, n_states, n_states), or None
        Over the intervals, where several multipliers are tiny.
    """

    values: Complex
    vectors: Complex
    divergence: float
    singular: float
    rate: Array
    transitions: Array | None = None

    __repr__ = brief

    @cached_property
    def trivial(self) -> int:
        """Place of the trivial multiplier."""
        return trivial_of(self.values, self.vectors, self.rate, np.ones(len(self.rate)))

    @property
    def others(self) -> Complex:
        """All but the trivial one."""
        return np.delete(self.values, self.trivial)

    @property
    def tiny(self) -> NDArray[np.int_]:
        """Places of multipliers that are round-off here."""
        return np.flatnonzero(np.abs(self.values) < ROUND_OFF)


def spectrum_of(line: Linearised) -> Spectrum:
    """Return the multipliers: eigenvalues of C x + D y = 0, x the beginning of the period and y its end.

    By the QZ algorithm, or by the QR algorithm where D is 1.

    Parameters
    ----------
    line : Linearised
        At a solution, solved once.
    """
    last = line.reduced
    assert last is not None
    if last.composed:
        values, vectors = np.linalg.eig(-last.C)
    else:
        alpha, vectors = eig(-last.C, last.D, homogeneous_eigvals=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            values = np.where(alpha[1] == 0, np.inf, alpha[0] / alpha[1])
    order = np.argsort(-np.abs(values), kind="stable")
    divergence = float(np.einsum("j,ijkk->", line.equations.gauss.b, line.A))
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    several = np.count_nonzero(np.abs(values) < ROUND_OFF) > 1
    return Spectrum(values, vectors, divergence, last.singular, line.rate, line.transitions if several else None)


def log_moduli(transitions: Array) -> tuple[Array, Array]:
    """Return the logarithms of the moduli of the multipliers, and their signs where they are real.

    By orthogonal iteration with the factors of the monodromy matrix, which are never multiplied: however small a
    multiplier, its logarithm is the sum of those of the diagonals. Those of nearly the same size, of which complex
    pairs never part, are eigenvalues of the product of their blocks. Where some are tiny it ends when these have
    settled: of the others the sum has, too.

    Parameters
    ----------
    transitions : ndarray, shape (N, n, n)
        Over the intervals, in their order.

    Returns
    -------
    logarithms, signs : ndarray, shape (n,)
        Largest modulus first.
    """
    n = transitions.shape[1]
    while len(transitions) > 1:  # a product in which nothing is small loses nothing
        even = np.concatenate([transitions, np.eye(n)[None]]) if len(transitions) % 2 else transitions
        pairs = even[1::2] @ even[::2]
        if not (np.linalg.cond(pairs) <= MILD).all():
            break
        transitions = pairs
    Q, last, signs = np.eye(n), np.full(n, np.inf), np.ones(n)
    for _ in range(SWEEPS):
        begin, triangles = Q, np.empty((len(transitions), n, n))
        for k, factor in enumerate(transitions):
            triangles[k], reflections, *_ = dgeqrf(factor @ Q)
            Q = dorgqr(triangles[k], reflections)[0]
        diagonals = np.diagonal(triangles, axis1=1, axis2=2)
        logarithms, signs = np.log(np.abs(diagonals)).sum(axis=0), np.sign(diagonals).prod(axis=0)
        turn = begin.T @ Q
        signs *= np.sign(turn.diagonal())
        tiny = logarithms <= np.log(ROUND_OFF)
        asked = tiny if tiny.any() else np.ones(n, dtype=bool)
        for block in _blocks(logarithms):
            if asked[block].any():
                logarithms[block], signs[block] = _of_block(triangles[:, block, block], turn[block, block])
        moving = np.abs(logarithms - last) > SETTLED * np.maximum(1.0, np.abs(logarithms))
        if not moving[asked].any():
            break
        last = logarithms
    return logarithms, signs


def _blocks(logarithms: Array) -> list[slice]:
    """Return the places of several logarithms that are taken together; they are divided where they are far apart."""
    found, left = [], [(0, len(logarithms))]
    while left:
        low, high = left.pop()
        if high - low < 2:
            continue
        own = logarithms[low:high]
        if np.ptp(own) <= TOGETHER:
            found.append(slice(low, high))
        else:
            middle = low + 1 + int(np.argmax(-np.diff(own)))
            left += [(low, middle), (middle, high)]
    return found


def _of_block(triangles: Array, turn: Array) -> tuple[Array, Array]:
    """Return logarithms of moduli and signs of eigenvalues of a turn times triangles, the largest first."""
    product, scale = turn, 0.0
    for triangle in np.triu(triangles)[::-1]:
        product = product @ triangle
        size = np.abs(product).max()
        product, scale = product / size, scale + np.log(size)
    values = np.linalg.eigvals(product)
    values = values[np.argsort(-np.abs(values), kind="stable")]
    return np.log(np.abs(values)) + scale, np.where(values.real < 0, -1.0, 1.0)


def stability_of(spectrum: Spectrum, finer: Spectrum, size: Array, transitions: Array | None = None) -> Stability:
    """Return the multipliers of a cycle and the verdict.

    Parameters
    ----------
    spectrum, finer : Spectrum
        Of the cycle, and of the next degree, which tells the error.
    size : ndarray, shape (n_states,)
        Of the states.
    transitions : ndarray, shape (N, n_states, n_states), optional
        Over the intervals, from which several tiny multipliers follow.
    """
    values, others, trivial = spectrum.values.copy(), spectrum.others, spectrum.trivial
    error = float(abs(values[trivial] - 1))
    with np.errstate(invalid="ignore"):  # infinite ones
        change = np.abs(np.abs(others) - np.abs(finer.others)) / np.maximum(1.0, np.abs(others))
    margin = max(error, float(np.nan_to_num(change, nan=np.inf).max(initial=0.0)))
    told, tiny = "", spectrum.tiny
    if len(tiny) == 1:
        rest = np.delete(values, [tiny[0], trivial])
        logarithm = spectrum.divergence - float(np.log(np.abs(rest)).sum())
        turns = np.count_nonzero((rest.imag == 0) & (rest.real < 0))  # their product is positive
        with np.errstate(over="ignore"):
            values[tiny[0]] = (-1) ** turns * np.exp(logarithm)
        told = f"; the smallest by Liouville's formula, its logarithm is {logarithm:.12g}"
    elif len(tiny) and transitions is not None:
        logarithms, signs = log_moduli(transitions)
        smallest = tiny[logarithms[tiny] == logarithms[tiny].min()]  # one, or a complex pair
        left = spectrum.divergence - float(np.delete(logarithms, smallest).sum())
        logarithms[smallest] = left / len(smallest)
        values[tiny] = signs[tiny] * np.exp(logarithms[tiny])
        listed = ", ".join(f"{x:.6g}" for x in logarithms[tiny])
        told = f"; the {len(tiny)} below {ROUND_OFF:g} by factors of the monodromy matrix, the smallest by Liouville's "
        told += f"formula, with the logarithms {listed}"
    elif len(tiny):
        told = f"; of the {len(tiny)} below {ROUND_OFF:g} only the smallness is meant"
    doubt = ""
    if not error <= TRUSTED:
        doubt = f"no multiplier is closer to 1 than {error:.2g}, allowed is {TRUSTED:g}; take more intervals"
        if len(values) > 1 and np.sort(np.abs(values - 1))[1] < 2 * error:
            doubt += " (two are equally near: where two meet at 1, as at a fold, they carry the root of the error)"
    elif not margin <= TRUSTED:
        doubt = f"the multipliers change by {margin:.2g} of their size with the next degree; take more intervals"
    verdict, outside, reason = sides(values, trivial, margin, doubt)
    reason += f"; error of the trivial multiplier {error:.2g}, estimated error of all {margin:.2g}{told}."
    first = next((i for i in range(len(values)) if i != trivial), None)
    if first is None:
        return Stability(verdict, values, error, outside, reason)
    mode = spectrum.vectors[:, first] * size
    mode = np.asarray(mode / mode[np.argmax(np.abs(mode))], dtype=complex)
    return Stability(verdict, values, error, outside, reason, None, complex(values[first]), mode)
