"""Cycles of a family, as of a conservative system: the one of a given amplitude."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.methods.level import within_family
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.newton import Conditions, Problem, newton

STEPS = (1, 4, 16)  # from the amplitude of the guess to the one asked for, tried in turn


def asked(amplitude: Mapping[str, float]) -> tuple[str, float]:
    """Return the coordinate and the amplitude that are asked for; raise `ModelError` unless they make sense."""
    if len(amplitude) != 1:
        raise ModelError(f"solve: amplitude={dict(amplitude)!r}; give one coordinate, such as {{'q1': 0.01}}.")
    ((name, value),) = amplitude.items()
    if not np.isfinite(value) or value <= 0:
        raise ModelError(f"solve: amplitude of {name!r} is {value!r}; give a positive number.")
    return name, float(value)


def in_family(
    equations: Equations, guess: Orbit, amplitude: Mapping[str, float], tolerance: float, **fixed: float
) -> Orbit:
    """Return the cycle of a family at which the first harmonic of a coordinate has an amplitude.

    Parameters
    ----------
    equations : Equations
    guess : Orbit
    amplitude : mapping of one coordinate name to float, unit of the coordinate
    tolerance : float
        Largest scaled residual.
    **fixed : float
        Parameter values.

    Raises
    ------
    ConvergenceError
        When there is no cycle of that amplitude at these parameter values.
    ModelError
        When the coordinate cannot set the phase, or coordinates run on.
    """
    name, target = asked(amplitude)
    system = equations.system
    place = system.index(name)
    if equations.phase is not None and equations.phase != place and equations.with_phase is not None:
        equations = equations.with_phase(name, system)
    if equations.leading is None or equations.phase != place:
        raise ModelError(
            f"solve: the cycle of a family with an amplitude of {name!r} is asked for, which must set the phase; it "
            "does not where it runs on, and elsewhere HarmonicBalance(..., phase=name) lets it."
        )
    p, first = system.vector(**fixed), guess.first_harmonic(name)
    for steps in STEPS:
        orbit = guess
        for size in first + (target - first) * np.arange(1, steps + 1) / steps:
            level = within_family(equations, orbit, float(size), **fixed)
            y, error, iterations = newton(Problem(level, Conditions(), p), equations.encode(orbit), tolerance)
            if error > tolerance:
                break
            orbit = equations.decode(y, p, f"converged by Newton's method in {iterations} iterations, in its family")
        else:
            if orbit.residual <= 10 * tolerance:
                return orbit
            raise ConvergenceError(
                f"no cycle of {system.name!r} has a first harmonic of {target:g} in {name} at these parameter values: "
                f"what is left of the equations is {orbit.residual:.2g}. Where the cycles do not form a family a "
                "parameter must give way, solve(..., free=name); where they do, take more harmonics.",
                orbit=orbit,
            )
    raise ConvergenceError(
        f"no cycle of {system.name!r} with a first harmonic of {target:g} in {name} was found ({equations.method}), "
        f"the scaled residual is {error:.2g}; begin with a cycle of an amplitude closer to it, or take more harmonics.",
        orbit=orbit,
    )
