"""Tests whether two cycles are the same."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie import fourier
from hbbogie.model.system import System
from hbbogie.model.turns import changed, turns_of
from hbbogie.results import Orbit

Array = NDArray[np.float64]
SAMPLES = 4096
BLOCKS = 6  # numbers of a signature for each coordinate
SAME = 1e-6  # distance of the periods up to which two polished cycles may be one
AS_FAR = 100.0  # distance of means and extremes, which are those of samples, relative to that of the periods
ABSENT = 1e-6  # share of a coordinate's largest harmonic up to which another one is not there
PERIODS, PEAKS = 0.05, 0.3  # distance of periods and, relative to the range, of extremes that are about the same
ROUND_OFF = 1e-13  # the same relative to the size of the coordinate, which may rest
ON_EDGE = 1e-6  # share of a turn by which half a turn and half a turn back are told from one another
RESOLVED, ROUGH = 1e-6, 0.05  # tail of a series whose extremes are good, and distance of the extremes of others


def signature(orbit: Orbit) -> Array:
    """Return what tells a cycle from others wherever its time begins, shape (1 + BLOCKS n,).

    Frequency [rad/s], then means, smallest and largest values of the coordinates, and sums over the harmonics of the
    sine and the cosine of the angle between each and the next one, times their amplitudes, relative to the range of the
    next. The latter tell waves of one shape that run in different directions. Last, how far the coordinates advance.
    """
    q, c = samples(orbit), orbit.about_mean(orbit.coefficients)
    low, high = (q.min(axis=0), q.max(axis=0)) if orbit.kept else orbit.extremes
    cos, sin = c[1::2], c[2::2]
    cos_next, sin_next = (np.roll(a, -1, axis=1) for a in (cos, sin))
    next_range = np.roll(np.maximum(high - low, 1e-6 * np.ptp(q, axis=0).max(initial=1e-300)), -1)
    across, along = (cos * sin_next - sin * cos_next).sum(axis=0), (cos * cos_next + sin * sin_next).sum(axis=0)
    advance = np.array(orbit.advance or np.zeros(len(c[0])))
    return np.concatenate([[orbit.omega], c[0], low, high, across / next_range, along / next_range, advance])


def samples(orbit: Orbit) -> Array:
    """Return the coordinates' periodic part at equal distances over the period, shape (SAMPLES, n)."""
    if not orbit.kept:
        return orbit.motion.at(fourier.phases(SAMPLES)) - orbit.free_mean
    c = orbit.about_mean(orbit.coefficients)
    waves = np.zeros((SAMPLES // 2 + 1, c.shape[1]), dtype=complex)
    waves[0], waves[1 : orbit.H + 1] = c[0], 0.5 * (c[1::2] - 1j * c[2::2])
    return np.asarray(np.fft.irfft(waves * SAMPLES, SAMPLES, axis=0))


def alike(a: Orbit, b: Orbit, share: float = SAME) -> bool:
    """Tell whether two cycles have the same period and signature; mirror images have not."""
    if abs(a.omega - b.omega) > share * a.omega:
        return False
    first, second = (signature(o)[1:].reshape(BLOCKS, -1) for o in (a, b))
    width = first[2] - first[1] + np.abs(first[-1])
    width = np.maximum(width, 1e-6 * width.max())
    far = max(min(AS_FAR * share, 0.3), ROUGH if max(a.tail, b.tail) > RESOLVED else 0.0)
    return bool((np.abs(first - second) <= far * width).all())


def peaks_near(a: Orbit, b: Orbit, least: float) -> bool:
    """Tell whether two cycles have about the same period and extremes; what moves less than ``least`` does not count.

    Parameters
    ----------
    a, b : Orbit
    least : float
        Range of a coordinate, relative to the largest of all.
    """
    (low, high), other = a.extremes, b.extremes
    width = np.maximum(high - low, least * (high - low).max())
    away = np.abs(np.array([low, high]) - other)
    return bool(abs(a.omega / b.omega - 1) <= PERIODS and (away <= PEAKS * width).all())


def of_prime_period(orbit: Orbit, turns: ArrayLike = (), absent: float = ABSENT, rest: float = 0.0) -> Orbit:
    """Return a cycle that was run through several times as one that is run through once.

    Parameters
    ----------
    orbit : Orbit
    turns : array_like, shape (n,), unit of the coordinate
        The turn of each coordinate, 0 where it has none; needed where coordinates run on.
    absent : float
        Share of a coordinate's largest harmonic up to which another one is not there.
    rest : float
        Share of the largest harmonic of all up to which that of a coordinate is none.
    """
    if not orbit.kept:  # solved for as a cycle of that period
        return orbit
    waves = np.hypot(orbit.coefficients[1::2], orbit.coefficients[2::2])
    least = ROUND_OFF * np.maximum(np.abs(orbit.coefficients).max(axis=0), 1e-2 * waves.max(initial=0.0))
    size = np.maximum(waves.max(axis=0), rest * waves.max(initial=0.0))
    present = 1 + np.flatnonzero((waves > np.maximum(absent * size, least)).any(axis=1))
    times = int(np.gcd.reduce(present)) if len(present) else 0
    if orbit.advance:  # each part of a period has its whole turns
        whole = np.divide(orbit.advance, turns, out=np.zeros(len(orbit.advance)), where=np.array(turns) != 0)
        times = int(np.gcd.reduce(np.append(np.round(whole).astype(int), times)))
    if times <= 1:
        return orbit
    c = orbit.coefficients
    pairs = [c[2 * h - 1 : 2 * h + 1] for h in range(times, orbit.H + 1, times)]
    advance = tuple(by / times for by in orbit.advance)
    coefficients = np.concatenate([c[:1], *pairs])
    if not pairs:  # a rotation at constant speed
        coefficients = fourier.resize(c[:1], 1)
    return orbit.replace(coefficients=coefficients, omega=times * orbit.omega, advance=advance)


def in_one_turn(system: System, orbit: Orbit) -> Orbit:
    """Return an orbit less whole turns that change no equation: means of angles within half a turn of zero."""
    if not (turns := turns_of(system.dynamics)).any():
        return orbit
    alone = system.once("turns alone", lambda: [not changed(system.dynamics, row) for row in np.diag(turns)])
    mean, free = orbit.coefficients[0], np.array(alone) & (turns > 0)
    counts = np.floor(mean / np.where(turns, turns, np.inf) + 0.5 + ON_EDGE) * free
    together = np.flatnonzero((turns > 0) & ~free)
    if len(together):
        counts[together] = np.floor(mean[together[0]] / turns[together[0]] + 0.5 + ON_EDGE)
    c = orbit.coefficients.copy()
    c[0] -= counts * turns
    return orbit.replace(coefficients=c)


def once_each(orbits: Iterable[Orbit]) -> list[Orbit]:
    """Return the cycles that differ, by growing amplitude."""
    kept: list[Orbit] = []
    for orbit in orbits:
        if not any(alike(orbit, other) for other in kept):
            kept.append(orbit)
    return sorted(kept, key=lambda o: float(np.linalg.norm(o.coefficients[1:])))
