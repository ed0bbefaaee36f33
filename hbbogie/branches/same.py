"""Tests whether two cycles are the same."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.results import Orbit

Array = NDArray[np.float64]
SAMPLES = 4096
BLOCKS = 5  # numbers of a signature for each coordinate
SAME = 1e-6  # distance of the periods up to which two polished cycles may be one
AS_FAR = 100.0  # distance of means and extremes, which are those of samples, relative to that of the periods
ABSENT = 1e-6  # share of a coordinate's largest harmonic up to which another one is not there
RESOLVED, ROUGH = 1e-6, 0.05  # tail of a series whose extremes are good, and distance of the extremes of others


def signature(orbit: Orbit) -> Array:
    """Return what tells a cycle from others wherever its time begins, shape (1 + BLOCKS n,).

    Frequency [rad/s], then means, smallest and largest values of the coordinates, and sums over the harmonics of the
    sine and the cosine of the angle between each and the next one, times their amplitudes, relative to the range of the
    next. The latter tell waves of one shape that run in different directions.
    """
    q, c = samples(orbit), orbit.coefficients
    low, high = (q.min(axis=0), q.max(axis=0)) if orbit.kept else orbit.extremes
    cos, sin = c[1::2], c[2::2]
    cos_next, sin_next = (np.roll(a, -1, axis=1) for a in (cos, sin))
    next_range = np.roll(np.maximum(high - low, 1e-6 * np.ptp(q, axis=0).max(initial=1e-300)), -1)
    across, along = (cos * sin_next - sin * cos_next).sum(axis=0), (cos * cos_next + sin * sin_next).sum(axis=0)
    return np.concatenate([[orbit.omega], c[0], low, high, across / next_range, along / next_range])


def samples(orbit: Orbit) -> Array:
    """Return the coordinates at equal distances over the period, shape (SAMPLES, n)."""
    if not orbit.kept:
        return orbit.at(fourier.phases(SAMPLES))
    c = orbit.coefficients
    waves = np.zeros((SAMPLES // 2 + 1, c.shape[1]), dtype=complex)
    waves[0], waves[1 : orbit.H + 1] = c[0], 0.5 * (c[1::2] - 1j * c[2::2])
    return np.asarray(np.fft.irfft(waves * SAMPLES, SAMPLES, axis=0))


def alike(a: Orbit, b: Orbit, share: float = SAME) -> bool:
    """Tell whether two cycles have the same period and signature; mirror images have not."""
    if abs(a.omega - b.omega) > share * a.omega:
        return False
    first, second = (signature(o)[1:].reshape(BLOCKS, -1) for o in (a, b))
    width = first[2] - first[1]
    width = np.maximum(width, 1e-6 * width.max())
    far = max(min(AS_FAR * share, 0.3), ROUGH if max(a.tail, b.tail) > RESOLVED else 0.0)
    return bool((np.abs(first - second) <= far * width).all())


def of_prime_period(orbit: Orbit) -> Orbit:
    """Return a cycle that was run through several times as one that is run through once."""
    if not orbit.kept:  # solved for as a cycle of that period
        return orbit
    waves = np.hypot(orbit.coefficients[1::2], orbit.coefficients[2::2])
    size = np.maximum(waves.max(axis=0), 1e-12 * waves.max(initial=0.0))
    present = 1 + np.flatnonzero((waves > ABSENT * size).any(axis=1))
    times = int(np.gcd.reduce(present)) if len(present) else 1
    if times == 1:
        return orbit
    c = orbit.coefficients
    pairs = [c[2 * h - 1 : 2 * h + 1] for h in range(times, orbit.H + 1, times)]
    return orbit.replace(coefficients=np.concatenate([c[:1], *pairs]), omega=times * orbit.omega)


def once_each(orbits: Iterable[Orbit]) -> list[Orbit]:
    """Return the cycles that differ, by growing amplitude."""
    kept: list[Orbit] = []
    for orbit in orbits:
        if not any(alike(orbit, other) for other in kept):
            kept.append(orbit)
    return sorted(kept, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))
