"""Cycles by equivalent linearisation with compatible inputs and outputs (equations 5 to 9 of the source).

Input amplitudes of the elements determine equivalent stiffnesses. At the critical value of a parameter the linear
system oscillates, and the eigenvector gives output amplitudes. There is a cycle if outputs and inputs agree. The
amplitude a_1 of one element is held. The other amplitudes, a common factor c and the input frequency omega minimise the
dimensionless objective (eq-compatibility)::

    sum_i ((a_i - c b_i) / s_i)^2 + (omega / omega_h - 1)^2,    a_i, c, omega > 0

The scales s_i are a_1 for the first element and the initial amplitudes for the others. They make amplitudes with
different units comparable. At a cycle the objective is 0 whatever the s_i are. The source adds metres and radians per
second, with all s_i and the last divisor equal to 1.

References
----------
Y.-R. Yang, Limit cycle hunting of a bogie with flanged wheels, Vehicle System Dynamics 24 (1995) 185-196.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.equivalent import EquivalentSystem, NeutralMode
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]
AGREED = 1e-12  # objective up to which inputs and outputs count as compatible
ENOUGH = 1e-18  # objective at which the derivative-free search ends
RESTARTS = 6  # of the derivative-free search
Found = tuple[Array, NeutralMode, float, float, int, str]  # inputs, neutral mode, omega, objective, evaluations, status


@dataclass(frozen=True, eq=False)
class Compatible:
    """A cycle by equivalent linearisation.

    Attributes
    ----------
    parameter : str
    value : float
        Critical value of the parameter, at which the cycle exists.
    omega : float, rad/s
    amplitudes : dict of float, unit of the argument
        Of each element's argument, by the element's name.
    objective : float
        Remaining value of the dimensionless objective; 0 if inputs and outputs agree.
    method : {"ipopt", "search"}
    evaluations : int
        Number of evaluations of the objective; with IPOPT, together with its constraints.
    milliseconds : float
        Time of the solve, without building functions and solver, which happens once before.
    status : str
        A sentence on how it ended.
    orbit : Orbit
        The cycle with one harmonic, in the phase of the element whose amplitude is held.
    """

    parameter: str
    value: float
    omega: float
    amplitudes: dict[str, float]
    objective: float
    method: str
    evaluations: int
    milliseconds: float
    status: str
    orbit: Orbit

    __repr__ = brief


def compatible(
    system: System,
    amplitude: Mapping[str, float],
    parameter: str,
    interval: tuple[float, float],
    *,
    method: str = "ipopt",
    guess: Orbit | None = None,
) -> Compatible:
    """Find the cycle in which one element has a given amplitude, by equivalent linearisation.

    Parameters
    ----------
    system : System
        An odd system that is linear except for its elements.
    amplitude : mapping of one element name to float
        First-harmonic amplitude of that element's argument, in its unit, which is held.
    parameter : str
        The parameter whose value at the cycle is to be found.
    interval : (float, float), unit of the parameter
        Where to look for the loss of stability of the equilibrium. The search starts there and may leave the interval.
    method : {"ipopt", "search"}
        One nonlinear program with the eigenvalue condition as constraints and exact derivatives, or the
        derivative-free search of the source (Nelder-Mead with restarts; every evaluation solves an
        eigenvalue problem).
    guess : Orbit, optional
        A nearby cycle, which replaces the interval as the start.

    Returns
    -------
    Compatible

    Raises
    ------
    ConvergenceError
        When there is no critical value to start from, or inputs and outputs cannot be made to agree.
    ModelError
        For an unknown name, or a system that the method does not cover.
    """
    if method not in ("ipopt", "search"):
        raise ModelError(f"compatible: {unknown_name('method', method, ('ipopt', 'search'))}")
    equivalent = EquivalentSystem(system, parameter)
    first, a1 = equivalent.first(amplitude)
    inputs, known = _start(equivalent, first, a1, interval, guess)
    solve: Callable[[EquivalentSystem, int, Array, NeutralMode], Found]
    if method == "ipopt":
        key = "compatibility", parameter, first
        solve = partial(_by_ipopt, system.once(key, lambda: _program(equivalent, first)))
    else:
        solve = _by_search
    began = perf_counter()
    inputs, found, omega, objective, counted, status = solve(equivalent, first, inputs, known)
    elapsed = 1e3 * (perf_counter() - began)
    if not objective <= AGREED:
        raise ConvergenceError(
            f"equivalent linearisation of {system.name!r}: inputs and outputs do not agree (objective {objective:.2e}; "
            f"{status}) at the amplitude {a1:g} of {equivalent.names[first]!r}; start from a nearby cycle with "
            "guess=..., or take another amplitude.",
            _orbit(equivalent, first, a1, found, status),
            {"evaluations": counted, "objective": objective},
        )
    status = f"inputs and outputs agree to {np.sqrt(objective):.1e}: {status}"
    return Compatible(
        parameter,
        found.value,
        omega,
        dict(zip(equivalent.names, map(float, inputs), strict=True)),
        objective,
        method,
        counted,
        elapsed,
        status,
        _orbit(equivalent, first, a1, found, status),
    )


def _start(
    equivalent: EquivalentSystem, first: int, a1: float, interval: tuple[float, float], guess: Orbit | None
) -> tuple[Array, NeutralMode]:
    """Return initial input amplitudes and the critical value that belongs to them."""
    if guess is not None:
        mode = guess.coefficients[1] - 1j * guess.coefficients[2]
        outputs = np.abs((equivalent.du_dq + 1j * guess.omega * equivalent.du_dv) @ mode)
        inputs = a1 * outputs / outputs[first]
        value = guess.parameters[equivalent.parameter]
        return inputs, equivalent.critical(equivalent.stiffness(inputs), value, guess.omega)
    begin = equivalent.at_rest()
    try:
        known = equivalent.locate(begin, interval)
    except ConvergenceError:  # such as a mass that is free until a gap closes
        begin[first] = equivalent.stiffness(np.full(len(begin), a1))[first]
        known = equivalent.locate(begin, interval)
    inputs = a1 * np.abs(known.outputs) / np.abs(known.outputs[first])
    return inputs, equivalent.follow(known, begin, equivalent.stiffness(inputs))


def _orbit(equivalent: EquivalentSystem, first: int, a1: float, found: NeutralMode, status: str) -> Orbit:
    """Return the eigenvector as a cycle in which the first element has its amplitude."""
    system, mode = equivalent.system, found.mode * a1 / found.outputs[first]
    p = equivalent.p.copy()
    p[equivalent.place] = found.value
    return Orbit(
        system=system.name,
        coordinates=system.coordinate_names,
        naming=system.naming,
        units=tuple(c.unit for c in system.coordinates),
        motion=FourierSeries(np.array([np.zeros(system.n), mode.real, -mode.imag])),
        omega=found.omega,
        parameters=dict(zip(system.parameter_names, map(float, p), strict=True)),
        method="equivalent linearisation",
        status=status,
    )


# --- the derivative-free search of the source -------------------------------------------------


def _by_search(equivalent: EquivalentSystem, first: int, inputs: Array, known: NeutralMode) -> Found:
    """Minimise over the logarithms of the other amplitudes, c and omega, which keeps them positive."""
    m, start = len(inputs), known
    others = [i for i in range(m) if i != first]
    latest, count = known, 0

    def unpack(x: Array) -> tuple[Array, float, float]:
        a = inputs.copy()
        a[others] *= np.exp(x[: m - 1])
        return a, float(np.exp(x[-2])), start.omega * float(np.exp(x[-1]))

    def objective(x: Array) -> float:
        nonlocal latest, count
        count += 1
        a, c, omega = unpack(x)
        try:
            latest = equivalent.critical(equivalent.stiffness(a), latest.value, latest.omega)
        except ConvergenceError:
            return 1e6
        b = inputs[first] * np.abs(latest.outputs) / np.abs(latest.outputs[first])  # the size of the mode is arbitrary
        return float((((a - c * b) / inputs) ** 2).sum() + (omega / latest.omega - 1) ** 2)

    x, best = np.zeros(m + 1), np.inf
    for round_ in range(RESTARTS):
        spread = 0.02 * 0.1**round_
        simplex = np.vstack([x, x + spread * np.eye(m + 1)])
        options = {"initial_simplex": simplex, "xatol": 1e-9, "fatol": ENOUGH, "maxiter": 400 * (m + 1)}
        result = minimize(objective, x, method="Nelder-Mead", options=options)
        x, improved = result.x, result.fun < 0.1 * best
        best = min(best, float(result.fun))
        if best <= ENOUGH or not improved:
            break
    final = objective(x)
    a, _, omega = unpack(x)
    return a, latest, omega, final, count, f"Nelder-Mead search, {count} evaluations"


# --- one nonlinear program --------------------------------------------------------------------


def _by_ipopt(program: Any, equivalent: EquivalentSystem, first: int, inputs: Array, known: NeutralMode) -> Found:
    system, m, size = equivalent.system, len(inputs), equivalent.linear.n_states
    n = system.n
    second = [i for i, s in enumerate(system.second_order) if s]
    mode = known.mode * inputs[first] / known.outputs[first]
    state = np.r_[mode, 1j * known.omega * mode[second]]
    # typical sizes of the states, for well-scaled unknowns: the mode for positions, omega times the mode for velocities
    sizes = np.maximum(np.abs(mode), 1e-3 * np.abs(mode).max())
    sizes = np.r_[sizes, known.omega * sizes[second]]
    y = state / sizes
    theta = np.r_[equivalent.p, inputs, known.value, known.omega, sizes, y.real, y.imag]
    x0 = np.r_[np.ones(m - 1), 1.0, 1.0, 0.0, 1.0, y.real, y.imag]
    lower = np.r_[np.full(m + 1, 1e-6), -np.inf, 1e-6, np.full(2 * size, -np.inf)]
    result = program(x0=x0, p=theta, lbx=lower, ubx=np.inf, lbg=0, ubg=0)
    statistics = program.stats()
    x = result["x"].full().ravel()
    others = [i for i in range(m) if i != first]
    a = inputs.copy()
    a[others] *= x[: m - 1]
    eigenvector = (x[m + 3 : m + 3 + n] + 1j * x[m + 3 + size : m + 3 + size + n]) * sizes[:n]
    value, omega_h = known.value + x[m + 1] * (abs(known.value) or 1.0), float(x[m + 2] * known.omega)
    outputs = (equivalent.du_dq + 1j * omega_h * equivalent.du_dv) @ eigenvector
    found = NeutralMode(float(value), omega_h, eigenvector, outputs, np.empty(0), float("nan"))
    feasible = float(np.abs(result["g"].full()).max()) <= 1e-8
    objective = float(result["f"]) if feasible else np.inf
    status = f"IPOPT says {statistics['return_status']!r} after {statistics['iter_count']} iterations"
    return a, found, float(x[m] * known.omega), objective, int(statistics["n_call_nlp_f"]), status


def _program(equivalent: EquivalentSystem, first: int) -> Any:
    """Return the NLP solver: unknowns relative to the start, and real and imaginary part of the eigenvector."""
    linear = equivalent.linear
    m, size, n, n_p = len(equivalent.names), linear.n_states, equivalent.system.n, len(equivalent.p)
    shapes = (("p", n_p), ("inputs", m), ("value", 1), ("omega", 1), ("sizes", size), ("re", size), ("im", size))
    theta = [ca.SX.sym(s, k) for s, k in shapes]
    p, inputs, value, omega_0, sizes, re_0, im_0 = theta
    ratios, c, omega, V, omega_h = (ca.SX.sym(s, k) for s, k in (("a", m - 1), ("c", 1), ("w", 1), ("V", 1), ("wh", 1)))
    re, im = ca.SX.sym("re", size), ca.SX.sym("im", size)
    a = ca.SX(inputs)
    others = [i for i in range(m) if i != first]
    for k, i in enumerate(others):
        a[i] = inputs[i] * ratios[k]
    p_at = ca.SX(p)
    p_at[equivalent.place] = value + V * ca.if_else(value == 0, 1, ca.fabs(value))
    springs = equivalent.springs(a, p_at)[0]
    A = linear.ode_jacobian(ca.SX.zeros(size), ca.vertcat(p_at, springs))
    A = ca.diag(1 / sizes) @ A @ ca.diag(sizes) / omega_0
    condition = [A @ re + omega_h * im, A @ im - omega_h * re]
    length = ca.dot(re_0, re_0) + ca.dot(im_0, im_0)
    condition += [(ca.dot(re_0, re) + ca.dot(im_0, im)) / length - 1, (ca.dot(re_0, im) - ca.dot(im_0, re)) / length]
    du_dq, du_dv = equivalent.arguments(p_at)
    x, y, w = sizes[:n] * re[:n], sizes[:n] * im[:n], omega_h * omega_0
    b = ca.sqrt((du_dq @ x - w * (du_dv @ y)) ** 2 + (du_dq @ y + w * (du_dv @ x)) ** 2)
    objective = ca.sumsqr((a - c * b) / inputs) + (omega / omega_h - 1) ** 2
    unknowns = ca.vertcat(ratios, c, omega, V, omega_h, re, im)
    options = {"print_level": 0, "sb": "yes", "max_iter": 200, "tol": 1e-12, "mu_init": 1e-8, "bound_push": 1e-8,
               "bound_frac": 1e-8, "nlp_scaling_method": "none"}  # fmt: skip
    problem = {"x": unknowns, "p": ca.vertcat(*theta), "f": objective, "g": ca.vertcat(*condition)}
    return ca.nlpsol("compatibility", "ipopt", problem, {"print_time": False, "ipopt": options})
