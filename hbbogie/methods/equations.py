"""The interface between methods and solvers: algebraic equations F(z, p) = 0 for cycles, from any method.

Solvers, continuation and optimisation see only `Equations`. A method makes them and never imports a solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.brief import lines
from hbbogie.errors import ModelError
from hbbogie.model.system import System
from hbbogie.once import Once
from hbbogie.results import Orbit
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]
LOPSIDED = 0.01  # mean and even harmonics, relative to the largest coefficient, beyond which an orbit is not odd
# Smallest first harmonic, relative to the largest, with which a coordinate can set the phase: in a first cycle, of a
# hundredth of the amplitude scale, it must lie above its lower bound.
RESTING = 2e-3


@runtime_checkable
class SolvesItself(Protocol):
    """Equations of cycles that do not have the form F(z, p) = 0 of fixed size and bring their own solver."""

    @property
    def system(self) -> System:
        """The system whose parameter values apply by default."""

    def solve(self, guess: Orbit, **fixed: float) -> Orbit:
        """Return the cycle near a guess at given parameter values."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """Equations F(z, p) = 0, as many as unknowns z, with bounds, scales and conversion to and from `Orbit`.

    Attributes
    ----------
    system : System
        Its parameter values apply unless a solver is given others.
    method : str
        Description of the method, for messages.
    residual : casadi.Function, (z, p) -> F, shape (m,)
    derivatives : callable
        Places of free parameters -> casadi.Function (z, p) -> (F, dF/d(z, p[free])), exact.
    hessian : callable
        Places of free parameters -> casadi.Function (z, p, multipliers) -> second derivative of
        multipliers . F with respect to (z, p[free]), exact.
    hessian_times : callable
        The same -> casadi.Function (z, p, multipliers, direction) -> that second derivative times a direction, far
        cheaper than all of it.
    sensitivity : callable
        () -> casadi.Function (z, p, multipliers) -> derivative of multipliers . F with respect to p, exact.
    coefficients : casadi.Function, (z, p) -> shape (2 H + 1, n), unit of the coordinate
        The Fourier coefficients of all coordinates.
    frequency : casadi.Function, z -> omega [rad/s] (0 for equilibria)
    from_coefficients : callable
        (coefficients, omega) -> z; the inverse of the two for a cycle in the right phase.
    unknowns, rows : tuple of str
        Labels of z and of F.
    lower, upper, scale : ndarray, shape (m,), unit of z
        Bounds that exclude the zero solution and divergence; typical size of each unknown.
    residual_scale : ndarray, shape (m,), unit of F
    phase : int or None
        Coordinate whose sine coefficient of the first harmonic is zero, or, if coordinates run on, the first of them,
        whose mean is zero; None for equilibria.
    advance : tuple of float, unit of the coordinate
        By how much each coordinate grows in a period; empty where none runs on.
    cosines : dict of int to int
        Coordinates whose first harmonic is among the unknowns: the place in z of its cosine coefficient.
    with_phase : callable or None
        (name of a coordinate, system) -> the equations with the phase set by that one; None if the user chose it.
    with_even : callable or None
        system -> the equations that also keep the even harmonics; None if these do, or if the user chose odd ones.
    running : callable or None
        (advance, system) -> the equations of motions that run on, or back again; None if the method has none.
    once : Once
        Store of objects built once for these functions, shared by all equations that have them.
    """

    system: System
    method: str
    residual: ca.Function
    derivatives: Callable[[tuple[int, ...]], ca.Function]
    hessian: Callable[[tuple[int, ...]], ca.Function]
    hessian_times: Callable[[tuple[int, ...]], ca.Function]
    sensitivity: Callable[[], ca.Function]
    coefficients: ca.Function
    frequency: ca.Function
    from_coefficients: Callable[[Array, float], Array]
    unknowns: tuple[str, ...]
    rows: tuple[str, ...]
    lower: Array
    upper: Array
    scale: Array
    residual_scale: Array
    phase: int | None
    cosines: dict[int, int]
    advance: tuple[float, ...] = ()
    with_phase: Callable[[str, System], Equations] | None = None
    with_even: Callable[[System], Equations] | None = None
    running: Callable[[tuple[float, ...], System], Equations] | None = None
    once: Once = field(default_factory=Once, repr=False)

    def __repr__(self) -> str:
        names, p = self.system.coordinate_names, self.system.values
        phase = "no phase: equilibria" if self.phase is None else f"phase set by {names[self.phase]}"
        phase += ", which runs on" if self.advance else ""
        return lines(
            f"Equations of {self.system.name} by {self.method}",
            f"{self.size} unknowns: {', '.join(self.unknowns[:6])}{' ...' * (self.size > 6)}; {phase}",
            f"at {self.system.naming.values(p)}" if p else "",
        )

    @property
    def size(self) -> int:
        """Number of unknowns, and of equations."""
        return len(self.unknowns)

    @property
    def leading(self) -> int | None:
        """Place in z of the cosine coefficient of the first harmonic of the coordinate that sets the phase, or None.

        None where coordinates run on, since such a motion does not vanish with that coefficient.
        """
        return None if self.phase is None or self.advance else self.cosines[self.phase]

    def phased(self, orbit: Orbit) -> Equations:
        """Return the equations that suit an orbit; the same equations if they already do.

        Their phase is set by a coordinate that moves in the orbit. An odd system may have cycles that are not odd, for
        example about an equilibrium away from zero. For these the even harmonics are kept, unless the user chose odd
        ones. Coordinates that run on in the orbit do so in the equations.

        Raises
        ------
        ModelError
            When coordinates run on that cannot, or the method has no equations of such motions.
        """
        names = self.system.coordinate_names
        if self.phase is None or orbit.H == 0 or orbit.coordinates != names:
            return self
        if orbit.advance != self.advance:
            if self.running is None:
                raise ModelError(
                    f"a coordinate runs on in the orbit of {orbit.system!r}, and {self.method} has no equations for "
                    "that; take HarmonicBalance(harmonics) without odd=True, or Collocation."
                )
            return self.running(orbit.advance, self.system).phased(orbit)
        if self.advance:
            return self
        if self.with_even is not None and not orbit.is_odd(LOPSIDED):
            return self.with_even(self.system).phased(orbit)
        if self.with_phase is None:
            return self
        sizes = np.hypot(*orbit.coefficients[1:3])
        largest = max(self.cosines, key=lambda i: float(sizes[i]))
        return self if sizes[self.phase] > RESTING * sizes[largest] else self.with_phase(names[largest], self.system)

    def encode(self, orbit: Orbit) -> Array:
        """Return the unknowns of an orbit, shifted in time to the phase condition, shape (m,).

        Raises
        ------
        ModelError
            When the orbit belongs to other coordinates, or does not move although a cycle is required.
        """
        if orbit.coordinates != self.system.coordinate_names:
            raise ModelError(
                f"the guess is an orbit of {orbit.system!r} with coordinates {', '.join(orbit.coordinates)}; "
                f"the equations are those of {self.system.name!r} with {', '.join(self.system.coordinate_names)}."
            )
        c = orbit.harmonics(max(orbit.H, (self.coefficients.size1_out(0) - 1) // 2))
        if self.phase is not None and self.advance:
            if orbit.advance != self.advance:
                raise ModelError(
                    f"the guess advances by {orbit.advance or 0} in a period, and the equations are those of motions "
                    f"that advance by {self.advance}; take equations.phased(guess)."
                )
            drift = np.array(self.advance) / (2 * np.pi)
            tau = -c[0, self.phase] / drift[self.phase]
            c = fourier.shift(c, tau)
            c[0] += drift * tau
        elif self.phase is not None:
            if orbit.H == 0 or np.hypot(*c[1:3, self.phase]) == 0:
                raise ModelError(
                    f"the guess does not move in {orbit.coordinates[self.phase]!r}, the coordinate that sets the "
                    "phase; give a cycle, or choose another with HarmonicBalance(..., phase=name)."
                )
            c = fourier.shift(c, float(np.arctan2(c[2, self.phase], c[1, self.phase])))
        return self.from_coefficients(c, orbit.omega)

    def decode(self, z: Array, p: Array, status: str = "", F: Array | None = None) -> Orbit:
        """Return the orbit of the unknowns z at the parameter vector p; ``F`` is the residual if it is known."""
        if F is None:
            F = self.residual(z, p).full().ravel()
        return self.decode_each(z[None], p[None], F[None], status)[0]

    def decode_each(self, z: Array, p: Array, F: Array, status: str = "") -> list[Orbit]:
        """Return the orbits of unknowns z, shape (P, m), at parameter vectors p, where the residuals are F."""
        system, P = self.system, len(z)
        c = self.coefficients(z.T, p.T).full()
        c = c.reshape(len(c), P, -1).swapaxes(0, 1)
        residual = np.abs(F / self.residual_scale).max(axis=1)
        names, omega = system.parameter_names, np.broadcast_to(self.frequency(z.T).full().ravel(), P)
        units = tuple(coordinate.unit for coordinate in system.coordinates)
        return [
            Orbit(
                system=system.name,
                coordinates=system.coordinate_names,
                naming=system.naming,
                units=units,
                motion=FourierSeries(np.array(c[k])),
                omega=float(omega[k]),
                parameters=dict(zip(names, p[k].tolist(), strict=True)),
                method=self.method,
                residual=float(residual[k]),
                status=status,
                advance=self.advance,
            )
            for k in range(P)
        ]
