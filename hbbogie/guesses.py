"""First cycles without a guess: equilibria, Hopf points, and the small cycles that begin there."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar, root

from hbbogie.equations import Equations
from hbbogie.errors import ConvergenceError, ModelError
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.system import System

Array = NDArray[np.float64]
ELSEWHERE = (0.1, 1.0, 1.0, 10.0, 10.0)  # scatter of further starts in search of an equilibrium
SMALL = 1e-2  # amplitude of a first cycle of a smooth system, in units of the amplitude scale


class Linearisation:
    """Equilibrium and eigenvalues of a system over one parameter, all others at the system's values.

    Parameters
    ----------
    system : System
    parameter : str
        Name of the parameter.
    """

    def __init__(self, system: System, parameter: str):
        system.parameter(parameter)
        self.system, self.place = system, system.parameter_names.index(parameter)
        self.p = system.vector()
        self._guess = np.zeros(system.n)

    def parameters(self, value: float) -> Array:
        """Return the parameter vector at a value of the parameter."""
        p = self.p.copy()
        p[self.place] = value
        return p

    def equilibrium(self, value: float) -> Array:
        """Return the equilibrium followed from rest, shape (n,)."""
        p = self.parameters(value)
        zero = np.zeros(self.system.n)
        if not np.any(self.system.residual(zero, zero, zero, p).full()):
            return zero
        residual = self.system.once("equilibrium", lambda: _at_rest(self.system))
        rng = np.random.default_rng(0)
        for size in (0.0, *ELSEWHERE):
            start = self._guess + size * rng.standard_normal(self.system.n)
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                found = root(
                    lambda q: residual(q, p)[0].full().ravel(),
                    start,
                    jac=lambda q: residual(q, p)[1].full(),
                    tol=1e-13,
                )
            r, K = (m.full() for m in residual(found.x, p))
            if np.isfinite(r).all() and np.abs(r).max() <= 1e-9 * max(1.0, float(np.abs(K * found.x).max())):
                self._guess = np.asarray(found.x)
                return self._guess
        raise ConvergenceError(
            f"system {self.system.name!r}: no equilibrium found near {self._guess} at "
            f"{self.system.parameter_names[self.place]} = {value:g}; narrow the range of the parameter."
        )

    def _equilibrium_or_nan(self, value: float) -> Array:
        """Return the equilibrium, NaN where there is none: one value must not end the search over all."""
        try:
            return self.equilibrium(value)
        except ConvergenceError:
            return np.full(self.system.n, np.nan)

    def growth(self, values: Sequence[float] | Array) -> list[Array]:
        """Return the real parts of the oscillating modes [1/s], largest first, at each value of the parameter."""
        system, N = self.system, len(values)
        x, p = np.zeros((system.n_states, N)), np.repeat(self.p[:, None], N, axis=1)
        p[self.place] = values
        residual, jacobian = system.once(
            ("along", N), lambda: (system.residual.map(N), system.ode_jacobian.map(N))
        )  # one call for all values
        rest = np.zeros((system.n, N))
        if np.any(residual(rest, rest, rest, p).full()):
            x[: system.n] = np.transpose([self._equilibrium_or_nan(v) for v in values])
        A = jacobian(x, p).full().reshape(len(x), N, len(x)).swapaxes(0, 1)
        good, found = np.isfinite(A).all(axis=(1, 2)), []
        for k, eigenvalues in enumerate(np.linalg.eigvals(np.where(good[:, None, None], A, 0.0))):
            if not good[k]:
                found.append(np.empty(0))
                continue
            oscillating = eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max(initial=1e-300)
            found.append(-np.sort(-eigenvalues[oscillating].real))
        return found

    def eigen(self, value: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return eigenvalues [1/s], largest real part first, and eigenvectors (columns)."""
        x = np.concatenate([self.equilibrium(value), np.zeros(self.system.n_states - self.system.n)])
        eigenvalues, vectors = np.linalg.eig(self.system.ode_jacobian(x, self.parameters(value)).full())
        order = np.argsort(-eigenvalues.real, kind="stable")
        return eigenvalues[order].astype(complex), vectors[:, order].astype(complex)

    def pairs(self, value: float) -> tuple[Array, NDArray[np.complex128], NDArray[np.complex128]]:
        """Return real parts (largest first), eigenvalues and vectors of the oscillating modes."""
        eigenvalues, vectors = self.eigen(value)
        oscillating = eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max(initial=1e-300)
        return eigenvalues[oscillating].real, eigenvalues[oscillating], vectors[:, oscillating]


