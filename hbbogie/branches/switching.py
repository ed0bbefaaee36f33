"""Switching branches at special points: a first guess beyond the point, and the first point of the new curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.branches.cycle_curve import CycleCurve
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.arclength import correct
from hbbogie.solving.curve import Point
from hbbogie.stability.hill_method import null_mode

Array = NDArray[np.float64]
FIRST = 0.02  # size of the first guess on the new branch, relative to the cycle


def asymmetric(system: System, orbit: Orbit) -> Orbit:
    """Return a slightly asymmetric cycle next to a symmetric one at a pitchfork: even harmonics of the mode added."""
    mode = null_mode(system, orbit, doubled=False)
    return orbit.replace(coefficients=orbit.coefficients + _sized(mode, orbit), method="next to a pitchfork")


def doubled(system: System, orbit: Orbit) -> Orbit:
    """Return a cycle of twice the period next to a period doubling: odd harmonics of half the frequency added."""
    mode = null_mode(system, orbit, doubled=True)
    coefficients = np.zeros_like(mode)
    coefficients[0] = orbit.coefficients[0]
    h = np.arange(1, orbit.H + 1)
    for part in (0, 1):  # harmonic h of the frequency is harmonic 2 h of its half
        coefficients[4 * h - 1 + part] = orbit.coefficients[2 * h - 1 + part]
    method = "next to a period doubling"
    advance = tuple(2 * by for by in orbit.advance)
    coefficients += _sized(mode, orbit)
    return orbit.replace(coefficients=coefficients, omega=orbit.omega / 2, method=method, advance=advance)


def _sized(mode: Array, orbit: Orbit) -> Array:
    return np.asarray(FIRST * mode * np.abs(orbit.coefficients[1:]).max() / np.abs(mode).max())


def crossing(curve: CycleCurve, point: Point, along: Array) -> Orbit:
    """Return a cycle on the branch that crosses the one along a direction, by its tangent (eq-branching-tangents).

    Both tangents annul the quadratic form psi . F_yy on the null space of the Jacobian, psi its left null vector
    (H. B. Keller, in Applications of Bifurcation Theory, Academic Press 1977, 359-384).
    """
    m, place = curve.equations.size, curve.problem.conditions.free
    left, _, right = np.linalg.svd(curve.evaluate(point.u)[1])
    psi, plane = left[:, -1] / curve.rows, right[-2:]
    H = curve.equations.hessian(place)(point.u[:m], curve.problem.parameters(point.u), psi).full()
    sizes, axes = np.linalg.eigh(plane @ (H * np.outer(curve.scale, curve.scale)) @ plane.T)
    share = np.sqrt(np.maximum(sizes * [-1, 1], 0.0))[::-1]  # along both axes; one is of no size where branches touch
    tangents = [(axes @ (share * [1, sign])) @ plane for sign in (1, -1)]
    other = min(tangents, key=lambda t: abs(t @ along))
    y = point.u + FIRST * curve.scale * other / np.linalg.norm(other)
    return curve.equations.decode(y[:m], curve.problem.parameters(y), "a first guess", np.zeros(m))


def first_beyond(curve: CycleCurve, special: SpecialPoint) -> tuple[Point, bool]:
    """Return the first point on the branch that begins at a special point, and whether it goes on to both sides.

    Raises
    ------
    ModelError
        When the harmonics kept do not hold the new cycles.
    ConvergenceError
        When no cycle is found beyond the point.
    """
    equations, guess = curve.equations, special.onward
    assert guess is not None  # asked for by the caller
    place = curve.problem.free[0]
    p = curve.problem.p.copy()
    p[place] = guess.parameters[special.parameter]
    z = equations.encode(guess)
    _check_kept(equations, special, guess, z, p)
    y = np.append(z, p[place])
    both = special.kind != "period doubling"
    if both:
        start = np.append(equations.encode(special.orbit), special.value)
    else:  # the cycle itself does not move in harmonic 1, which sets the phase
        cycle = np.asarray(equations.coefficients(z, p).full())
        cycle[fourier.rows_of(range(1, fourier.highest(cycle) + 1, 2))] = 0.0
        start = np.append(equations.from_coefficients(cycle, guess.omega), p[place])
    direction = (y - start) / curve.scale
    direction = direction / np.linalg.norm(direction)
    if both:
        return Point(start, direction, curve.evaluate(start)[0]), True
    found, _ = correct(curve, y, direction)
    if found is None:
        raise ConvergenceError(
            f"no cycle found beyond the {special.kind} at {special.parameter} = {special.value:.6g} "
            f"({equations.method}). What to try: more harmonics.",
            guess,
        )
    return found, False


def _check_kept(equations: Equations, special: SpecialPoint, guess: Orbit, z: Array, p: Array) -> None:
    """Raise `ModelError` when the equations keep odd harmonics only and the new cycles have even ones."""
    kept, wanted = (np.abs(_even(c)).max() for c in (equations.coefficients(z, p).full(), guess.coefficients))
    if kept < 0.5 * wanted:
        raise ModelError(
            f"trace: cycles beyond the {special.kind} have a mean and even harmonics, which "
            f"{equations.method} leave out; give HarmonicBalance(..., odd=False).equations(system)."
        )


def _even(coefficients: Array) -> Array:
    """Return the mean and the even harmonics."""
    H = fourier.highest(coefficients)
    return np.asarray(coefficients[[0, *(r for h in range(2, H + 1, 2) for r in (2 * h - 1, 2 * h))]])
