"""The small cycle with which a branch begins at a Hopf point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]

ODD = 1e-6  # mean and even harmonics, relative to the largest, of a cycle that counts as odd
SMALL = 1e-2  # amplitude of a first cycle of a smooth system, in units of the amplitude scale


def balance_about(system: System, H: int, orbit: Orbit) -> Equations:
    """Return harmonic balance of cycles like one: with a mean and even harmonics where it has them.

    Of an odd system the cycles about another equilibrium than zero, and those whose symmetry is broken, are not odd.
    """
    odd = None if fourier.is_odd(orbit.coefficients, ODD) else False
    return HarmonicBalance(H, odd=odd).equations(system)


def check_kept(equations: Equations, where: str, guess: Orbit, p: Array) -> None:
    """Raise `ModelError` when the equations keep odd harmonics only and the cycles have a mean or even ones."""
    kept = equations.coefficients(equations.encode(guess), p).full()
    if np.abs(_even(kept)).max() < 0.5 * np.abs(_even(guess.coefficients)).max():
        raise ModelError(
            f"trace: cycles {where} have a mean and even harmonics, which {equations.method} leave out; give "
            "HarmonicBalance(..., odd=False).equations(system)."
        )


def _even(coefficients: Array) -> Array:
    """Return the mean and the even harmonics."""
    return np.asarray(coefficients[fourier.rows_of(range(0, fourier.highest(coefficients) + 1, 2))])


def first_cycle(equations: Equations, hopf: SpecialPoint) -> Orbit:
    """Return the small linear cycle of a Hopf point in the size where a branch may begin.

    Where the system is linear until a gap closes, that is the cycle whose first contact just touches
    (the branch of cycles begins there); otherwise a cycle of a hundredth of the amplitude scale.
    """
    orbit, system = hopf.orbit, equations.system
    wave = np.zeros_like(orbit.coefficients)
    wave[1:] = orbit.coefficients[1:]
    parts = system.parts(contact=True)
    size = SMALL * float(equations.scale[0])
    if parts.contacts and not parts.remainder_rows:
        size = _touching(system, orbit, wave)
    coefficients = size * wave
    coefficients[0] = orbit.coefficients[0]
    first = orbit.replace(coefficients=coefficients)
    if not fourier.is_odd(coefficients, ODD):
        check_kept(equations, "from the Hopf point", first, system.vector(**orbit.parameters))
    return first


def _touching(system: System, orbit: Orbit, wave: Array) -> float:
    """Return the factor at which the wave, added to the equilibrium, first reaches where a law changes its line."""
    p, rest, omega = system.vector(**orbit.parameters), orbit.coefficients[0], orbit.omega
    cosine, sine = wave[1], wave[2]
    factors = [np.inf]
    for element in system.elements:
        if element.ramps is None:
            continue
        # the argument is affine, and so harmonic: its values at t = 0 and a quarter period later give its amplitude
        u0 = float(element.argument(rest, 0, p))
        parts = (rest + cosine, omega * sine), (rest + sine, -omega * cosine)
        u = [float(element.argument(q, v, p)) - u0 for q, v in parts]
        reach = float(np.hypot(u[0], u[1]))
        for direction, g in zip(element.directions, element.ramps(p)[3].full().ravel(), strict=True):
            room = float(g) - direction * u0
            if reach > 0 and room != 0:  # a contact begins, or one in which the equilibrium rests ends
                factors.append(abs(room) / reach)
    return min(factors)
