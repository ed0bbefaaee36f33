"""A motion found by shooting as Fourier series, in phase with an orbit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.results import Orbit
from hbbogie.stability.paths import NewtonStep, Path, states_at
from hbbogie.stability.shooting import Shooting

Array = NDArray[np.float64]

HARMONICS = (127, 255, 511)  # highest harmonics tried for a polished orbit; the first that resolves it is taken
RESOLVED = 1e-7  # largest tail of a resolved orbit, of its coordinates and of their rates


def aligned(shooting: Shooting, path: Path, step: NewtonStep, orbit: Orbit) -> tuple[Array, float]:
    """Return the coefficients in phase with an orbit, and the distance from it relative to the peaks."""
    b = coefficients_of(shooting, path, step, 0.0, max(orbit.H, 15))
    a = orbit.harmonics(max(orbit.H, 15))
    peak = np.maximum(np.abs(fourier.extremes(b)).max(axis=0), np.finfo(float).tiny)
    peak = np.where(orbit.advance, np.abs(orbit.advance), peak) if orbit.advance else peak
    tau = _in_phase(a, b, peak, orbit)
    moved = tau / (2 * np.pi) * np.array(orbit.advance or 0.0)  # the periodic part, when time begins later
    phases = fourier.phases(max(512, 16 * orbit.H))
    gap = orbit.motion.at(phases) - _sampled(shooting, path, step.f, tau + phases) - moved
    for H in HARMONICS:
        c = coefficients_of(shooting, path, step, tau, H)
        c[0] += moved
        if _resolved(c, shooting.scale[: c.shape[1]], orbit):
            break
    return c, float((np.abs(gap).max(axis=0) / peak)[peak > 1e-12 * peak.max()].max())


def _sampled(shooting: Shooting, path: Path, f: Array, phases: Array) -> Array:
    """Return the coordinates' periodic part at phases from the beginning of the path, shape (len(phases), n)."""
    ends = np.cumsum(path.h)
    share = np.mod(phases, 2 * np.pi) / (2 * np.pi)
    t = share * ends[-1]
    e = np.minimum(np.searchsorted(ends, t, side="right"), len(ends) - 1)
    h = path.h[e]
    sigma = np.divide(t - (ends - path.h)[e], h, out=np.zeros_like(t), where=h > 0)
    q = (states_at(path, f, e, sigma) * shooting.scale)[:, : shooting.system.n]
    return q - np.outer(share, shooting.orbit.advance) if shooting.orbit.advance else q


def coefficients_of(shooting: Shooting, path: Path, step: NewtonStep, tau: float, H: int) -> Array:
    """Return the Fourier coefficients with the time origin tau [rad] after the beginning, shape (2 H + 1, n)."""
    N = 16 * (H + 1)
    c = np.fft.rfft(_sampled(shooting, path, step.f, tau + fourier.phases(N)), axis=0)[: H + 1] / N
    out = np.empty((2 * H + 1, c.shape[1]))
    out[0], out[1::2], out[2::2] = c[0].real, 2 * c[1:].real, -2 * c[1:].imag
    return out


def _resolved(c: Array, scale: Array, orbit: Orbit) -> bool:
    """Tell whether coefficients resolve a motion with its velocities, which forces and accelerations depend on."""
    order = np.repeat(np.arange(1, len(c) // 2 + 1), 2)[:, None]
    waves = np.abs(c[1:]) / scale
    sizes = [max(waves.max(), *(np.abs(orbit.advance) / scale if orbit.advance else ()), 0.0), (order * waves).max()]
    tails = waves[-8:].max(), (order * waves)[-8:].max()
    return all(tail <= RESOLVED * size for tail, size in zip(tails, sizes, strict=True))


def _in_phase(a: Array, b: Array, peak: Array, orbit: Orbit) -> float:
    """Return by what phase [rad] the motion b is behind a: their largest correlation, or that of means that advance."""
    if orbit.advance:
        i = next(k for k, by in enumerate(orbit.advance) if by)
        return float((a[0, i] - b[0, i]) / orbit.advance[i] * 2 * np.pi)
    h = np.arange(1, fourier.highest(a) + 1)
    first, second = ((c[1::2] - 1j * c[2::2]) / peak for c in (a, b))
    W = (first.conj() * second).sum(axis=1)
    grid = fourier.phases(32 * len(h))
    tau = grid[np.argmax((np.exp(1j * np.outer(grid, h)) @ W).real)]
    for _ in range(6):  # Newton's method for the largest correlation
        turned = W * np.exp(1j * h * tau)
        tau += (1j * h * turned).sum().real / (h**2 * turned).sum().real
    return float(tau)