def _at_rest(system: System) -> ca.Function:
    """Return (q, p) -> the residual at rest and its derivative in q."""
    q, p = ca.SX.sym("q", system.n), ca.SX.sym("p", len(system.parameters))
    r = system.residual(q, 0, 0, p)
    return ca.Function("at_rest", [q, p], [ca.densify(r), ca.densify(ca.jacobian(r, q))])


def hopf_points(
    system: System, parameter: str, interval: tuple[float, float], *, points: int = 201
) -> list[SpecialPoint]:
    """Find all Hopf points of the equilibrium over an interval of a parameter.

    The k-th largest real part among the oscillating modes is a continuous function of the parameter;
    its changes of sign are refined by bracketing, and its local extrema close to zero are looked into
    as well, so that a pair that crosses and comes back between two samples is not lost.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), unit of the parameter
    points : int
        Samples over the interval.

    Returns
    -------
    list of SpecialPoint, kind "hopf", in increasing order of the parameter
        Each orbit is the linear cycle along the critical mode whose largest coordinate is 1 in its unit.

    Raises
    ------
    ModelError
        For an unknown parameter or an empty interval.
    """
    lo, hi = check_interval(system, parameter, interval)
    line = Linearisation(system, parameter)
    grid = np.linspace(lo, hi, points)
    growth = line.growth(grid)
    found: list[SpecialPoint] = []
    for k in range(max((len(g) for g in growth), default=0)):

        def alpha(value: float, k: int = k) -> float:
            (real,) = line.growth([value])
            return float(real[k]) if k < len(real) else float("nan")

        samples = np.array([g[k] if k < len(g) else np.nan for g in growth])
        for a, b in _brackets(grid, samples, alpha):
            found.append(_hopf(line, parameter, alpha, a, b, k))
    found.sort(key=lambda s: s.value)
    return [s for i, s in enumerate(found) if i == 0 or not _same(s, found[i - 1])]


def check_interval(system: System, parameter: str, interval: tuple[float, float]) -> tuple[float, float]:
    """Return the interval cut to the parameter's bounds; raise `ModelError` when nothing is left of it."""
    low, high = system.parameter(parameter).bounds
    try:
        first, last = map(float, interval)
    except (TypeError, ValueError):
        raise ModelError(f"interval of {parameter!r}: got {interval!r}; give two numbers (low, high).") from None
    lo, hi = max(first, low), min(last, high)
    if not (np.isfinite(lo) and np.isfinite(hi) and lo < hi):
        raise ModelError(
            f"interval of {parameter!r}: got ({first:g}, {last:g}); give (low, high) with low < high, "
            f"within the parameter's bounds ({low:g}, {high:g})."
        )
    return lo, hi


def _brackets(grid: Array, samples: Array, alpha: Callable[[float], float]) -> list[tuple[float, float]]:
    """Return intervals over which the function changes sign; extrema close to zero are refined first."""
    brackets: list[tuple[float, float]] = []
    spread = np.nanmax(np.abs(np.diff(samples)), initial=0.0)
    for i in range(len(grid) - 1):
        a, b = samples[i], samples[i + 1]
        if a * b < 0 or (a == 0 and i == 0) or b == 0:
            brackets.append((float(grid[i]), float(grid[i + 1])))
            continue
        if not (0 < i < len(grid) - 2) or min(abs(a), abs(b)) > 2 * spread:
            continue
        turning = (samples[i - 1] - a) * a > 0 and (samples[i + 2] - b) * b > 0
        if turning:  # both neighbours lie farther from zero: there may be a dip through zero inside
            sign = np.sign(a)
            dip = minimize_scalar(lambda v, s=sign: s * alpha(v), bounds=(grid[i], grid[i + 1]), method="bounded")
            if dip.fun < 0:
                brackets += [(float(grid[i]), float(dip.x)), (float(dip.x), float(grid[i + 1]))]
    return brackets


