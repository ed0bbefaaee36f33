"""What a cycle lets expect beside it: its mirror image, the symmetric one, that of half the period, that backwards."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hbbogie import fourier
from hbbogie.model.conserved import conserved_along
from hbbogie.model.parts import is_odd
from hbbogie.model.system import System
from hbbogie.results import Orbit

MIRROR = "the mirror image"
ODD = 1e-6  # even harmonics, relative to the largest, of a symmetric cycle
LESS = 0.9  # share of the harmonics left out in those kept, up to which a guess without them is made


def relatives(system: System, orbit: Orbit) -> Iterator[tuple[str, Orbit]]:
    """Give guesses of cycles that a cycle lets expect, with what they are.

    A cycle that began at a period doubling goes round twice where another one goes round once; of an odd system the
    mirror image of a cycle is one, and where a pitchfork has broken the symmetry a symmetric one lies between both.
    """
    c, H = orbit.coefficients, orbit.H
    odd, even = fourier.rows_of(range(1, H + 1, 2)), fourier.rows_of(range(2, H + 1, 2))
    if orbit.advance:
        if system.odd or is_odd(system.dynamics, system.vector()):
            mirrored = tuple(-by for by in orbit.advance)
            yield MIRROR, orbit.replace(coefficients=-c, advance=mirrored)
        return
    sizes = [float(np.linalg.norm(c[rows])) for rows in (odd, even)]
    if H >= 2 and 0 < sizes[0] <= LESS * sizes[1]:
        twice = np.concatenate([c[:1], c[even]])
        yield "half the period", orbit.replace(coefficients=twice, omega=2 * orbit.omega)
    symmetric = system.odd or is_odd(system.dynamics, system.vector())
    if not symmetric or orbit.is_odd(ODD):
        return
    size = np.abs(c).sum(axis=0)
    held = conserved_along(system, orbit, system.vector(**orbit.parameters))[:, : system.n]
    if (np.abs(held @ c[0]) > ODD * (np.abs(held) @ size)).any():
        return  # the mirror image has other values of what is conserved
    yield MIRROR, orbit.replace(coefficients=-c)
    if np.hypot(sizes[1], np.linalg.norm(c[0])) <= LESS * sizes[0]:
        between = np.zeros_like(c)
        between[odd] = c[odd]
        yield "the symmetric one", orbit.replace(coefficients=between)


def turned(orbit: Orbit) -> Orbit:
    """Return the motion backwards in time."""
    c = orbit.coefficients.copy()
    c[2::2] *= -1  # of the sines
    return orbit.replace(coefficients=c, advance=tuple(-by for by in orbit.advance))
