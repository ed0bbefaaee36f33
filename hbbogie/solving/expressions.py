"""A cycle as expressions of the unknowns, for use in objectives and limits."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from hbbogie import fourier
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.equations import Equations

SAMPLES = 64  # samples per period


class Cycle:
    """A cycle as expressions of the unknowns, for use in objectives and limits.

    Parameters
    ----------
    equations : Equations
    z, p : casadi.MX
        Unknowns and all parameters.

    Attributes
    ----------
    coefficients : casadi.MX, shape (2 H + 1, n), unit of the coordinate
    omega : casadi.MX, rad/s
    """

    def __init__(self, equations: Equations, z: ca.MX, p: ca.MX):
        self._system, self._p, self._advance = equations.system, p, equations.advance
        self.coefficients, self.omega = equations.coefficients(z, p), equations.frequency(z)
        self.H = (self.coefficients.shape[0] - 1) // 2

    def parameter(self, name: str) -> ca.MX:
        """Return a parameter [its unit]."""
        self._system.parameter(name)
        return self._p[self._system.parameter_names.index(name)]

    def harmonic(self, coordinate: str, h: int) -> ca.MX:
        """Return the amplitude of a harmonic, 1 to H, of a coordinate [its unit]."""
        if not 1 <= h <= self.H:
            raise ModelError(f"harmonic {h} of {coordinate!r}: the equations keep harmonics up to {self.H}.")
        return ca.norm_2(self.coefficients[2 * h - 1 : 2 * h + 1, self._system.index(coordinate)])

    def first_harmonic(self, coordinate: str) -> ca.MX:
        """Return the amplitude of the first harmonic of a coordinate [its unit]."""
        return self.harmonic(coordinate, 1)

    def root_mean_square(self, coordinate: str) -> ca.MX:
        """Return the root of the mean square of a coordinate over the period [its unit]."""
        c = self.coefficients[:, self._system.index(coordinate)]
        return ca.sqrt(c[0] ** 2 + 0.5 * ca.sumsqr(c[1:]))

    def values(self, coordinate: str, samples: int = SAMPLES) -> ca.MX:
        """Return a coordinate, or its periodic part, at equidistant times over the period, shape (samples,)."""
        E = fourier.synthesis(self.H, fourier.phases(samples))
        return ca.mtimes(E, self.coefficients[:, self._system.index(coordinate)])

    def force(self, element: str, samples: int = SAMPLES) -> ca.MX:
        """Return the force of an element at equidistant times over the period, shape (samples,) [its unit]."""
        names = [e.name for e in self._system.elements]
        if element not in names:
            raise ModelError(f"system {self._system.name!r}: {unknown_name('element', element, names)}")
        law, tau = self._system.elements[names.index(element)], fourier.phases(samples)
        q = ca.mtimes(fourier.synthesis(self.H, tau), self.coefficients).T
        v = self.omega * ca.mtimes(fourier.synthesis(self.H, tau, 1), self.coefficients).T
        if self._advance:
            v += self.omega * ca.DM(self._advance) / (2 * ca.pi)
        u = law.argument.map(samples)(q, v, ca.repmat(self._p, 1, samples))
        return law.force.map(samples)(u, ca.repmat(self._p, 1, samples)).T


CycleFunction = Callable[[Cycle], ca.MX]
CycleLimit = tuple[CycleFunction, float | None, float | None]