def _hopf(
    line: Linearisation, parameter: str, alpha: Callable[[float], float], a: float, b: float, k: int
) -> SpecialPoint:
    ends = alpha(a), alpha(b)
    value = (
        a
        if ends[0] == 0
        else b
        if ends[1] == 0
        else float(brentq(alpha, a, b, xtol=1e-13 * max(abs(a), abs(b)), rtol=1e-14))
    )
    if abs(value) < 1e-12 * (b - a):
        value = 0.0
    real, eigenvalues, vectors = line.pairs(value)
    omega, mode = float(eigenvalues[k].imag), vectors[: line.system.n, k]
    mode = mode / mode[np.argmax(np.abs(mode))]
    coefficients = np.array([line.equilibrium(value), mode.real, -mode.imag])
    system = line.system
    orbit = Orbit(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        coefficients,
        omega,
        dict(zip(system.parameter_names, map(float, line.parameters(value)), strict=True)),
        "linearisation",
        0.0,
        "the linear cycle along the critical mode",
    )
    direction = "gains" if ends[1] > ends[0] else "loses"
    status = f"a pair of eigenvalues {direction} a positive real part; real part {real[k]:.1e} 1/s where located"
    width = 1e-13 * max(abs(value), abs(b - a))
    return SpecialPoint("hopf", parameter, value, (value - width, value + width), orbit, status)


def _same(a: SpecialPoint, b: SpecialPoint) -> bool:
    close = abs(a.value - b.value) <= 1e-9 * max(abs(a.value), abs(b.value), 1e-9)
    return close and abs(a.omega - b.omega) <= 1e-6 * a.omega


def first_cycle(equations: Equations, hopf: SpecialPoint) -> Orbit:
    """Return the small linear cycle of a Hopf point in the size where a branch may begin.

    Where the system is linear until a gap closes, that is the cycle whose first contact just touches
    (the branch of cycles begins there); otherwise a cycle of a hundredth of the amplitude scale.
    """
    orbit, system = hopf.orbit, equations.system
    wave = np.zeros_like(orbit.coefficients)
    wave[1:] = orbit.coefficients[1:]
    parts = system.parts(contact=True)
    size = SMALL * float(equations.scale[0])
    if parts.contacts and not parts.remainder_rows:
        size = _touching(system, orbit, wave)
    coefficients = size * wave
    coefficients[0] = orbit.coefficients[0]
    return orbit.replace(coefficients=coefficients)


def _touching(system: System, orbit: Orbit, wave: Array) -> float:
    """Return the factor at which the wave, added to the equilibrium, first touches a contact."""
    p, rest, omega = system.vector(**orbit.parameters), orbit.coefficients[0], orbit.omega
    cosine, sine = wave[1], wave[2]
    factors = [np.inf]
    for element in system.elements:
        if element.ramps is None:
            continue
        # the argument is affine, and so harmonic: its values at t = 0 and a quarter period later give its amplitude
        u0 = float(element.argument(rest, 0, p))
        parts = (rest + cosine, omega * sine), (rest + sine, -omega * cosine)
        u = [float(element.argument(q, v, p)) - u0 for q, v in parts]
        reach = float(np.hypot(u[0], u[1]))
        for direction, g in zip(element.directions, element.ramps(p)[3].full().ravel(), strict=True):
            room = float(g) - direction * u0
            if reach > 0 and room > 0:
                factors.append(room / reach)
    return min(factors)
