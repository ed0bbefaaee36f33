"""Curves of Hopf points over two parameters, with the direction in which cycles begin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.normal_form import lyapunov_at
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint
from hbbogie.results.ending import Ending
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.arclength import correct
from hbbogie.solving.curve import Dense, Point

Array = NDArray[np.float64]
SLOWEST = 1e-3  # share of the first frequency at which a curve ends
NEUTRAL = 1e-7  # real part, in units of omega, up to which an eigenvalue is none of an unstable equilibrium


class HopfCurve:
    """The Hopf points of the equilibrium over two parameters, as a curve (eq-hopf-curve).

    The unknowns are equilibrium, real and imaginary part of the critical mode, omega and both parameters.

    Parameters
    ----------
    system : System
    names : (str, str)
        The two parameters.
    span, interval : (float, float), units of the parameters
        Where the curve ends.
    hopf : SpecialPoint
        Where the curve begins.
    tolerance : float
        Largest scaled residual.
    """

    def __init__(
        self,
        system: System,
        names: tuple[str, str],
        span: tuple[float, float],
        interval: tuple[float, float],
        hopf: SpecialPoint,
        tolerance: float = 1e-10,
    ):
        self.system, self.names, self.tolerance, self.n = system, names, tolerance, system.n
        self.p = system.vector(**hopf.orbit.parameters)
        self.places = [system.parameter_names.index(name) for name in names]
        n, rest, wave = system.n, hopf.orbit.coefficients[0], hopf.orbit.coefficients[1:]
        mode = wave / np.linalg.norm(wave)
        self.start = np.concatenate([rest, mode[0], -mode[1], [hopf.omega], self.p[self.places]])
        size = np.maximum(np.abs(rest), 1.0)
        widths = [(high - low) / 4 for low, high in (span, interval)]
        self.scale = np.concatenate([size, np.ones(2 * n), [hopf.omega], widths])
        self.weights = np.concatenate([np.ones(n), np.zeros(2 * n), np.ones(3)])
        self.window = {3 * n + 1: span, 3 * n + 2: interval}
        self._functions = system.once(("hopf curve", tuple(self.places)), lambda: _functions(system, self.places))
        M, D, K = (np.abs(f(self.p).full()) for f in system.linear)
        rows = (M * hopf.omega**2 + D * hopf.omega + K).sum(axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        self.rows = np.concatenate([rows, rows, rows, [1.0, 1.0]])
        self.settle(self.start)

    def settle(self, u: Array) -> None:
        """Normalise the mode by its value here."""
        mode = u[self.n : 3 * self.n]
        self.normal = mode / (mode @ mode)

    def parameters(self, u: Array) -> Array:
        """Return the parameter vector."""
        p = self.p.copy()
        p[self.places] = u[-2:]
        return p

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the scaled residual and its derivative in the scaled unknowns."""
        G, J = (m.full() for m in self._functions[0](u, self.p, self.normal))
        return G.ravel() / self.rows, J / self.rows[:, None] * self.scale

    def linearise(self, u: Array) -> Dense:
        """Return the equations and their derivative."""
        return Dense(*self.evaluate(u))

    def first(self) -> Point:
        """Return the Hopf point where the curve begins, with its tangent; raise `ConvergenceError` where lost."""
        for index in (-1, -2):  # at the given second parameter; where the curve turns back in it, at the first
            across = np.zeros(len(self.start))
            across[index] = 1.0
            if (found := correct(self, self.start, across)[0]) is not None:
                return found
        raise ConvergenceError("no Hopf point was found from this start; two modes may be critical at once.")

    def leaves(self, points: Sequence[Point], there: Point) -> Ending | None:
        """Return why the curve ends before a point, if the frequency goes to zero."""
        if there.u[3 * self.n] > SLOWEST * self.scale[3 * self.n]:
            return None
        return Ending("vanishes", f"the frequency goes to zero at {self.where(there.u)}")

    def at(self, index: int, value: float) -> Ending:
        """Return the ending at a limit of a parameter."""
        name = self.names[index - 3 * self.n - 1]
        return Ending("interval", f"the end of the chart was reached, {name} = {value:g}")

    def where(self, u: Array) -> str:
        """Return the second parameter's value, for people."""
        return f"{self.names[1]} = {u[-1]:.6g}"

    def state(self, point: Point) -> HopfState:
        """Return what is to be known about a point of the curve."""
        return _state(self, point, self._functions[1])


@dataclass(frozen=True)
class HopfState:
    """What is to be known about a Hopf point.

    Attributes
    ----------
    onset : float
        Positive where cycles begin subcritically, negative where supercritically, 0 or NaN where undecided: the first
        Lyapunov coefficient, or where a gap closes first the growth of the disturbance with contact (eq-grazing-onset).
    grazing : bool
        Which of the two it is.
    slope : float, unit of the first per unit of the second parameter
        Derivative along the curve.
    side : int
        1 where the equilibrium is stable at larger values of the first parameter, -1 at smaller ones, else 0.
    """

    onset: float
    grazing: bool
    slope: float
    side: int


