"""Criteria on the hunting cycle: peak and root mean square of what moves in it, with exact gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.design.criteria import check_within
from hbbogie.design.point import DesignPoint, Row, critical_rows, stable_cycle
from hbbogie.errors import ModelError, named
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.expressions import Cycle

Array = NDArray[np.float64]
SMOOTH = 1e-6  # slope at a peak, relative to the largest one over the period, beyond which the peak is at a kink


@dataclass(frozen=True, eq=False)
class OnCycle:
    """What the criteria on the hunting cycle share: where the cycle is taken, and the total derivative.

    Attributes
    ----------
    of : str
        Name of what moves.
    at : float, unit of the parameter whose critical value is raised
        The value at which the cycle is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str
    """

    of: str
    at: float | None = None
    overspeed: float | None = None
    unit: str = ""

    what: ClassVar[str] = ""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        if (self.at is None) == (self.overspeed is None):
            raise ModelError(f"{kind} of {self.of!r}: give either at= (a value) or overspeed= (a share), not both.")
        if self.overspeed is not None and not self.overspeed > 0:
            raise ModelError(
                f"{kind} of {self.of!r}: overspeed={self.overspeed:g}; give a positive share, such as 0.1."
            )

    @property
    def name(self) -> str:
        """Its name, with the value at which it is taken."""
        where = f"at {self.at:g}" if self.at is not None else f"at {100 * (self.overspeed or 0):g} % overspeed"
        return f"{self.what} of {self.of} {where}"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        raise NotImplementedError

    def rows(self, point: DesignPoint) -> list[Row]:
        """Return the one row, or none if there is no cycle."""
        share = self.overspeed or 0.0
        value = self.at if self.at is not None else point.beyond(share)
        check_within(point, self.name, value)
        cycle = stable_cycle(point, self, value) if value >= point.value else None
        if cycle is None:
            return []
        equations = point.equations.phased(cycle)
        z, p = equations.encode(cycle), point.system.vector(**{point.parameter: value})
        measured, d = self.measured(equations, cycle, z, p)
        J = equations.derivatives(tuple(range(len(p))))(z, p)[1].full()
        m = equations.size
        gradient = d[m:] - J[:, m:].T @ np.linalg.solve(J[:, :m].T, d[:m])
        place = point.system.parameter_names.index(point.parameter)
        along, gradient[place] = gradient[place], 0.0
        if self.overspeed is not None:
            smallest = min((row for row, _ in critical_rows(point)), key=lambda row: row.value)
            gradient = gradient + along * (1 + share * np.sign(point.value)) * smallest.gradient
        return [Row(self.name, measured, gradient)]


@dataclass(frozen=True, eq=False)
class RootMeanSquare(OnCycle):
    """The root of the mean square, over the period of the hunting cycle, of a coordinate or of an output.

    Attributes
    ----------
    of : str
        Name of a coordinate or of an output, such as "frame lateral acceleration".
    at : float, unit of the parameter whose critical value is raised
        The value at which it is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str

    Notes
    -----
    The mean over 512 samples is taken for outputs. Cycle and total derivative are those of `Peak`.
    """

    what: ClassVar[str] = "rms"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        value, d = equations.once(("rms", self.of), lambda: _mean_square(equations, self.of))(z, p)
        return float(value), d.full().ravel()


@dataclass(frozen=True, eq=False)
class Peak(OnCycle):
    """The largest absolute value of a coordinate, element or output over the period of the hunting cycle.

    Attributes
    ----------
    of : str
        Name of a coordinate, of an element or of an output, such as "q1" or "front flange".
    at : float, unit of the parameter whose critical value is raised
        The value at which the peak is taken. Give either this or
    overspeed : float
        the fraction by which this value exceeds the smallest critical value. The derivative follows that value.
    unit : str

    Notes
    -----
    The cycle solves F(z, p) = 0, so dz/dp = -F_z^-1 F_p. At its maximum the signal does not vary with the phase, so the
    phase may be held fixed. If there are several cycles, the stable one is taken, and if there are several stable ones,
    the largest. If there is no cycle there is no row, and a limit counts as satisfied. Where the peak is at a kink of
    an output, the phase may not be held fixed, and a `ConvergenceError` says so.
    """

    what: ClassVar[str] = "peak"

    def measured(self, equations: Equations, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
        """Return the value for a cycle, and its derivatives in (z, p)."""
        signal, slopes = equations.once(("peak", self.of), lambda: _signal(equations, self.of))
        tau = fourier.phases(32 * (cycle.H + 1))
        q, v = (cycle.omega**d * cycle.at(tau, d) for d in (0, 1))
        s = signal.map(len(tau))(q.T, v.T, p).full().ravel()
        best, sign = float(tau[np.argmax(np.abs(s))]), float(np.sign(s[np.argmax(np.abs(s))]))
        for _ in range(4):
            _, d1, d2, _ = slopes(best, z, p)
            best -= float(np.clip(float(d1) / float(d2), -tau[1], tau[1])) if float(d2) else 0.0
        peak, slope, _, d = slopes(best, z, p)
        steepest = np.abs(np.diff(s, append=s[0])).max() / tau[1]
        if abs(float(slope)) > SMOOTH * steepest or sign * float(peak) < np.abs(s).max() * (1 - SMOOTH):
            raise ConvergenceError(
                f"the {self.name} is at a kink, where it has no derivative: limit RootMeanSquare({self.of!r}, ...) "
                "instead."
            )
        return sign * float(peak), sign * d.full().ravel()


def _mean_square(equations: Equations, of: str) -> ca.Function:
    """Return (z, p) -> root mean square, gradient in (z, p)."""
    z, p = ca.MX.sym("z", equations.size), ca.MX.sym("p", len(equations.system.parameters))
    rms = Cycle(equations, z, p).root_mean_square(of)
    return ca.Function("rms", [z, p], [rms, ca.densify(ca.gradient(rms, ca.vertcat(z, p)))])


def _signal(equations: Equations, of: str) -> tuple[ca.Function, ca.Function]:
    """Return (q, v, p) -> signal, and (phase, z, p) -> signal, two derivatives in the phase, gradient in (z, p)."""
    system = equations.system
    H = (equations.coefficients.size1_out(0) - 1) // 2
    tau, z, p = ca.MX.sym("tau"), ca.MX.sym("z", equations.size), ca.MX.sym("p", len(system.parameters))
    h = ca.DM(np.arange(1, H + 1))
    both = ca.vec(ca.horzcat(ca.cos(h * tau), ca.sin(h * tau)).T)
    turned = ca.vec(ca.horzcat(-h * ca.sin(h * tau), h * ca.cos(h * tau)).T)
    elements = {e.name: e for e in system.elements}
    q, v = ca.MX.sym("q", system.n), ca.MX.sym("v", system.n)
    named("Peak", "coordinate, element or output", of, (*system.coordinate_names, *elements, *system.output_names))
    if of in elements:
        value = elements[of].force(elements[of].argument(q, v, p), p)
    elif of in system.output_names:
        value = system.dynamics.measure(q, v, p)[system.output_names.index(of)]
    else:
        value = q[system.index(of)]
    signal = ca.Function("signal", [q, v, p], [value])
    c = equations.coefficients(z, p)
    advance = ca.DM(equations.advance or np.zeros(system.n)).T / (2 * np.pi)
    place = c[0, :] + both.T @ c[1:, :] + tau * advance
    s = signal(place.T, (equations.frequency(z) * (turned.T @ c[1:, :] + advance)).T, p)
    d1 = ca.gradient(s, tau)
    slopes = ca.Function("slopes", [tau, z, p], [s, d1, ca.gradient(d1, tau), ca.gradient(s, ca.vertcat(z, p))])
    return signal, slopes
