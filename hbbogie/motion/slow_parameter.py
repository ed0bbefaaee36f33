"""Motions in time while a parameter changes at a constant rate, and their turning points."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door, positive
from hbbogie.model.system import System
from hbbogie.motion.integration import (
    MOST_STEPS,
    TOO_LARGE,
    Initial,
    default_step,
    initial_state,
    runge_kutta_step,
    velocities,
)
from hbbogie.results import Trajectory
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
BLOCK = 500  # steps in one call of the built function


@door(system=System, parameter=str)
def simulate_ramp(
    system: System,
    initial: Initial,
    duration: float,
    *,
    parameter: str,
    rate: float,
    step: float | None = None,
    **parameters: float,
) -> Trajectory:
    """Integrate the equations of motion while a parameter changes at a constant rate.

    Parameters
    ----------
    system : System
    initial : mapping, Orbit or Trajectory
        As in `simulate`; the time begins at 0.
    duration : float, s
    parameter : str
        Its value is value + rate t.
    rate : float, unit of the parameter per second
        Negative for a falling parameter. With 0 the motion is that of `simulate`.
    step : float, s
        Step of the classical Runge-Kutta method, shortened so that the duration is a whole number of steps. The
        parameter has its own value at every stage of a step (eq-drift). The default is that of `simulate`.
    **parameters : float
        Parameter values, by name. For the changing parameter this is the value at t = 0.

    Returns
    -------
    Trajectory
        Its parameters are those at t = 0.

    Raises
    ------
    ModelError
        For invalid names or values, or when the parameter leaves its bounds.
    ConvergenceError
        When the motion blows up.
    """
    duration = positive("duration", duration, "s")
    step = default_step(system, system.vector(**parameters)) if step is None else positive("step", step, "s")
    system = system.with_parameters(**parameters)
    place = system.parameter_names.index(system.parameter(parameter).name)
    system.with_parameters(**{parameter: system.values[parameter] + rate * duration})  # within its bounds
    count = max(1, int(np.ceil(duration / step * (1 - 1e-12))))
    if count > MOST_STEPS:
        raise ModelError(f"{duration:g} s with step {step:g} s make {count:.3g} samples; allowed are {MOST_STEPS:.0e}.")
    h, p = duration / count, system.vector()
    run = system.once(("ramp", place), lambda: _runge_kutta(system, place))
    states = np.empty((count + 1, system.n_states))
    states[0] = initial_state(system, initial)[1]
    values = p[place] + rate * h * np.arange(count + BLOCK)
    for k in range(0, count, BLOCK):
        block = run(states[k], values[k : k + BLOCK][None], p, h, rate).full().T[: count - k]
        good = (np.abs(block) < TOO_LARGE).all(axis=1)
        if not good.all():
            t = h * (k + 1 + int(np.argmin(good)))
            raise ConvergenceError(
                f"system {system.name!r}: the motion blew up at t = {t:g} s, {parameter} = {p[place] + rate * t:g}; "
                "try a smaller step; if that blows up too, the motion itself grows without bound.",
                statistics={"time": t, "step": h},
            )
        states[k + 1 : k + 1 + len(block)] = block
    P = np.repeat(p[:, None], count + 1, axis=1)
    P[place] = values[: count + 1]
    return Trajectory(
        system=system.name,
        coordinates=system.coordinate_names,
        naming=system.naming,
        units=tuple(c.unit for c in system.coordinates),
        t=np.asarray(h * np.arange(count + 1), dtype=float),
        q=states[:, : system.n].copy(),
        v=velocities(system, states, P),
        parameters=dict(system.values),
        method=f"rk4, step {h:g} s, {parameter} changing by {rate:g} per second",
    )


def _runge_kutta(system: System, place: int) -> ca.Function:
    """Return (x, values, p, h, rate) -> states after 1 ... BLOCK steps that begin at the given parameter values."""
    n, x, p = system.n_states, ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    value, h, rate = (ca.SX.sym(name) for name in ("value", "h", "rate"))

    def drifting(y: ca.SX) -> ca.SX:  # eq-drift: the value is an additional state
        at = [y[n] if i == place else p[i] for i in range(p.numel())]
        return ca.vertcat(system.ode(y[:n], ca.vertcat(*at)), rate)

    after = runge_kutta_step(drifting, ca.vertcat(x, value), h)[:n]
    step = ca.Function("step", [x, value, p, h, rate], [after], {"cse": True})
    return step.mapaccum("ramp", BLOCK)


def turning_points(motion: Trajectory, name: str, rest: float = 0.0) -> tuple[Array, Array]:
    """Return when a coordinate turns, and its distance from rest at these times.

    Parameters
    ----------
    motion : Trajectory
    name : str
        The coordinate.
    rest : float, unit of the coordinate
        Its value at the equilibrium.

    Returns
    -------
    times, peaks : ndarray, shape (k,), s and unit of the coordinate
        The larger of every two successive turning points, which lie on either side, and the time midway between them.
    """
    i = motion.index(name)
    v = motion.v[:, i]
    k = np.flatnonzero(v[:-1] * v[1:] < 0)
    t = motion.t[k] + (motion.t[k + 1] - motion.t[k]) * v[k] / (v[k] - v[k + 1])
    if len(t) < 2:
        return np.empty(0), np.empty(0)
    size = np.abs(motion.at(t)[0][:, i] - rest)
    return 0.5 * (t[:-1] + t[1:]), np.maximum(size[:-1], size[1:])
