"""Nonlinear force laws.

A law is a scalar function of one argument u, which is a coordinate, a velocity, or a linear combination of them.
`Element` says where it acts. Laws made of straight lines also provide their `ramps`. From these, harmonic balance
integrates laws without jumps exactly between the contact times, and stability and shooting locate contacts and jumps.
``describing(amplitude)``, where known in closed form, is the describing function: the first harmonic of the force over
u = Y cos(tau), divided by Y. ``reference_stiffness()`` is that of the oscillator about which the second order expands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, as_number
from hbbogie.model.ramps import Ramps, Scalar
from hbbogie.model.scalars import check_list, check_scalars

FAR = 1e30  # times the limit: where a spring of no stiffness reaches it


@runtime_checkable
class Law(Protocol):
    """A force law: implement ``force`` and everything else works.

    Optional methods: ``describing(amplitude)``, the describing function in closed form, and
    ``reference_stiffness()``, which the second-order describing function asks for.
    """

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u, a scalar CasADi expression."""


class PiecewiseLinear:
    """What the piecewise-linear laws share: force and describing function follow from their ramps."""

    def ramps(self) -> Ramps:
        """Return the law as straight line plus ramps."""
        raise NotImplementedError

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        return self.ramps().force(u)

    def describing(self, amplitude: Scalar) -> Scalar:
        """Return the describing function at an amplitude."""
        return self.ramps().describing(amplitude)


@dataclass(frozen=True, eq=False)
class DeadBand(PiecewiseLinear):
    """A spring behind a gap on either side: no force for abs(u) <= gap.

    Parameters
    ----------
    stiffness : scalar, unit of force per unit of the argument
    gap : scalar, unit of the argument
    """

    stiffness: Scalar
    gap: Scalar

    def __post_init__(self) -> None:
        check_scalars(self, not_negative="gap")

    def ramps(self) -> Ramps:
        """Return the two ramps of the dead band."""
        return Ramps(((1, self.stiffness, self.gap), (-1, self.stiffness, self.gap)))

    def reference_stiffness(self) -> Scalar:
        """Return the stiffness behind the gap."""
        return self.stiffness


@dataclass(frozen=True, eq=False)
class Saturation(PiecewiseLinear):
    """A spring whose force is limited: stiffness * u up to +-limit, and from there on with another slope.

    Attached to a velocity it is a damper with blow-off.

    Parameters
    ----------
    stiffness : scalar, unit of force per unit of the argument
        At 0 the law is no force.
    limit : scalar, unit of force
    beyond : scalar, unit of force per unit of the argument
        Slope beyond the limit.
    """

    stiffness: Scalar
    limit: Scalar
    beyond: Scalar = 0.0

    def __post_init__(self) -> None:
        check_scalars(self, not_negative="limit")

    def ramps(self) -> Ramps:
        """Return the spring and the two ramps that change its slope beyond the limit."""
        k = ca.SX(self.stiffness)
        reach = self.limit * ca.if_else(k == 0, FAR, 1 / ca.fabs(ca.if_else(k == 0, 1, k)))  # with finite derivatives
        change = self.beyond - self.stiffness
        return Ramps(((1, change, reach), (-1, change, reach)), self.stiffness)

    def reference_stiffness(self) -> Scalar:
        """Return the stiffness below the limit."""
        return self.stiffness