def _functions(system: System, places: list[int]) -> tuple[ca.Function, ca.Function]:
    """Return the equations of the curve, and the slopes in growth rate and contact stiffness."""
    n, n_e, n_p = system.n, len(system.elements), len(system.parameters)
    u, p, normal = ca.SX.sym("u", 3 * n + 3), ca.SX.sym("p", n_p), ca.SX.sym("normal", 2 * n)
    sigma, kappa = ca.SX.sym("sigma"), ca.SX.sym("kappa", n_e)
    shifted = ca.SX(p)
    for k, i in enumerate(places):
        shifted[i] = u[3 * n + 1 + k]
    q0, re, im, omega = u[:n], u[n : 2 * n], u[2 * n : 3 * n], u[3 * n]
    q, v, a = (ca.SX.sym(s, n) for s in "qva")
    arguments = [e.argument(q, v, shifted) for e in system.elements]
    at_rest = [e.argument(q0, 0, shifted) for e in system.elements]
    forces = [
        e.force(w, shifted) + kappa[k] * (w - w0)
        for k, (e, w, w0) in enumerate(zip(system.elements, arguments, at_rest, strict=True))
    ]
    r = system.residual_with_forces(q, v, a, ca.vertcat(*forces), shifted)
    qva, rest = ca.vertcat(q, v, a), ca.vertcat(q0, ca.SX.zeros(2 * n))

    def linear(expression: ca.SX, real: ca.SX, imag: ca.SX) -> ca.SX:
        """Return the real part of the derivative along (real + i imag) exp((sigma + i omega) t)."""
        speed, turn = sigma * real - omega * imag, sigma * imag + omega * real
        direction = ca.vertcat(real, speed, sigma * speed - omega * turn)
        return ca.substitute(ca.jtimes(expression, qva, direction), qva, rest)

    unit = ca.vertcat(ca.dot(normal, u[n : 3 * n]) - 1, ca.dot(normal[:n], im) - ca.dot(normal[n:], re))
    G = ca.vertcat(ca.substitute(r, qva, rest), linear(r, re, im), linear(r, im, -re), unit)
    J = ca.jacobian(G, u)
    extra = ca.vertcat(sigma, kappa)
    slopes = ca.jacobian(G, extra)
    G, J, slopes = ca.substitute([G, J, slopes], [extra], [ca.SX.zeros(1 + n_e)])
    w = ca.vertcat(*arguments)
    amplitude = [ca.substitute(linear(w, x, y), sigma, 0) for x, y in ((re, im), (im, -re))]
    states = [ca.vertcat(*at_rest), ca.sqrt(amplitude[0] ** 2 + amplitude[1] ** 2)]
    dense = [ca.densify(m) for m in (G, J)], [ca.densify(m) for m in (slopes, *states)]
    return (
        ca.Function("hopf_curve", [u, p, normal], dense[0]),
        ca.Function("hopf_slopes", [u, p, normal], dense[1]),
    )


def _state(curve: HopfCurve, point: Point, function: ca.Function) -> HopfState:
    system, n, u = curve.system, curve.n, point.u
    p, omega = curve.parameters(u), float(u[3 * n])
    slopes, rest, amplitude = (m.full() for m in function(u, curve.p, curve.normal))
    J = curve.evaluate(u)[1]
    slopes = slopes / curve.rows[:, None]
    bordered = np.column_stack([J[:, : 3 * n + 1], slopes[:, 0]])
    try:
        growth = np.linalg.solve(bordered, -np.column_stack([J[:, 3 * n + 1], slopes[:, 1:]]))[-1]
    except np.linalg.LinAlgError:  # a double eigenvalue: it has no derivative
        growth = np.full(slopes.shape[1], np.nan)
    x = np.concatenate([u[:n], np.zeros(system.n_states - n)])
    others = np.linalg.eigvals(system.state_matrix(x, p))
    others = np.delete(others, [int(np.argmin(np.abs(others - w))) for w in (1j * omega, -1j * omega)])
    side = 0 if others.real.max(initial=-np.inf) > NEUTRAL * omega else (-1 if growth[0] > 0 else 1)
    if np.isnan(growth[0]):
        side = 0
    along = (curve.scale * point.tangent)[-2:]
    with np.errstate(divide="ignore"):
        slope = float(along[0] / along[1])
    parts = system.parts(contact=True)
    if parts.contacts and not parts.remainder_rows:
        return HopfState(_grazing(system, p, rest.ravel(), amplitude.ravel(), growth[1:]), True, slope, side)
    return HopfState(lyapunov_at(system, x, p, omega), False, slope, side)


def _grazing(system: System, p: Array, rest: Array, amplitude: Array, growth: Array) -> float:
    """Return how the growth rate changes where the growing linear cycle first meets a contact (eq-grazing-onset).

    A short contact acts on the linear cycle like a small stiffness of its own sign at its place.
    """
    nearest, change = np.inf, 0.0
    for i, element in enumerate(system.elements):
        if element.ramps is None or amplitude[i] == 0:
            continue
        _, _, stiffness, threshold = (m.full().ravel() for m in element.ramps(p))
        for direction, k, g in zip(element.directions, stiffness, threshold, strict=True):
            room = float(g) - direction * rest[i]
            if abs(room) / amplitude[i] < nearest:  # beyond the threshold at rest, the contact opens instead
                nearest, change = abs(room) / amplitude[i], float(np.sign(room) * k * growth[i])
    return change
