"""Motion in time: fixed-step Runge-Kutta and CVODES."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door, positive, unknown_name
from hbbogie.model.dynamics import solved_rates, state_of
from hbbogie.model.system import System
from hbbogie.results import Orbit, Trajectory
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
Initial = Mapping[str, float] | Orbit | Trajectory

METHODS = ("rk4", "cvodes")
# samples in one call of a built function; longer runs call it repeatedly, so its size does not grow with the duration
BLOCKS = (500, 100, 20, 4, 1)
LONGEST_STEP = 1e-3  # s; longest default step
MOST_STEPS = 20_000_000  # samples in one trajectory: more would not fit the memory of a laptop
NEWTON_STEPS = 3  # Newton steps for the time of a jump inside a step, starting from linear interpolation
BRIEF = 2000  # largest number of CVODES steps between two samples in `states_after`
TOO_LARGE = 1e12  # no state of a physical model is larger
PART = 0.6  # product of fixed steps and the fastest rate


@door(system=System)
def simulate(
    system: System,
    initial: Initial,
    duration: float,
    *,
    method: str = "rk4",
    step: float | None = None,
    tolerance: float = 1e-9,
    **parameters: float,
) -> Trajectory:
    """Integrate the equations of motion in time.

    Parameters
    ----------
    system : System
    initial : mapping, Orbit or Trajectory
        Where the motion starts. A mapping gives values by name: ``{"q1": 0.03, "q1'": 0.1}`` sets the coordinate q1
        and, with a prime, its velocity. Everything not named is zero. An orbit gives its state at t = 0, and a
        trajectory its last state and time. Their parameter values are not used.
    duration : float, s
    method : {"rk4", "cvodes"}
        Classical Runge-Kutta with fixed step, or the variable-step multistep integrator of SUNDIALS.
    step : float, s
        Time between samples, and with "rk4" also the integration step. By default 1 ms, or less if the fastest motion
        near rest requires it (`default_step`). It is shortened so that the duration is a whole number of steps.
    tolerance : float
        Relative tolerance of "cvodes"; the absolute tolerance is a thousandth of it.
    **parameters : float
        Parameter values that replace the system's, by name.

    Returns
    -------
    Trajectory
        With a sample at the start and after every step.

    Raises
    ------
    ModelError
        For an unknown name or method, or a duration, step or tolerance that is not positive.
    ConvergenceError
        When the motion, or the integration, blows up; the message says when.

    Notes
    -----
    Contacts of continuous elements are not located. "rk4" steps across them and loses order there: the error of a step
    that contains a contact is proportional to the cube of the step. The steps of "cvodes" are at most as long as the
    time between samples, so that it does not step over a short contact, and its error control refines the step at the
    kink. Where an element jumps, "rk4" divides the step and keeps its order. If two jumps fall into one step, only the
    first is located. A motion that sticks at a jump chatters about it from step to step.
    """
    if method not in METHODS:
        raise ModelError(unknown_name("integration method", str(method), METHODS))
    p = system.vector(**parameters)
    duration = positive("duration", duration, "s")
    step = default_step(system, p) if step is None else positive("step", step, "s")
    positive("tolerance", tolerance, "1")
    start, x = initial_state(system, initial)
    count = max(1, int(np.ceil(duration / step * (1 - 1e-12))))
    if count > MOST_STEPS:
        raise ModelError(
            f"duration {duration:g} s with step {step:g} s makes {count:.3g} samples; allowed are {MOST_STEPS:.0e}. "
            "Give a shorter duration or a longer step, or continue from the last state in a second call."
        )
    h = duration / count
    states = np.empty((count + 1, system.n_states))
    states[0] = x
    k = 0
    while k < count:
        # a fixed step may run beyond the end and be cut off; CVODES may not, because it fails where a motion blows up
        size = BLOCKS[0] if method == "rk4" else next(b for b in BLOCKS if b <= count - k)
        block = _advance(system, method, tolerance, size, states[k], p, h, start + k * h)[: count - k]
        _check_finite(system, block, method, h, start + k * h)
        states[k + 1 : k + 1 + len(block)] = block
        k += len(block)
    merged = system.with_parameters(**parameters)
    return Trajectory(
        system=system.name,
        coordinates=system.coordinate_names,
        naming=system.naming,
        units=tuple(c.unit for c in system.coordinates),
        t=np.asarray(start + h * np.arange(count + 1), dtype=float),
        q=states[:, : system.n].copy(),
        v=velocities(system, states, p),
        parameters=dict(merged.values),
        method=f"{method}, step {h:g} s" + (f", tolerance {tolerance:g}" if method == "cvodes" else ""),
    )


def default_step(system: System, p: Array) -> float:
    """Return the step [s] that resolves the fastest motion near rest at parameters p, at most 1 ms.

    The step is at most a hundredth of the shortest period and at most the inverse of the largest eigenvalue. The
    stability limit of the Runge-Kutta method is 2.8 times this inverse.
    """
    A = system.ode_jacobian(np.zeros(system.n_states), p).full()
    if not np.isfinite(A).all():
        return LONGEST_STEP
    values = np.abs(np.linalg.eigvals(A)), np.abs(np.linalg.eigvals(A).imag)
    largest, fastest = (float(v.max(initial=1e-300)) for v in values)
    return float(min(LONGEST_STEP, 1 / max(largest, 1e-300), 2 * np.pi / (100 * max(fastest, 1e-300))))


def initial_state(system: System, initial: Initial) -> tuple[float, Array]:
    """Return the time and the state, shape (n_states,), from which a motion starts."""
    n, second = system.n, [i for i, s in enumerate(system.second_order) if s]
    if isinstance(initial, Orbit | Trajectory):
        if initial.coordinates != system.coordinate_names:
            raise ModelError(
                f"the initial {type(initial).__name__.lower()} belongs to {initial.system!r} with "
                f"coordinates {', '.join(initial.coordinates)}; the system {system.name!r} has "
                f"{', '.join(system.coordinate_names)}. Give one of the same system."
            )
        if isinstance(initial, Trajectory):
            return float(initial.t[-1]), np.r_[initial.q[-1], initial.v[-1, second]]
        return 0.0, np.r_[initial.q(0.0)[0], initial.v(0.0)[0, second]]
    if not isinstance(initial, Mapping):
        raise ModelError(
            f"initial: got a {type(initial).__name__}; give a mapping such as "
            f"{{{system.coordinate_names[0]!r}: 0.01}}, an Orbit or a Trajectory."
        )
    names = [*system.coordinate_names, *(system.coordinate_names[i] + "'" for i in second)]
    x = np.zeros(n + len(second))
    for name, value in initial.items():
        if name not in names:
            raise ModelError(f"initial state of {system.name!r}: {unknown_name('state', str(name), names)}")
        try:
            x[names.index(name)] = float(value)
        except (TypeError, ValueError):
            raise ModelError(f"initial state {name!r}: got {value!r}; give a number.") from None
        if not np.isfinite(x[names.index(name)]):
            raise ModelError(f"initial state {name!r}: got {value!r}; give a finite number.")
    return 0.0, x


def _advance(system: System, method: str, tolerance: float, size: int, x: Array, p: Array, h: float, t: float) -> Array:
    """Return the states after 1, 2, ... size steps of h [s] from the state x, shape (size, n_states)."""
    if method == "rk4":
        run = system.once(("rk4", size), lambda: _runge_kutta(system, size))
        return np.asarray(run(x, p, h).full().T)
    run = system.once(("cvodes", tolerance, size), lambda: _cvodes(system, tolerance, size))
    try:
        return np.asarray(run(x0=x, p=np.r_[h, p])["xf"].full().T)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ConvergenceError(
            f"system {system.name!r}: CVODES gave up between t = {t:g} s and {t + size * h:g} s at tolerance "
            f"{tolerance:g} ({reason}). Either the motion grows without bound, or the tolerance cannot be "
            "met: try a shorter duration, a larger tolerance or a shorter step.",
            statistics={"time": t, "state": x, "step": h},
        ) from error


def states_after(
    system: System, x: Array, p: Array, h: float, count: int, tolerance: float, most: int = BRIEF
) -> Array:
    """Return the states after 1, 2, ... count samples at a distance of h [s] by CVODES, shape (count, n_states).

    Between two samples it takes ``most`` steps.

    Raises
    ------
    ConvergenceError
        When the integration gives up.
    """
    run = system.once(("brief", tolerance, count, most), lambda: _cvodes(system, tolerance, count, most))
    try:
        return np.asarray(run(x0=x, p=np.r_[h, p])["xf"].full().T)
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1]
        raise ConvergenceError(f"system {system.name!r}: CVODES gave up within {count * h:g} s ({reason}).") from error


def states_in_steps(system: System, x: Array, p: Array, h: float, count: int, rate: float, most: float) -> Array | None:
    """Return what `states_after` does, by fixed Runge-Kutta steps, given about the fastest rate of the motion [1/s].

    None where that would take more than ``most`` steps between two samples, or where the motion leaves every bound, be
    it by the method.
    """
    parts, found = max(1, int(np.ceil(h * rate / PART))), list[Array]()
    if parts > most:
        return None
    for k in range(parts):
        steps = _advance(system, "rk4", 0.0, count, x, p, h / parts, 0.0)
        x = steps[-1]
        found.append(steps[(-1 - k * count) % parts :: parts])
    states = np.concatenate(found)
    return states if (np.abs(states) < TOO_LARGE).all() else None


def runge_kutta_step(f: Callable[[ca.SX], ca.SX], x: ca.SX, h: ca.SX) -> ca.SX:
    """Return the state after one step of the classical Runge-Kutta method.

    Parameters
    ----------
    f : callable
        x -> dx/dt.
    x : casadi.SX, shape (n_states,)
    h : casadi.SX, s
    """
    k1 = f(x)
    k2 = f(x + h / 2 * k1)
    k3 = f(x + h / 2 * k2)
    k4 = f(x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def _runge_kutta(system: System, size: int) -> ca.Function:
    """Return (x, p, h) -> states after 1 ... size steps of the classical Runge-Kutta method."""
    if any(e.heights is not None for e in system.elements):
        return _located(system).mapaccum("rk4", size)
    x, p, h = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("h")
    return ca.Function("step", [x, p, h], [runge_kutta_step(lambda y: system.ode(y, p), x, h)]).mapaccum("rk4", size)


def _located(system: System) -> ca.Function:
    """Return (x, p, h) -> the state after a step that is divided at its first jump of an element."""
    field, depths = _held(system)
    n, m = system.n_states, depths.size1_out(0)
    sx = [ca.SX.sym("x", n), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("h"), ca.SX.sym("on", m)]
    x, p, h, on = sx
    whole = ca.Function("whole", sx, [runge_kutta_step(lambda y: field(y, on, p), x, h)])
    end, then = ca.SX.sym("end", n), ca.SX.sym("then", m)
    start, stop = depths(x, on, p), depths(end, on, p)
    share = ca.if_else(on != then, start / (start - stop), 1)
    theta, which = ca.SX(1), ca.SX.zeros(m)
    for i in range(m):
        earlier = ca.logic_and(on[i] != then[i], share[i] < theta)
        theta, which = ca.if_else(earlier, share[i], theta), ca.if_else(earlier, ca.DM.eye(m)[:, i], which)
    for _ in range(NEWTON_STEPS):
        y = whole(x, p, theta * h, on)
        rate = ca.jtimes(depths(x, on, p), x, field(x, on, p))
        slope = h * ca.dot(which, ca.substitute(rate, x, y))
        change = ca.dot(which, depths(y, on, p)) / ca.if_else(slope != 0, slope, 1)
        theta = ca.fmin(ca.fmax(theta - change, 0), 1)
    divided = whole(whole(x, p, theta * h, on), p, (1 - theta) * h, then)
    choice = ca.Function.if_else(
        "choice",
        ca.Function("divided", [*sx, end, then], [divided]),
        ca.Function("undivided", [*sx, end, then], [end]),
    )
    X, P, step = ca.MX.sym("x", n), ca.MX.sym("p", len(system.parameters)), ca.MX.sym("h")
    # the depths do not depend on which ramps are on, unless an argument contains rates instead of states
    now = depths(X, 0, P) > 0
    after = whole(X, P, step, now)
    beyond = depths(after, now, P) > 0
    return ca.Function("step", [X, P, step], [choice(ca.norm_1(beyond - now) > 0, X, P, step, now, after, beyond)])


def _held(system: System) -> tuple[ca.Function, ca.Function]:
    """Return functions of (x, on, p): dx/dt, and how far the argument of each ramp is beyond its threshold.

    The ramps are those of the elements that jump. ``on`` switches each on (1) or off (0), whatever its argument.
    """
    n = system.n
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, len(system.parameters)), strict=True))
    jumping = [e for e in system.elements if e.heights is not None]
    on = ca.SX.sym("on", sum(len(e.directions) for e in jumping))
    forces: list[ca.SX] = []
    depths: list[ca.SX] = []
    for e in system.elements:
        u = e.argument(q, v, p)
        if e.heights is None:
            forces.append(e.force(u, p))
            continue
        offset, stiffness, k, threshold = e.ramps(p)
        d, first = ca.DM(e.directions), sum(x.size1() for x in depths)
        depths.append(d * u - threshold)
        active = d * on[first : first + len(e.directions)]
        forces.append(offset + stiffness * u + ca.dot(active, k * depths[-1] + e.heights(p)))
    rates = solved_rates(system.dynamics, system.residual_with_forces(q, v, a, ca.vertcat(*forces), p), v, a)
    x, beyond = state_of(system.dynamics, q, v), ca.substitute(ca.vertcat(*depths), v, rates[:n])
    return ca.Function("held", [x, on, p], [rates]), ca.Function("depths", [x, on, p], [ca.densify(beyond)])


def _cvodes(system: System, tolerance: float, size: int, most: int = 100_000) -> ca.Function:
    """Return CVODES over a number of samples; its unit of time is h [s], its first parameter."""
    x, p, h = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("h")
    problem = {"x": x, "p": ca.vertcat(h, p), "ode": h * system.ode(x, p)}
    options = {
        "reltol": tolerance,
        "abstol": 1e-3 * tolerance,
        "max_step_size": 1.0,
        "max_num_steps": most,
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
    }
    return ca.integrator("cvodes", "cvodes", problem, 0.0, list(range(1, size + 1)), options)


def _check_finite(system: System, states: Array, method: str, h: float, t: float) -> None:
    """Raise `ConvergenceError` when a state, shape (N, n_states), is not a number or unreasonably large."""
    good = np.abs(states) < TOO_LARGE  # False for NaN too
    if good.all():
        return
    first = int(np.argmin(good.all(axis=1)))
    names = [*system.coordinate_names, *(f"{c}'" for c in system.coordinate_names)]
    guilty = names[int(np.argmin(good[first]))]
    advice = (
        'try a smaller step, or method="cvodes"; if that blows up too, the motion itself grows without bound'
        if method == "rk4"
        else "the motion itself seems to grow without bound"
    )
    raise ConvergenceError(
        f"system {system.name!r}: the motion blew up at t = {t + (first + 1) * h:g} s ({guilty} is beyond "
        f"{TOO_LARGE:g} or not a number) with {method} and step {h:g} s; {advice}.",
        statistics={"time": t + (first + 1) * h, "step": h},
    )


def velocities(system: System, states: Array, p: Array) -> Array:
    """Return the velocities at the states, shape (N, n); first-order coordinates get theirs from their equations."""
    second = np.array(system.second_order)
    v = np.empty((len(states), system.n))
    v[:, second] = states[:, system.n :]
    if not second.all():
        v[:, ~second] = system.ode(states.T, p).full().T[:, : system.n][:, ~second]
    return v
