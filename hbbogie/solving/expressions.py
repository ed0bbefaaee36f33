"""A cycle as expressions of the unknowns, for use in objectives and limits."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from hbbogie import fourier
from hbbogie.errors import ModelError, named, unknown_name
from hbbogie.methods.equations import Equations

SAMPLES = 64  # samples per period
FINE = 512  # of an output, whose mean square and harmonics are sums over samples


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

    def harmonic(self, name: str, h: int) -> ca.MX:
        """Return the amplitude of a harmonic, 1 to H, of a coordinate or output [its unit]."""
        if not 1 <= h <= self.H:
            raise ModelError(f"harmonic {h} of {name!r}: the equations keep harmonics up to {self.H}.")
        return ca.norm_2(self._coefficients(name)[2 * h - 1 : 2 * h + 1])

    def first_harmonic(self, name: str) -> ca.MX:
        """Return the amplitude of the first harmonic of a coordinate or output [its unit]."""
        return self.harmonic(name, 1)

    def mean(self, name: str) -> ca.MX:
        """Return the mean of a coordinate or output over the period [its unit]."""
        return self._coefficients(name)[0]

    def root_mean_square(self, name: str) -> ca.MX:
        """Return the root of the mean square of a coordinate or output over the period [its unit]."""
        if self._system.naming.is_output(name):
            return ca.sqrt(ca.sumsqr(self.values(name, FINE)) / FINE)
        c = self._coefficients(name)
        return ca.sqrt(c[0] ** 2 + 0.5 * ca.sumsqr(c[1:]))

    def values(self, name: str, samples: int = SAMPLES) -> ca.MX:
        """Return a coordinate, or its periodic part, or an output at equidistant times, shape (samples,) [its unit]."""
        system = self._system
        if not system.naming.is_output(name):
            E = fourier.synthesis(self.H, fourier.phases(samples))
            return ca.mtimes(E, self.coefficients[:, self._place(name)])
        q, v = self._motion(samples)
        measure = system.dynamics.measure_of(system.output_names.index(name))
        return measure.map(samples)(q, v, ca.repmat(self._p, 1, samples)).T

    def force(self, element: str, samples: int = SAMPLES) -> ca.MX:
        """Return the force of an element at equidistant times over the period, shape (samples,) [its unit]."""
        names = [e.name for e in self._system.elements]
        if element not in names:
            raise ModelError(f"system {self._system.name!r}: {unknown_name('element', element, names)}")
        law, (q, v) = self._system.elements[names.index(element)], self._motion(samples)
        u = law.argument.map(samples)(q, v, ca.repmat(self._p, 1, samples))
        return law.force.map(samples)(u, ca.repmat(self._p, 1, samples)).T

    def _motion(self, samples: int) -> tuple[ca.MX, ca.MX]:
        """Return coordinates and velocities at equidistant times, each of shape (n, samples)."""
        tau = fourier.phases(samples)
        q = ca.mtimes(fourier.synthesis(self.H, tau), self.coefficients).T
        v = self.omega * ca.mtimes(fourier.synthesis(self.H, tau, 1), self.coefficients).T
        if self._advance:
            speed = ca.DM(self._advance) / (2 * ca.pi)
            q, v = q + ca.mtimes(speed, ca.DM(tau).T), v + self.omega * speed
        return q, v

    def _coefficients(self, name: str) -> ca.MX:
        """Return the Fourier coefficients of a coordinate or output, shape (2 H + 1,)."""
        if self._system.naming.is_output(name):
            return ca.mtimes(fourier.analysis(self.H, FINE), self.values(name, FINE))
        return self.coefficients[:, self._place(name)]

    def _place(self, name: str) -> int:
        """Return the place of a coordinate; raise `ModelError` for a name that is neither one nor an output."""
        system = self._system
        known = (*system.coordinate_names, *system.output_names)
        return system.index(named(f"system {system.name!r}", "coordinate or output", name, known))


CycleFunction = Callable[[Cycle], ca.MX]
CycleLimit = tuple[CycleFunction, float | None, float | None]
