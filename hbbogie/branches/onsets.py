"""The branches that begin at a Hopf point: several where pairs of eigenvalues cross together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from hbbogie.model.system import System
from hbbogie.results import SpecialPoint

Complex = NDArray[np.complex128]
MOST = 9  # combinations tried
TOGETHER = 1e-6  # distance of eigenvalues, relative to them, up to which they cross together


def beginnings(system: System, hopf: SpecialPoint) -> Iterator[tuple[SpecialPoint, str]]:
    """Give a Hopf point with the modes in which cycles may begin there, and a word on which.

    With one pair there is one mode. Where several pairs cross together, as in symmetric systems, any combination of
    theirs solves the linear equations, and cycles begin in some only: standing waves in real combinations, waves that
    run in complex ones. A few of each are guesses.
    """
    modes = _modes(system, hopf)
    if len(modes) < 2:
        yield hopf, ""
        return
    for k, mode in enumerate(_combined(modes), 1):
        orbit = hopf.orbit
        scaled = mode / mode[np.argmax(np.abs(mode))]
        coefficients = np.array([orbit.coefficients[0], scaled.real, -scaled.imag])
        yield replace(hopf, orbit=orbit.replace(coefficients=coefficients)), f", combination {k} of its modes"


def _modes(system: System, hopf: SpecialPoint) -> list[Complex]:
    """Return a basis of the critical modes of the coordinates, real where there is a real one."""
    x = np.zeros(system.n_states)
    x[: system.n] = hopf.orbit.coefficients[0]
    values, vectors = np.linalg.eig(system.state_matrix(x, system.vector(**hopf.orbit.parameters)))
    critical = np.flatnonzero(np.abs(values - 1j * hopf.omega) <= TOGETHER * hopf.omega)
    if len(critical) < 2:
        return [vectors[: system.n, i] for i in critical]
    V = vectors[: system.n, critical]
    for basis in (np.hstack([V.real, V.imag]), V):
        Q, R, _ = qr(basis, mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        count = int((sizes > 1e-6 * sizes[0]).sum())
        if count == len(critical):
            break
    return [Q[:, i].astype(complex) for i in range(count)]


def _combined(modes: list[Complex]) -> list[Complex]:
    """Return each mode, and each two of them with several shares."""
    pairs = [(a, b) for i, a in enumerate(modes) for b in modes[i + 1 :]]
    return [*modes, *(a + share * b for a, b in pairs for share in (1j, -1j, 1.0))][:MOST]


def distinct(points: list[SpecialPoint]) -> list[SpecialPoint]:
    """Return the Hopf points that differ in value, frequency or equilibrium."""
    kept: list[SpecialPoint] = []
    for point in points:
        mark = np.append([point.value, point.omega], point.orbit.coefficients[0])
        marks = (np.append([other.value, other.omega], other.orbit.coefficients[0]) for other in kept)
        if not any(np.allclose(mark, other, rtol=1e-6, atol=1e-9) for other in marks):
            kept.append(point)
    return kept
