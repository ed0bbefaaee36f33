"""Numbers of a cycle, such as the rms of an output, with their exact derivatives in the unknowns and parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import named
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.expressions import Cycle

Array = NDArray[np.float64]
MEASURES = ("rms", "peak", "first harmonic")
SMOOTH = 1e-6  # slope at a peak, relative to the largest one over the period, beyond which the peak is at a kink


def measured(equations: Equations, quantity: str, of: str, cycle: Orbit, z: Array, p: Array) -> tuple[float, Array]:
    """Return a number of a cycle, and its derivatives in (z, p).

    Parameters
    ----------
    equations : Equations
    quantity : {"rms", "peak", "first harmonic"}
        Of outputs, rms and first harmonic are sums over 512 samples.
    of : str
        Name of a coordinate or output; for the peak also of an element.
    cycle : Orbit
        The cycle at (z, p).
    z, p : ndarray
        Unknowns and all parameters.

    Raises
    ------
    ConvergenceError
        Where the peak is at a kink.

    Notes
    -----
    At its maximum a signal does not vary with the phase, so the phase may be held fixed.
    """
    if quantity != "peak":
        value, d = equations.once((quantity, of), lambda: _of_cycle(equations, quantity, of))(z, p)
        return float(value), d.full().ravel()
    signal, slopes = equations.once(("peak", of), lambda: _signal(equations, of))
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
        raise ConvergenceError(f"the peak of {of} is at a kink, where it has no derivative; take its rms instead.")
    return sign * float(peak), sign * d.full().ravel()


def _of_cycle(equations: Equations, quantity: str, of: str) -> ca.Function:
    """Return (z, p) -> rms or first harmonic, gradient in (z, p)."""
    z, p = ca.MX.sym("z", equations.size), ca.MX.sym("p", len(equations.system.parameters))
    cycle = Cycle(equations, z, p)
    value = cycle.root_mean_square(of) if quantity == "rms" else cycle.first_harmonic(of)
    return ca.Function("measured", [z, p], [value, ca.densify(ca.gradient(value, ca.vertcat(z, p)))])


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
    named("peak", "coordinate, element or output", of, (*system.coordinate_names, *elements, *system.output_names))
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
