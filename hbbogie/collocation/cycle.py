"""A cycle by collocation as plain data: polynomials on a mesh, with error estimates and stability."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import brief
from hbbogie.collocation.mesh import equidistributed
from hbbogie.model.system import System
from hbbogie.polynomials import evaluated, points_of
from hbbogie.results.naming import NAMELESS, Naming
from hbbogie.results.orbit import Orbit, Stability
from hbbogie.results.piecewise import PiecewisePolynomial

Array = NDArray[np.float64]
ROUND_OFF = 1e-12  # relative error below which no estimate is believed


@dataclass(frozen=True, eq=False)
class CollocatedCycle:
    """A periodic motion as a polynomial on each interval of a mesh.

    The state is x = (all coordinates, velocities of those of second order).

    Attributes
    ----------
    system : str
        Name of the system.
    coordinates, units : tuple of str
        Names and units of the n coordinates.
    second_order : tuple of bool
        Whether the state holds the velocity of each coordinate.
    mesh : ndarray, shape (N + 1,)
        Shares of the period, from 0 to 1.
    values : ndarray, shape (N, m + 1, n_states), units of the states
        At the beginnings of the intervals and at their m Gauss points.
    period : float, s
    parameters : dict
        Value of every parameter.
    residual : float
        Largest scaled residual.
    period_error, waveform_error : float
        Estimates, relative to the period and to the range of each state, by a Newton step at the next degree.
    stability : Stability or None
    status : str
        How it was computed, a sentence.
    naming : Naming
    advance : tuple of float, unit of the coordinate
        By how much each coordinate has grown after a period; empty where none runs on.
    """

    system: str
    coordinates: tuple[str, ...]
    units: tuple[str, ...]
    second_order: tuple[bool, ...]
    mesh: Array
    values: Array
    period: float
    parameters: dict[str, float]
    residual: float = float("nan")
    period_error: float = float("nan")
    waveform_error: float = float("nan")
    stability: Stability | None = None
    status: str = ""
    naming: Naming = NAMELESS
    advance: tuple[float, ...] = ()

    __repr__ = brief

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def degree(self) -> int:
        """Degree of the polynomials."""
        return self.values.shape[1] - 1

    @property
    def omega(self) -> float:
        """Frequency [rad/s]."""
        return 2 * np.pi / self.period

    @property
    def method(self) -> str:
        """What computed it, for people."""
        return f"collocation, {len(self.values)} intervals of degree {self.degree}"

    def on(self, N: int, degree: int) -> CollocatedCycle:
        """Return the same motion on a mesh of N intervals on which its errors are equal."""
        size = np.maximum(np.ptp(self.values, axis=(0, 1)), np.finfo(float).tiny)
        mesh = equidistributed(self.mesh, self.values / size, N)
        return replace(self, mesh=mesh, values=evaluated(self.mesh, self.values, points_of(mesh, degree)))

    @cached_property
    def motion(self) -> PiecewisePolynomial:
        """The motion over the phase omega t, but for what it advances."""
        values = self.values.copy()
        values[..., self.n :] /= self.omega
        if self.advance:
            by = np.array(self.advance)
            values[..., : self.n] -= points_of(self.mesh, self.degree)[..., None] * by
            values[..., self.n :] -= by[list(self.second_order)] / (2 * np.pi)
        return PiecewisePolynomial(np.array(self.second_order), self.mesh, values)

    def states(self, t: ArrayLike) -> Array:
        """Return the states at the times t [s], shape (len(t), n_states)."""
        periods, s = np.divmod(np.atleast_1d(np.asarray(t, dtype=float)) / self.period, 1.0)
        x = evaluated(self.mesh, self.values, s)
        x[:, : len(self.advance)] += np.outer(periods, self.advance)
        return x

    def q(self, t: ArrayLike) -> Array:
        """Return the coordinates at the times t [s], shape (len(t), n)."""
        return self.orbit().q(t)

    def v(self, t: ArrayLike) -> Array:
        """Return the velocities at the times t [s], shape (len(t), n)."""
        return self.orbit().v(t)

    def amplitude(self, coordinate: str) -> float:
        """Return the peak, the largest absolute value over the period, of a coordinate [its unit]."""
        return self.orbit().amplitude(coordinate)

    def mark(self) -> Array:
        """Return frequency [rad/s], then means, smallest and largest values of the coordinates, shape (1 + 3 n,)."""
        return np.concatenate([[self.omega], self.motion.mean(), *self.motion.extremes])

    def orbit(self) -> Orbit:
        """Return the cycle as an orbit, which answers everything about its motion."""
        peaks = np.maximum(np.abs(self.motion.extremes).max(axis=0), np.abs(self.advance or 0.0))
        errors = {"omega": max(self.period_error, ROUND_OFF) * self.omega, "waveform": self.waveform_error}
        errors |= {c: self.waveform_error * float(p) for c, p in zip(self.coordinates, peaks, strict=True)}
        return Orbit(
            self.system,
            self.coordinates,
            self.units,
            self.motion,
            self.omega,
            dict(self.parameters),
            self.method,
            self.residual,
            self.status,
            self.stability,
            errors if np.isfinite(self.period_error) else None,
            self.naming,
            self.advance,
        )


def cycle_of(
    system: System,
    mesh: Array,
    values: Array,
    period: float,
    parameters: dict[str, float] | None = None,
    advance: tuple[float, ...] = (),
) -> CollocatedCycle:
    """Return a cycle of a system, at its values where no others are given; not solved for yet."""
    return CollocatedCycle(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        system.second_order,
        mesh,
        values,
        period,
        dict(system.values) if parameters is None else parameters,
        naming=system.naming,
        advance=advance,
    )


def cycle_again(system: System, orbit: Orbit) -> CollocatedCycle:
    """Return an orbit that collocation has given, on its own mesh; not solved for yet.

    Parameters
    ----------
    system : System
    orbit : Orbit
        Whose ``motion`` is a piecewise polynomial.
    """
    motion = orbit.motion
    assert isinstance(motion, PiecewisePolynomial)
    values = motion.values.copy()
    if orbit.advance:
        by = np.array(orbit.advance)
        values[..., : system.n] += points_of(motion.mesh, motion.degree)[..., None] * by
        values[..., system.n :] += by[list(system.second_order)] / (2 * np.pi)
    values[..., system.n :] *= orbit.omega
    return cycle_of(system, motion.mesh, values, orbit.period, dict(orbit.parameters), orbit.advance)
