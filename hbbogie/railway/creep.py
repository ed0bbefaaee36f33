"""Creep laws: the tangential forces between wheel and rail over the creepages.

xi is the longitudinal creepage, eta the lateral one [1], phi the spin creepage [1/m], as Kalker writes them. Forces
are those on the wheel: they oppose the creepages. At zero creepage each law has its exact value, 0, and the exact
slopes of the linear theory, without a division of zero by zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, told
from hbbogie.model.ramps import Scalar
from hbbogie.model.removable import magnitude, quotient
from hbbogie.model.scalars import check_scalars

Forces = tuple[Scalar, Scalar]
LARGEST = 1e100  # size of a creepage, whose square still is a number
REST = 1e-100  # squared creepage that counts as none: derivatives of quotients of smaller ones overflow


class CreepLaw(Protocol):
    """A law that gives the creep forces on a wheel."""

    def force(self, xi: Scalar, eta: Scalar) -> Forces:
        """Return the longitudinal and the lateral force [N]."""


@dataclass(frozen=True, eq=False)
class LinearKalker:
    """Kalker's linear theory: small creepages, no slip.

    ``Fx = -f11 xi,  Fy = -f22 eta - f23 phi,  Mz = f23 eta - f33 phi``

    Parameters
    ----------
    f11, f22 : scalar, N
        Longitudinal and lateral creep coefficient.
    f23 : scalar, N m
        Lateral force of spin, and moment of lateral creepage.
    f33 : scalar, N m2
        Moment of spin.

    References
    ----------
    J. J. Kalker, Three-Dimensional Elastic Bodies in Rolling Contact, Kluwer 1990.

    Examples
    --------
    >>> from hbbogie.railway import LinearKalker
    >>> LinearKalker(f11=9.4e6, f22=8.7e6).force(1e-4, 0.0)
    (-940.0, 0.0)
    """

    f11: Scalar
    f22: Scalar
    f23: Scalar = 0.0
    f33: Scalar = 0.0

    def __post_init__(self) -> None:
        check_scalars(self)

    def force(self, xi: Scalar, eta: Scalar, phi: Scalar = 0.0) -> Forces:
        """Return the longitudinal and the lateral force on the wheel.

        Parameters
        ----------
        xi, eta : number, array or CasADi expression, 1
            Longitudinal and lateral creepage.
        phi : number, array or CasADi expression, 1/m
            Spin creepage.
        """
        return _evaluated(self._force, xi, eta, phi)

    def moment(self, xi: Scalar, eta: Scalar, phi: Scalar = 0.0) -> Scalar:
        """Return the spin moment on the wheel [N m]; arguments as of `force`."""
        return _evaluated(lambda xi, eta, phi: (self.f23 * eta - self.f33 * phi,), xi, eta, phi)[0]

    def _force(self, xi: Scalar, eta: Scalar, phi: Scalar) -> Forces:
        return -self.f11 * xi, -self.f22 * eta - self.f23 * phi


@dataclass(frozen=True, eq=False)
class ShenHedrickElkins:
    """Shen, Hedrick and Elkins: Kalker's linear forces, spin included, saturated as by Johnson and Vermeulen.

    ``F = e(u) F_linear`` with u = abs(F_linear) / limit; e = 1 - u/3 + u^2/27 for u < 3 and 1/u beyond.
    The law is twice differentiable at u = 3. At zero creepage it is only once differentiable.

    Parameters
    ----------
    f11, f22 : scalar, N
        Longitudinal and lateral creep coefficient.
    limit : scalar, N
        Coefficient of friction times normal force.
    f23 : scalar, N m
        Lateral force of spin.

    References
    ----------
    Z. Y. Shen, J. K. Hedrick, J. A. Elkins, A comparison of alternative creep-force models for rail vehicle dynamic
    analysis, 8th IAVSD Symposium, 1983.
    """

    f11: Scalar
    f22: Scalar
    limit: Scalar
    f23: Scalar = 0.0

    def __post_init__(self) -> None:
        check_scalars(self, above_zero="limit")

    def force(self, xi: Scalar, eta: Scalar, phi: Scalar = 0.0) -> Forces:
        """Return the longitudinal and the lateral force on the wheel; arguments as of `LinearKalker.force`."""
        return _evaluated(self._force, xi, eta, phi)

    def _force(self, xi: Scalar, eta: Scalar, phi: Scalar) -> Forces:
        return _saturated(-self.f11 * xi, -self.f22 * eta - self.f23 * phi, self.limit)


@dataclass(frozen=True, eq=False)
class VermeulenJohnson:
    """Vermeulen and Johnson: elliptical contact without spin.

    ``F = -e(u) g`` with g = (C xi / psi, C eta / phi), u = abs(g) / limit and e as of `ShenHedrickElkins`.

    Parameters
    ----------
    C : scalar, N
        pi a b G, of the semi-axes of the contact ellipse and the shear modulus.
    limit : scalar, N
        Coefficient of friction times normal force.
    psi, phi : scalar, 1
        Longitudinal and lateral shape factor; the defaults are those of C. Kaas-Petersen, Chaos in a railway bogie,
        Acta Mechanica 61, 1986.

    References
    ----------
    P. J. Vermeulen, K. L. Johnson, Contact of nonspherical elastic bodies transmitting tangential forces, Journal of
    Applied Mechanics 31, 1964.
    """

    C: Scalar
    limit: Scalar
    psi: Scalar = 0.60252
    phi: Scalar = 0.54219

    def __post_init__(self) -> None:
        check_scalars(self, above_zero="limit psi phi")

    def force(self, xi: Scalar, eta: Scalar) -> Forces:
        """Return the longitudinal and the lateral force on the wheel; arguments as of `LinearKalker.force`."""
        return _evaluated(self._force, xi, eta)

    def _force(self, xi: Scalar, eta: Scalar) -> Forces:
        return _saturated(-self.C / self.psi * xi, -self.C / self.phi * eta, self.limit)


@dataclass(frozen=True, eq=False)
class Polach:
    """Polach's law of 1999, with spin.

    Its slopes at zero along xi, eta and phi are those of Kalker's linear theory: G a b c11, G a b c22 and
    G (a b)^(3/2) c23. Between these directions the law is not linear, however small the creepages. With spin its
    slope jumps where the effective lateral creepage changes sign.

    Parameters
    ----------
    a, b : scalar, m
        Semi-axes of the contact ellipse, in the rolling direction and across.
    G : scalar, Pa
        Shear modulus.
    c11, c22, c23 : scalar, 1
        Kalker's coefficients, such as those of `kalker_coefficients`.
    load : scalar, N
        Normal force.
    friction : scalar, 1
        Coefficient of friction.

    References
    ----------
    O. Polach, A fast wheel-rail forces calculation computer code, Vehicle System Dynamics 33 (supplement), 1999,
    728-739.
    """

    a: Scalar
    b: Scalar
    G: Scalar
    c11: Scalar
    c22: Scalar
    c23: Scalar
    load: Scalar
    friction: Scalar

    def __post_init__(self) -> None:
        check_scalars(self, above_zero="a b G load friction")

    def force(self, xi: Scalar, eta: Scalar, phi: Scalar = 0.0) -> Forces:
        """Return the longitudinal and the lateral force on the wheel; arguments as of `LinearKalker.force`."""
        return _evaluated(self._force, xi, eta, phi)

    def _friction(self, slip: Scalar) -> Scalar:
        return self.friction

    def _gradient(self, eps: Scalar) -> Scalar:
        """Return the tangential force over the linear one, times 2."""
        return 1 / (1 + eps**2) + quotient(ca.atan(eps), eps, 1)

    def _force(self, xi: Scalar, eta: Scalar, phi: Scalar) -> Forces:
        a, b, G = self.a, self.b, self.G
        square = xi**2 + eta**2
        shifted = eta + phi * a
        lateral = ca.if_else(ca.fabs(shifted) > ca.fabs(eta), shifted, eta)  # effective lateral creepage
        total_square = xi**2 + lateral**2
        total = magnitude(xi, lateral)
        mu = self._friction(magnitude(xi, eta))
        moving = square > REST
        safe = ca.if_else(moving, square, 1)
        c = ca.sqrt((ca.if_else(moving, self.c11 * xi, 1)) ** 2 / safe + (self.c22 * eta) ** 2 / safe)
        # at zero each direction has its own coefficient, so that the slope there is that of the linear theory
        stiffness = [G * a * b * ca.if_else(moving, c, own) for own in (self.c11, self.c22)]
        kx, ky = (k / 2 * self._gradient(np.pi * k * total / (4 * self.load * mu)) for k in stiffness)
        share = ca.if_else(total_square > REST, ca.fabs(lateral) / ca.if_else(total_square > REST, total, 1), 1)
        return -kx * xi, -ky * eta - self._spin(lateral, mu) * share * phi

    def _spin(self, lateral: Scalar, mu: Scalar) -> Scalar:
        """Return the lateral force of spin, over the spin [N m].

        The paper's bracket of F_S equals (2/3) eps_M / (1 + eps_M^2)^2.
        """
        a, b = self.a, self.b
        wide = 1 + 6.3 * (1 - ca.exp(-a / b))
        stiffness = self.G * (a * b) ** 1.5 * self.c23
        square = (8 * stiffness * lateral / (3 * a * wide * self.load * mu)) ** 2  # eps_M^2
        return stiffness / (1 + square) ** 2


@dataclass(frozen=True, eq=False)
class Polach2005(Polach):
    """Polach's law with the extension of 2005: friction that falls with the slip velocity, and reduced slopes.

    The coefficient of friction is ``friction * ((1 - ratio) exp(-decay * w) + ratio)`` at the slip velocity
    w = speed * sqrt(xi^2 + eta^2). The slopes at zero are (adhesion + slip)/2 times those of the linear theory.

    Parameters
    ----------
    a, b, G, c11, c22, c23, load, friction
        As of `Polach`; friction is that at zero slip velocity.
    speed : scalar, m/s
        Forward speed.
    ratio : scalar, 1
        Coefficient of friction at infinite slip velocity, over that at zero.
    decay : scalar, s/m
    adhesion, slip : scalar, 1
        Reduction factors k_A in the area of adhesion and k_S in the area of slip, k_S <= k_A <= 1.

    References
    ----------
    O. Polach, Creep forces in simulations of traction vehicles running on adhesion limit, Wear 258, 2005, 992-1000.
    """

    speed: Scalar
    ratio: Scalar
    decay: Scalar
    adhesion: Scalar = 1.0
    slip: Scalar = 1.0

    def __post_init__(self) -> None:
        check_scalars(self, above_zero="a b G load friction", not_negative="ratio decay adhesion slip")

    def _friction(self, slip: Scalar) -> Scalar:
        return self.friction * ((1 - self.ratio) * ca.exp(-self.decay * self.speed * slip) + self.ratio)

    def _gradient(self, eps: Scalar) -> Scalar:
        return self.adhesion / (1 + (self.adhesion * eps) ** 2) + quotient(ca.atan(self.slip * eps), eps, self.slip)


def _saturated(Fx: Scalar, Fy: Scalar, limit: Scalar) -> Forces:
    u = magnitude(Fx, Fy) / limit
    e = ca.if_else(u < 3, 1 - u / 3 + u**2 / 27, 1 / ca.fmax(u, 3))
    return e * Fx, e * Fy


def _arrays(creepages: tuple[Any, ...]) -> list[NDArray[np.float64]]:
    """Return creepages as arrays of one shape; raise `ModelError` where they are no finite numbers."""
    try:
        if any(c is None for c in creepages):
            raise TypeError("None is no number")
        arrays = np.broadcast_arrays(*(np.asarray(c, dtype=float) for c in creepages))
    except (TypeError, ValueError) as error:
        raise ModelError(
            f"creepages: {error}; give numbers, arrays of one shape, or expressions of coordinates and parameters."
        ) from None
    if not all((np.abs(a) <= LARGEST).all() for a in arrays):  # not where one is NaN either
        beyond = next(c for c, a in zip(creepages, arrays, strict=True) if not (np.abs(a) <= LARGEST).all())
        raise ModelError(f"creepages: got {told(beyond)}; give finite numbers up to {LARGEST:g}.")
    return list(arrays)


def _evaluated(law: Callable[..., tuple[Scalar, ...]], *creepages: Scalar) -> tuple[Scalar, ...]:
    """Return what a law gives: an expression for expressions, a number for numbers, an array for arrays."""
    if any(isinstance(c, ca.SX | ca.MX | ca.DM) for c in creepages):
        return law(*creepages)
    arrays = _arrays(creepages)
    results = [ca.DM(r) if isinstance(r, float) else r for r in law(*(ca.DM(a.ravel()) for a in arrays))]
    if not all(isinstance(r, ca.DM) for r in results):  # the law has symbolic coefficients
        return tuple(results)
    plain = (r.full().reshape(arrays[0].shape) + 0.0 for r in results)  # -0 becomes 0
    return tuple(float(r) if r.ndim == 0 else r for r in plain)
