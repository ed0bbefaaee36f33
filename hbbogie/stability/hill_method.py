"""Hill's method: Floquet exponents from the harmonic-balance Jacobian, a cross-check of the integrated ones."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from hbbogie import fourier
from hbbogie.brief import brief
from hbbogie.errors import ModelError, door
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.stability.variation import Waveforms, check_orbit
from hbbogie.stability.verdicts import ALIGNED, CANDIDATES, sides

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

NODES, PHASE = 16, 8.0  # radians of the fastest oscillation that one Gauss rule covers


@dataclass(frozen=True, eq=False)
class HillStability:
    """Floquet exponents of a cycle by Hill's method, measures of their reliability, and a verdict.

    Attributes
    ----------
    verdict : {"stable", "unstable", "unknown"}
    multipliers : ndarray of complex, shape (n_states,)
        exp(exponent T), largest modulus first, including the trivial one.
    exponents : ndarray of complex, shape (n_states,), 1/s
        In the same order. The imaginary parts are those of the most central copy.
    health : dict
        Errors in units of a multiplier. "trivial" is the distance of the trivial multiplier from 1. "copies" is the
        largest disagreement between the copies of an exponent about its multiplier. "determinant" is the error of the
        sum of the exponents (Liouville), relative to its size or to 1.
    unstable : int
        Number of multipliers outside the unit circle, the trivial one not counted.
    reason : str
        A sentence that gives the reason for the verdict.
    """

    verdict: str
    multipliers: Complex
    exponents: Complex
    health: dict[str, float]
    unstable: int
    reason: str

    __repr__ = brief


@door(system=System, orbit=Orbit)
def hill(system: System, orbit: Orbit, *, harmonics: int | None = None, tolerance: float = 1e-2) -> HillStability:
    """Return the Floquet exponents of a cycle by Hill's method, without integrating anything.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle. The parameter values are those of the orbit.
    harmonics : int
        Highest harmonic H of the disturbance, by default that of the orbit. The work grows with its cube.
    tolerance : float
        Largest of the three errors in ``health`` that is still trusted.

    Returns
    -------
    HillStability

    Raises
    ------
    ModelError
        When the orbit does not belong to the system or is no cycle, when an element jumps, or when harmonics or
        tolerance are not acceptable.

    Notes
    -----
    A disturbance exp(sigma t) times a Fourier series with the harmonics -H ... H, put into the variational equations of
    the first-order form, gives the eigenvalue problem (sigma + i h omega) psi_h = sum_k A_(h-k) psi_k, with A_k the
    Fourier coefficients of the state matrix along the orbit. For equations of second order it is the quadratic problem
    of the harmonic-balance Jacobian (eq-hill), written linearly. The A_k are integrated panel by panel between the
    contact times, exactly to round-off for piecewise-linear elements. A kink written into the equations with ``fmax``
    or ``fabs`` is not detected and costs accuracy.

    The eigenvalues are n_states exponents and their copies sigma + i k omega, which become inaccurate towards the ends
    of the range. The method selects those whose eigenvectors are most central, that is, have the smallest mean
    harmonic, weighted by the squared entries of equally scaled states. Of two copies centred at -1/2 and +1/2, as for
    negative multipliers, one is taken. Exact copies would differ by exactly i omega. The deviation of the neighbours of
    the selected exponents from this is an estimate of the truncation error.

    The method is meant as a cross-check of `floquet`. With the harmonics of an orbit that solves its balance exactly,
    the trivial exponent is zero by construction and tells nothing about the error of the orbit. Choose other harmonics
    to see this error.
    """
    check_orbit(system, orbit)
    if orbit.H == 0:
        raise ModelError("Hill's method is for cycles; got an equilibrium. Use floquet.")
    jumping = [e.name for e in system.elements if e.heights is not None]
    if jumping:
        raise ModelError(
            f"Hill's method does not see jumps of the vector field ({', '.join(jumping)}): the series of the state "
            "matrix does not contain them. Use floquet, or verify."
        )
    H = orbit.H if harmonics is None else harmonics
    if int(H) != H or H < 1:
        raise ModelError(f"harmonics: got {harmonics!r}; give a whole number, 1 or more.")
    if not tolerance > 0:
        raise ModelError(f"tolerance: got {tolerance!r}; give a number above 0.")
    waveforms = Waveforms(system, [orbit], system.vector(**orbit.parameters)[None])
    A = _state_matrix_modes(waveforms, 2 * int(H))
    eigenvalues, vectors, scale = _eigen(A, orbit.omega)
    taken = _central(eigenvalues, vectors, system.n_states, orbit.omega)
    order = taken[np.argsort(-eigenvalues[taken].real, kind="stable")]
    copies = _disagreement(eigenvalues, order, orbit)
    trivial = _trivial(eigenvalues[order], vectors[..., order], waveforms, scale, orbit)
    return _judge(eigenvalues[order], trivial, copies, float(A[2 * int(H)].trace().real), orbit, tolerance)


def _state_matrix_modes(waveforms: Waveforms, K: int) -> Complex:
    """Return the Fourier coefficients -K ... K of the state matrix, shape (2 K + 1, n_states, n_states) [1/s]."""
    n = waveforms.system.n_states
    ends = np.unique(np.r_[0.0, waveforms.switchings()[0], 2 * np.pi])
    fastest = K + 4 * waveforms.H
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    tau, w = [], []
    for a, b in pairwise(ends):
        panels = int(np.ceil((b - a) * fastest / PHASE))
        edges = np.linspace(a, b, panels + 1)
        reach = 0.5 * (b - a) / panels
        tau.append((0.5 * (edges[:-1] + edges[1:])[:, None] + reach * nodes).ravel())
        w.append(np.tile(reach * weights, panels))
    phases, weight = np.concatenate(tau), np.concatenate(w)
    x, lines = waveforms.states(phases).T, waveforms.lines(phases).T
    A = waveforms.model.matrix(x, lines, waveforms.p[0]).full().reshape(n, -1, n)
    if A.shape[1] == 1:  # a constant matrix, the same for all phases
        A = np.repeat(A, len(phases), axis=1)
    waves = np.exp(-1j * np.outer(np.arange(-K, K + 1), phases)) * weight / (2 * np.pi)
    return np.asarray(np.einsum("kt,itj->kij", waves, A, optimize=True))


def _eigen(A: Complex, omega: float) -> tuple[Complex, Complex, Array]:
    """Return eigenvalues, shape (m,) [1/s], and eigenvectors, shape (2 H + 1, n_states, m), of Hill's matrix.

    Last, the scales of the states, shape (n_states,), in units of which the eigenvectors are.
    """
    H, n = (len(A) - 1) // 4, A.shape[1]
    h = np.arange(-H, H + 1)
    scale = matrix_balance(np.abs(A[2 * H]), permute=False)[1].diagonal()
    scaled = A / scale[:, None] * scale
    blocks = scaled[h[:, None] - h[None, :] + 2 * H].transpose(0, 2, 1, 3)
    matrix = blocks.reshape(len(h) * n, len(h) * n) - 1j * omega * np.diag(np.repeat(h, n))
    eigenvalues, vectors = np.linalg.eig(matrix)
    return eigenvalues, vectors.reshape(len(h), n, -1), scale


def _trivial(exponents: Complex, vectors: Complex, waveforms: Waveforms, scale: Array, orbit: Orbit) -> int:
    """Return the place of the trivial exponent: of those near 0 the one whose mode is the velocity of the states."""
    with np.errstate(over="ignore", invalid="ignore"):
        away = np.abs(np.exp(exponents * orbit.period) - 1)
    near = np.flatnonzero(away <= CANDIDATES)
    if len(near) < 2:
        return int(np.argmin(away))
    H = len(vectors) // 2
    rate = waveforms.all_states.at(fourier.phases(8 * (H + 1)), 1) / scale
    modes = np.fft.fft(rate, axis=0)[np.arange(-H, H + 1)]
    along = np.abs(np.einsum("hs,hsm->m", modes.conj(), vectors[..., near]))
    along /= np.linalg.norm(vectors[..., near], axis=(0, 1))
    aligned = near[along >= ALIGNED * along.max()]
    return int(aligned[np.argmin(away[aligned])])


def null_mode(system: System, orbit: Orbit, *, doubled: bool) -> Array:
    """Return the periodic or antiperiodic mode of a cycle at a bifurcation: Floquet multiplier +1 or -1.

    Parameters
    ----------
    system : System
    orbit : Orbit
        With ``doubled=False`` an odd cycle of an odd system, at a pitchfork.
    doubled : bool
        Whether the mode has twice the period.

    Returns
    -------
    ndarray
        Fourier coefficients of the coordinates, of arbitrary size: even harmonics of the cycle's frequency, shape (2 H
        + 1, n), or odd harmonics of half this frequency, shape (4 H + 1, n).
    """
    H, n = orbit.H, system.n_states
    waveforms = Waveforms(system, [orbit], system.vector(**orbit.parameters)[None])
    A = _state_matrix_modes(waveforms, 2 * H + 1)
    k = np.arange(-2 * H + 1, 2 * H, 2) if doubled else np.arange(-(H // 2) * 2, H + 1, 2)
    omega = orbit.omega / 2 if doubled else orbit.omega
    steps = (k[:, None] - k[None, :]) // (2 if doubled else 1)
    scale = matrix_balance(np.abs(A[2 * H + 1]), permute=False)[1].diagonal()
    blocks = (A / scale[:, None] * scale)[steps + 2 * H + 1].transpose(0, 2, 1, 3)
    matrix = blocks.reshape(len(k) * n, len(k) * n) - 1j * omega * np.diag(np.repeat(k, n))
    psi = np.linalg.svd(matrix)[2][-1].conj().reshape(len(k), n)
    # among the complex multiples of the mode, take the real one
    psi = psi * np.exp(-0.5j * np.angle((psi * psi[::-1]).sum()))
    psi = (0.5 * (psi + psi[::-1].conj()) * scale)[:, : system.n]
    coefficients = np.zeros((2 * (2 * H if doubled else H) + 1, system.n))
    for row, h in zip(psi, k, strict=True):
        if h == 0:
            coefficients[0] = row.real
        elif h > 0:
            coefficients[2 * h - 1], coefficients[2 * h] = 2 * row.real, -2 * row.imag
    return coefficients


def _central(eigenvalues: Complex, vectors: Complex, count: int, omega: float) -> NDArray[np.int_]:
    """Return the places of the exponents whose eigenvectors have the smallest mean harmonic, without copies."""
    H = len(vectors) // 2
    weights = (np.abs(vectors) ** 2).sum(axis=1)
    centre = np.arange(-H, H + 1) @ weights / weights.sum(axis=0)
    order = np.argsort(np.abs(centre), kind="stable")
    taken: list[int] = []
    for i in order:
        if len(taken) == count:
            break
        if not any(_is_copy(eigenvalues, vectors, i, j, omega) for j in taken):
            taken.append(int(i))
    return np.array(taken + [int(i) for i in order if i not in taken][: count - len(taken)])


def _is_copy(eigenvalues: Complex, vectors: Complex, i: int, j: int, omega: float) -> bool:
    """Tell whether exponent i is exponent j plus i k omega, k not 0, with the eigenvector shifted by k harmonics."""
    distance = (eigenvalues[i] - eigenvalues[j]) / omega
    k = round(distance.imag)
    if k == 0 or abs(k) >= len(vectors) or abs(distance - 1j * k) > 1e-2:
        return False
    a, b = vectors[..., i], vectors[..., j]
    a, b = (a[:-k], b[k:]) if k > 0 else (a[-k:], b[:k])
    overlap = abs(np.vdot(a, b))
    return bool(overlap > 0.9 * np.linalg.norm(vectors[..., i]) * np.linalg.norm(vectors[..., j]))


def _disagreement(eigenvalues: Complex, taken: NDArray[np.int_], orbit: Orbit) -> float:
    """Return the largest change that neighbouring copies of the exponents make in their multipliers."""
    sigma = eigenvalues[taken]
    neighbours = np.stack([sigma + 1j * orbit.omega, sigma - 1j * orbit.omega])
    away = np.abs(neighbours[:, :, None] - eigenvalues).min(axis=2).max(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.max(np.abs(np.exp(sigma.real * orbit.period)) * away * orbit.period))


def _judge(
    exponents: Complex, trivial: int, copies: float, trace: float, orbit: Orbit, tolerance: float
) -> HillStability:
    """Return the verdict from the exponents [1/s], the error of the copies and the mean trace [1/s]."""
    T = orbit.period
    with np.errstate(over="ignore", invalid="ignore"):
        multipliers = np.exp(exponents * T)
    health = {
        "trivial": float(abs(multipliers[trivial] - 1)),
        "copies": copies,
        "determinant": float(abs(exponents.sum().real - trace) * T / max(1.0, abs(trace) * T)),
    }
    bad = [name for name, error in health.items() if not error <= tolerance]
    doubt = f"too inaccurate ({', '.join(bad)}; allowed is {tolerance:g}): take more harmonics, or a better orbit"
    verdict, outside, reason = sides(multipliers, trivial, max(health["trivial"], copies), doubt if bad else "")
    figures = ", ".join(f"{name} {error:.2g}" for name, error in health.items())
    return HillStability(verdict, multipliers, exponents, health, outside, f"{reason}; errors: {figures}.")
