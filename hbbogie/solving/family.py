"""Cycles of a family, as of a conservative system: the one of a given amplitude."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.methods.level import within_family
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.linear import scaled, singularity
from hbbogie.solving.newton import Conditions, Problem, newton

BESIDE = 1.03  # amplitude of another member, relative to that of a cycle, by which a family is told
SINGULAR, MET = 1e-6, 1e-8  # smallest singular value, relative to the largest, and residual of a member of a family
STEPS = (1, 4, 16)  # from the amplitude of the guess to the one asked for, tried in turn


def asked(amplitude: Mapping[str, float]) -> tuple[str, float]:
    """Return the coordinate and the amplitude that are asked for; raise `ModelError` unless they make sense."""
    if len(amplitude) != 1:
        raise ModelError(f"solve: amplitude={dict(amplitude)!r}; give one coordinate, such as {{'q1': 0.01}}.")
    ((name, value),) = amplitude.items()
    if not np.isfinite(value) or value <= 0:
        raise ModelError(f"solve: amplitude of {name!r} is {value!r}; give a positive number.")
    return name, float(value)


def level_of(equations: Equations, orbit: Orbit) -> float:
    """Return what tells a cycle of a family from others: its first harmonic, or its frequency where it runs on."""
    return orbit.omega if equations.advance else orbit.first_harmonic(orbit.coordinates[equations.phase or 0])


def of_family(equations: Equations, orbit: Orbit, tolerance: float) -> bool:
    """Tell whether a cycle is one of a family at its parameter values: whether there is another one beside it."""
    if equations.phase is None or not orbit.H or set(orbit.parameters) != set(equations.system.parameter_names):
        return False
    if not level_of(equations, orbit):
        return False
    z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
    F, J = Problem(equations, Conditions(), p).linearise(z)
    if not np.abs(F / equations.residual_scale).max() <= MET**0.5:
        return False
    if not singularity(scaled(J, equations.residual_scale, equations.scale)) <= SINGULAR:
        return False
    try:  # at a fold and where branches cross there is none
        member(equations, orbit, BESIDE * level_of(equations, orbit), tolerance, **orbit.parameters)
    except ConvergenceError:
        return False
    return True


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
            f"solve: the cycle of a family is asked for by its amplitude in {name!r}, which must set the phase: that "
            "takes HarmonicBalance(..., phase=name), and is not possible where coordinates run on."
        )
    return member(equations, guess, target, tolerance, **fixed)


def member(equations: Equations, guess: Orbit, level: float, tolerance: float, **fixed: float) -> Orbit:
    """Return the cycle of a family at a level, see `level_of`; parameters and errors as of `in_family`."""
    p, first = equations.system.vector(**fixed), level_of(equations, guess)
    what = f"cycle of {equations.system.name!r} with a {'frequency' if equations.advance else 'first harmonic'} of"
    for steps in STEPS:
        orbit = guess
        for size in first + (level - first) * np.arange(1, steps + 1) / steps:
            own = within_family(equations, orbit, float(size), **fixed)
            y, error, iterations = newton(Problem(own, Conditions(), p), equations.encode(orbit), tolerance)
            if error > tolerance:
                break
            orbit = equations.decode(y, p, f"converged by Newton's method in {iterations} iterations, in its family")
        else:
            if orbit.residual <= 10 * tolerance:
                return orbit
            raise ConvergenceError(
                f"there is no {what} {level:g} at these parameter values: what is left of the equations is "
                f"{orbit.residual:.2g}. Where the cycles do not form a family a parameter must give way, solve(..., "
                "free=name); where they do, take more harmonics.",
                orbit=orbit,
            )
    raise ConvergenceError(
        f"no {what} {level:g} was found ({equations.method}), the scaled residual is {error:.2g}; begin with a cycle "
        "closer to it, or take more harmonics.",
        orbit=orbit,
    )


def at_its_amplitude(equations: Equations, orbit: Orbit, place: int, tolerance: float) -> Equations:
    """Return equations that keep the amplitude of a cycle which is one of a family along a parameter; else as given.

    Where the parameter ends the family, as damping does, the equations determine it and stay as they are.
    """
    if not of_family(equations, orbit, tolerance):
        return equations
    z, p, m = equations.encode(orbit), equations.system.vector(**orbit.parameters), equations.size
    J = equations.derivatives((place,))(z, p)[1].full() / equations.residual_scale[:, None]
    psi, slope = np.linalg.svd(J[:, :m] * equations.scale)[0][:, -1], J[:, m]
    if abs(psi @ slope) > SINGULAR * np.linalg.norm(slope):
        return equations
    return within_family(equations, orbit, level_of(equations, orbit), **orbit.parameters)


def check_members(equations: Equations, orbits: Iterable[Orbit]) -> None:
    """Raise `ConvergenceError` where cycles that should be members of families solve not all of the equations."""
    for orbit in orbits:
        z, p = equations.encode(orbit), equations.system.vector(**orbit.parameters)
        left = float(np.abs(equations.residual(z, p).full().ravel() / equations.residual_scale).max())
        if left > MET**0.5:
            raise ConvergenceError(
                f"the start is a cycle of a family, and {equations.system.name!r} has none of its amplitude along the "
                f"branch: what is left of the equations is {left:.2g} at {orbit.naming.values(orbit.parameters)}. Take "
                "more harmonics, or a parameter along which the same is conserved.",
                orbit=orbit,
            )