@dataclass(frozen=True, eq=False)
class Tabulated(PiecewiseLinear):
    """A measured law: straight lines between points, the end lines go on beyond the table.

    Parameters
    ----------
    u : sequence of float, unit of the argument
        Increasing abscissae, at least two.
    forces : sequence of float, unit of force
        The force at each.
    """

    u: Sequence[float]
    forces: Sequence[float]

    __repr__ = brief

    def __post_init__(self) -> None:
        check_list("Tabulated: u", self.u)
        check_list("Tabulated: forces", self.forces)
        if any(np.isnan(as_number(u)) for u in self.u):
            raise ModelError(f"Tabulated: the abscissae must be numbers, got {list(self.u)}.")
        if len(self.u) != len(self.forces) or len(self.u) < 2:
            raise ModelError(
                f"Tabulated: got {len(self.u)} abscissae and {len(self.forces)} forces; "
                "give the same number of each, at least two."
            )
        if np.any(np.diff(self.u) <= 0):
            raise ModelError(f"Tabulated: the abscissae must increase, got {list(self.u)}; sort the table.")

    def ramps(self) -> Ramps:
        """Return the first line of the table and a ramp for each change of slope."""
        n = len(self.u)
        slopes = [(self.forces[i + 1] - self.forces[i]) / (self.u[i + 1] - self.u[i]) for i in range(n - 1)]
        terms = tuple((1, slopes[i] - slopes[i - 1], self.u[i]) for i in range(1, n - 1))
        return Ramps(terms, stiffness=slopes[0], offset=self.forces[0] - slopes[0] * self.u[0])


