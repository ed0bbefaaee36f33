"""The equivalent linear system: a spring in place of each element, and its critical parameter values.

Each element is replaced by a spring whose stiffness is its describing function at an amplitude. At the critical value
of a parameter, a pair of eigenvalues of that linear system is purely imaginary. The eigenvector gives the amplitudes of
the elements' arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.describing_functions import first_order
from hbbogie.model.symbols import Parameter
from hbbogie.model.system import System
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
GRID = 81  # values of the parameter in the search for a critical one


@dataclass(frozen=True, eq=False)
class NeutralMode:
    """A purely imaginary pair of eigenvalues of the equivalent linear system.

    Attributes
    ----------
    value : float
        Critical value of the parameter.
    omega : float, rad/s
    mode : ndarray of complex, shape (n,), unit of the coordinate
        Its phase and size are arbitrary.
    outputs : ndarray of complex, shape (m,), unit of the argument
        The elements' arguments of the mode.
    slope : ndarray, shape (m,)
        Derivative of the value with respect to each equivalent stiffness.
    rise : float, 1/s per unit of the parameter
        Derivative of the real part with respect to the parameter.
    """

    value: float
    omega: float
    mode: Complex
    outputs: Complex
    slope: Array
    rise: float

    __repr__ = brief


class EquivalentSystem:
    """A system whose elements are replaced by springs, and its eigenvalues over a parameter.

    Parameters
    ----------
    system : System
        An odd system that is linear except for its elements.
    parameter : str
        Name of the parameter whose critical value is to be found.

    Raises
    ------
    ModelError
        When the system has no elements or another nonlinearity, is not odd, or the parameter belongs to an element.
    """

    def __init__(self, system: System, parameter: str):
        self.place = system.parameter_names.index(system.parameter(parameter).name)
        self.system, self.parameter, self.p = system, parameter, system.vector()
        self.names = tuple(e.name for e in system.elements)
        self.linear = system.once("equivalent linear system", lambda: _linear(system))
        m = len(system.elements)
        self.matrices: ca.Function = system.once(
            ("equivalent linear system", parameter), lambda: _functions(self.linear, self.place, m)
        )
        self.springs, self.arguments = system.once("equivalent springs", lambda: _springs(system))
        if any(self.place in f.jac_sparsity(0, i).get_col() for f, i in ((self.springs, 1), (self.arguments, 0))):
            raise ModelError(
                f"parameter {parameter!r} belongs to an element; ask for the critical value of a parameter of the "
                "linear part."
            )
        self.du_dq, self.du_dv = (m.full() for m in self.arguments(self.p))

    def stiffness(self, amplitudes: Array) -> Array:
        """Return the equivalent stiffness of each element at its amplitude, shape (m,)."""
        return np.asarray(self.springs(amplitudes, self.p)[0].full().ravel())

    def stiffening(self, amplitudes: Array) -> Array:
        """Return the derivative of each equivalent stiffness with respect to its amplitude, shape (m,)."""
        return np.asarray(self.springs(amplitudes, self.p)[1].full().ravel())

    def at_rest(self) -> Array:
        """Return the slope of each law at rest, shape (m,)."""
        return np.asarray(self.springs(np.ones(len(self.names)), self.p)[2].full().ravel())

    def first(self, amplitude: Mapping[str, float]) -> tuple[int, float]:
        """Return place and amplitude of the element whose amplitude is held."""
        if len(amplitude) != 1:
            raise ModelError(f"amplitude={dict(amplitude)!r}; give one element, such as {{{self.names[0]!r}: 0.01}}.")
        name, value = next(iter(amplitude.items()))
        if name not in self.names:
            raise ModelError(f"system {self.system.name!r}: {unknown_name('element', name, self.names)}")
        if not np.isfinite(value) or value <= 0:
            raise ModelError(f"amplitude of {name!r} is {value!r}; give a positive number.")
        return self.names.index(name), float(value)

    def critical(self, stiffness: Array, value: float, omega: float) -> NeutralMode:
        """Return the critical value near a given one, by Newton's method with the exact derivative of the eigenvalue.

        Raises
        ------
        ConvergenceError
            When there is none nearby.
        """
        p, n, size = np.append(self.p, stiffness), self.system.n, self.linear.n_states
        near, scale = 1j * omega, abs(value)
        for _ in range(30):
            p[self.place] = value
            A, dA = (m.full() for m in self.matrices(p))
            eigenvalues, left, right = eig(A, left=True, right=True)
            i = int(np.argmin(np.abs(eigenvalues - near)))
            w, x = left[:, i].conj(), right[:, i]
            rates = (w @ dA).reshape(-1, size) @ x / (w @ x)  # derivatives in the parameter and the stiffnesses
            step = -eigenvalues[i].real / rates[0].real if rates[0].real else np.inf
            if abs(step) <= 1e-12 * max(abs(value), scale) and eigenvalues[i].imag > 0:
                mode, frequency = x[:n], float(eigenvalues[i].imag)
                outputs = (self.du_dq + 1j * frequency * self.du_dv) @ mode
                slope = -rates[1:].real / rates[0].real
                return NeutralMode(float(value), frequency, mode, outputs, slope, float(rates[0].real))
            if not abs(step) <= max(abs(value), scale):
                break
            value, near = value + step, eigenvalues[i] + rates[0] * step
        raise ConvergenceError(
            f"no value of {self.parameter} near {value:g} at which a pair of eigenvalues near {omega:g} rad/s is "
            "purely imaginary; start from another amplitude, or look where the equilibrium loses stability."
        )

    def locate(self, stiffness: Array, interval: tuple[float, float]) -> NeutralMode:
        """Return the change of stability of the equilibrium nearest to the system's own parameter value.

        Raises
        ------
        ConvergenceError
            When stability does not change over the interval.
        """
        p, grid = np.append(self.p, stiffness), np.linspace(*interval, GRID)
        largest = []
        for value in grid:
            p[self.place] = value
            eigenvalues = np.linalg.eigvals(self.matrices(p)[0].full())
            pairs = eigenvalues[eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max(initial=0.0)]
            largest.append(pairs[np.argmax(pairs.real)] if len(pairs) else complex("nan"))
        x, own = np.array(largest), self.p[self.place]
        for i in sorted(np.flatnonzero(x.real[:-1] * x.real[1:] <= 0), key=lambda i: abs(grid[i] - own)):
            share = x[i].real / (x[i].real - x[i + 1].real) if x[i].real != x[i + 1].real else 0.0
            try:
                return self.critical(
                    stiffness,
                    float(grid[i] + share * (grid[i + 1] - grid[i])),
                    float(x[i].imag + share * (x[i + 1].imag - x[i].imag)),
                )
            except ConvergenceError:
                continue
        raise ConvergenceError(
            f"system {self.system.name!r}: with the equivalent stiffnesses {stiffness} the equilibrium keeps its "
            f"stability for {self.parameter} from {interval[0]:g} to {interval[1]:g}; widen the interval, or "
            "give another amplitude."
        )

    def follow(self, known: NeutralMode, before: Array, after: Array) -> NeutralMode:
        """Return the critical value at other stiffnesses, in steps from a known one along the same mode.

        Raises
        ------
        ConvergenceError
            When the mode is lost on the way.
        """
        share, step = 0.0, 1.0
        while share < 1:
            new = min(1.0, share + step)
            change = (new - share) * (after - before)
            reach = float(known.slope @ change)
            try:
                if abs(reach) > 0.1 * max(abs(known.value), abs(known.value + reach)):
                    raise ConvergenceError("too far for one step")
                known = self.critical(before + new * (after - before), known.value + reach, known.omega)
                share, step = new, 2 * step
            except ConvergenceError:
                step /= 2
                if step < 1e-3:
                    raise
        return known


def _linear(system: System) -> System:
    """Return the system with a spring, its stiffness a further parameter, in place of each element."""
    if not system.elements:
        raise ModelError(f"system {system.name!r} has no elements; write its nonlinear forces as elements.")
    q, v, a = (ca.vertcat(*(getattr(c, s) if s else c for c in system.coordinates)) for s in ("", "dot", "ddot"))
    p = ca.vertcat(*system.parameters) if system.parameters else ca.SX(0, 1)
    springs = [Parameter(f"equivalent_stiffness_{i + 1}", 0.0) for i in range(len(system.elements))]
    forces = [k * e.argument(q, v, p) for k, e in zip(springs, system.elements, strict=True)]
    equations = ca.vertsplit(system.residual_with_forces(q, v, a, ca.vertcat(*forces), p))
    linear = System(system.name, system.coordinates, (*system.parameters, *springs), equations)
    rows = linear.parts(contact=True).remainder_rows
    if rows:
        where = ", ".join(system.coordinate_names[i] for i in rows)
        raise ModelError(
            f"system {system.name!r}: the equation of {where} is nonlinear, or has a constant term, besides the "
            "elements; write such a force as an element of odd law, or use HarmonicBalance."
        )
    if not system.odd:
        raise ModelError(f"system {system.name!r} is not odd: its cycles have a mean; use HarmonicBalance.")
    return linear


def _functions(linear: System, place: int, m: int) -> ca.Function:
    """Return p -> (A, [dA/d parameter, dA/d stiffness 1, ...]), side by side; the m stiffnesses stand last in p."""
    n_p, size = len(linear.parameters), linear.n_states
    p = ca.SX.sym("p", n_p)
    A = ca.densify(linear.ode_jacobian(ca.SX.zeros(size), p))
    derivatives = [ca.reshape(ca.jacobian(A, p[i]), size, size) for i in (place, *range(n_p - m, n_p))]
    return ca.Function("A", [p], [A, ca.densify(ca.horzcat(*derivatives))])


def _springs(system: System) -> tuple[ca.Function, ca.Function]:
    """Return (a, p) -> stiffnesses, their derivatives, those at rest; and p -> the gradients of the arguments."""
    m, n = len(system.elements), system.n
    a, p, u = ca.SX.sym("a", m), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("u")
    k = ca.vertcat(*(first_order(e.at(p), a[i]) for i, e in enumerate(system.elements)))
    slopes = ca.vertcat(*(ca.substitute(ca.jacobian(e.force(u, p), u), u, 0) for e in system.elements))
    outputs = [ca.densify(x) for x in (k, ca.diag(ca.jacobian(k, a)), slopes)]
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    arguments = ca.vertcat(*(e.argument(q, v, p) for e in system.elements))
    gradients = [ca.densify(ca.jacobian(arguments, s)) for s in (q, v)]
    return ca.Function("springs", [a, p], outputs), ca.Function("arguments", [p], gradients)
