"""The small cycle with which a branch begins at a Hopf point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.orbit import Orbit

Array = NDArray[np.float64]

SMALL = 1e-2  # amplitude of a first cycle of a smooth system, in units of the amplitude scale


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
    return orbit.replace(coefficients=coefficients)


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