@dataclass(frozen=True, eq=False)
class Cubic:
    """A spring with a cubic term: stiffness * u + coefficient * u^3.

    Parameters
    ----------
    coefficient : scalar, unit of force per cubed unit of the argument
    stiffness : scalar, unit of force per unit of the argument
    """

    coefficient: Scalar
    stiffness: Scalar = 0.0

    def __post_init__(self) -> None:
        check_scalars(self)

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        return self.stiffness * u + self.coefficient * u**3

    def polynomial(self) -> tuple[Scalar, ...]:
        """Return the coefficients of u^0, u^1, u^2 and u^3."""
        return (0.0, self.stiffness, 0.0, self.coefficient)

    def describing(self, amplitude: Scalar) -> Scalar:
        """Return the describing function at an amplitude, stiffness + (3/4) coefficient Y^2."""
        return self.stiffness + 0.75 * self.coefficient * amplitude**2

    def reference_stiffness(self) -> Scalar:
        """Return the linear stiffness."""
        return self.stiffness


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A polynomial law: ``sum_i coefficients[i] * u**i``.

    Parameters
    ----------
    coefficients : sequence of scalar
        Coefficient of u^i at place i, the constant first.
    """

    coefficients: Sequence[Scalar]

    def __post_init__(self) -> None:
        check_list("Polynomial: coefficients", self.coefficients)

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        f: Scalar = 0.0
        for c in reversed(list(self.coefficients)):
            f = f * u + c
        return f

    def polynomial(self) -> tuple[Scalar, ...]:
        """Return the coefficients, the constant first."""
        return tuple(self.coefficients)

    def describing(self, amplitude: Scalar) -> Scalar:
        """Return the describing function at an amplitude: the first harmonic of u^n is that of cos^n, n odd."""
        N: Scalar = 0.0
        for n in range(1, len(self.coefficients), 2):
            N = N + self.coefficients[n] * comb(n, n // 2) / 2 ** (n - 1) * amplitude ** (n - 1)
        return N

    def reference_stiffness(self) -> Scalar:
        """Return the linear stiffness."""
        return self.coefficients[1] if len(self.coefficients) > 1 else 0.0


@dataclass(frozen=True, eq=False)
class Friction:
    """Dry friction, regularised: limit * tanh(u / width). Attach it to a velocity.

    Parameters
    ----------
    limit : scalar, unit of force
    width : scalar, unit of the argument
        Sliding velocity at which 76 % of the limit is reached; the smaller, the more harmonics it takes.
    """

    limit: Scalar
    width: Scalar

    def __post_init__(self) -> None:
        check_scalars(self, above_zero="width")

    def force(self, u: Scalar) -> Scalar:
        """Return the force at the argument u."""
        return self.limit * ca.tanh(u / self.width)


@dataclass(frozen=True, eq=False)
class Step(PiecewiseLinear):
    """A force that switches on: height for u > threshold, none below, half at the threshold.

    As a factor it switches between two vector fields: with a step s of height 1, ``(1 - s) * left + s * right``.

    Parameters
    ----------
    height : scalar, unit of force
    threshold : scalar, unit of the argument
    """

    height: Scalar = 1.0
    threshold: Scalar = 0.0

    def __post_init__(self) -> None:
        check_scalars(self)

    def ramps(self) -> Ramps:
        """Return the jump, a ramp of no slope that begins with it."""
        return Ramps(((1, 0.0, self.threshold),), heights=(self.height,))


@dataclass(frozen=True, eq=False)
class CoulombFriction(PiecewiseLinear):
    """Dry friction as Coulomb has it: limit * sign(u). Attach it to a velocity.

    Motions that slide both ways and pass through u = 0 at once are followed, by their describing function, by harmonic
    balance and by shooting. Sticking is not: it is detected (`floquet`, `verify`), and needs `Friction`. Linearised at
    rest this law is no force at all.

    Parameters
    ----------
    limit : scalar, unit of force
    """

    limit: Scalar

    def __post_init__(self) -> None:
        check_scalars(self)

    def ramps(self) -> Ramps:
        """Return the two jumps, upwards for u > 0 and downwards for u < 0."""
        return Ramps(((1, 0.0, 0.0), (-1, 0.0, 0.0)), heights=(self.limit, self.limit))


@dataclass(frozen=True, eq=False)
class Backlash:
    """A spring that is driven through play and keeps its position inside it: a hysteresis.

    The force depends on the motion before, not on u alone: no element of a system can be made of it. Its describing
    function is complex.

    Parameters
    ----------
    stiffness : scalar, unit of force per unit of the argument
    gap : scalar, unit of the argument
        Half the play.

    References
    ----------
    A. Gelb, W. E. Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design,
    McGraw-Hill 1968, appendix B.
    """

    stiffness: Scalar
    gap: Scalar

    def __post_init__(self) -> None:
        check_scalars(self, not_negative="gap")

    def steady_force(self, tau: ArrayLike, amplitude: float) -> NDArray[np.float64]:
        """Return the force over u = amplitude * cos(tau) once the motion is periodic.

        Parameters
        ----------
        tau : array_like, rad
        amplitude : float, unit of the argument

        Returns
        -------
        ndarray, shape of tau, unit of force
            Zero where the amplitude does not exceed the gap.
        """
        k, g, Y = (float(value) for value in (self.stiffness, self.gap, amplitude))
        t: NDArray[np.float64] = np.mod(np.asarray(tau, dtype=float), 2 * np.pi)
        sign = np.where(t < np.pi, 1.0, -1.0)  # u falls in the first half of the period and rises in the second
        return np.asarray(k * sign * np.minimum(sign * Y * np.cos(t) + g, Y - g) * (g < Y))

    def describing(self, amplitude: Scalar) -> tuple[Scalar, Scalar]:
        """Return real and imaginary part of the describing function at an amplitude.

        The force lags: the imaginary part is negative, and pi Y^2 times its size is the work lost in a cycle.
        """
        r = ca.SX(self.gap) / amplitude
        engaged, crossing = r < 1, ca.logic_and(r > 0, r < 1)
        # the angle at which the play is crossed, from cos = 1 - 2 r in a form with finite derivatives
        sine = 2 * ca.sqrt(ca.if_else(crossing, r * (1 - r), 0.25))
        angle = ca.if_else(crossing, ca.atan2(sine, ca.if_else(crossing, 1 - 2 * r, 0)), 0)
        real = 1 - (angle - ca.sin(2 * angle) / 2) / np.pi
        return (
            ca.if_else(engaged, self.stiffness * real, 0),
            ca.if_else(engaged, -4 * self.stiffness * r * (1 - r) / np.pi, 0),
        )
