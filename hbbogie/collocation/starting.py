"""First guesses of a cycle: from an orbit, and from a motion that has settled."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import LSODA
from scipy.interpolate import CubicHermiteSpline

from hbbogie.brief import brief
from hbbogie.collocation.cycle import CollocatedCycle, cycle_of
from hbbogie.collocation.mesh import spread
from hbbogie.collocation.rates import Rates
from hbbogie.errors import ModelError, door, told
from hbbogie.model.conserved import state_names
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.polynomials import points_of
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.orbit import Orbit
from hbbogie.stability.variation import check_orbit

Array = NDArray[np.float64]
CHUNK, CHUNKS = 400, 15  # steps between two looks at a motion, and looks
ACCURACY = 1e-7  # of the integration
CLOSED = 1e-4  # distance of two passages of a plane, relative to the range, that are one
REST = 1e-6  # range of a motion that has come to rest, relative to its size


@dataclass(frozen=True, eq=False)
class Sampled:
    """A motion over a period as a function, with samples that tell where it is fast: a guess.

    Attributes
    ----------
    system : System
    states : callable
        Shares of the period -> states, shape (K, n_states).
    samples : ndarray, shape (K,)
        Shares from 0 to 1, close where the motion is fast.
    period : float, s
    parameters : dict
    advance : tuple of float
        By how much each coordinate grows in a period; empty where none runs on.
    """

    system: System
    states: Callable[[Array], Array]
    samples: Array
    period: float
    parameters: dict[str, float]
    advance: tuple[float, ...] = ()

    __repr__ = brief

    def on(self, N: int, degree: int) -> CollocatedCycle:
        """Return the motion on a mesh of N intervals: half by the number of samples, half by arclength."""
        x = self.states(self.samples)
        size = np.maximum(np.ptp(x, axis=0), np.finfo(float).tiny)
        steps = np.sqrt(((np.diff(x, axis=0) / size) ** 2).sum(axis=1))
        part = 1 / len(steps) + steps / max(float(steps.sum()), 1e-300)
        mesh = spread(self.samples, part / np.diff(self.samples), N)
        points = points_of(mesh, degree)
        values = self.states(points.ravel()).reshape(*points.shape, -1)
        return cycle_of(self.system, mesh, values, self.period, self.parameters, self.advance)

    def mark(self) -> Array:
        """Return frequency [rad/s], then means, smallest and largest values of the coordinates, shape (1 + 3 n,)."""
        q = self.states(self.samples)[:, : self.system.n]
        return np.concatenate(
            [[2 * np.pi / self.period], np.trapezoid(q, self.samples, axis=0), q.min(axis=0), q.max(axis=0)]
        )

    def backwards(self, system: System) -> Sampled:
        """Return the same motion backwards in time, one of another system."""
        sign = np.where(np.arange(system.n_states) < system.n, 1.0, -1.0)
        return replace(self, system=system, states=lambda s: sign * self.states(1 - s), samples=1 - self.samples[::-1])


@door(system=System, orbit=Orbit)
def from_orbit(system: System, orbit: Orbit) -> Sampled:
    """Return an orbit as a guess, at its parameter values.

    Raises
    ------
    ModelError
        When it is an equilibrium, or an orbit of another system.
    """
    check_orbit(system, orbit)
    if not orbit.H:
        raise ModelError("from_orbit: the orbit is an equilibrium; give a cycle.")
    second = list(system.second_order)

    def states(s: Array) -> Array:
        tau = 2 * np.pi * s
        return np.hstack([orbit.at(tau), orbit.omega * orbit.at(tau, 1)[:, second]])

    samples = orbit.motion.phases() / (2 * np.pi)
    return Sampled(system, states, samples, orbit.period, dict(orbit.parameters), orbit.advance)


def _state(system: System, x: ArrayLike) -> Array:
    """Return a state as an array; raise `ModelError` unless it has as many finite numbers as the system has states."""
    names = state_names(system)
    wanted = f"give {len(names)} finite numbers, those of {', '.join(names)}"
    try:
        state = np.asarray(x, dtype=float)
    except (TypeError, ValueError):
        raise ModelError(f"from_motion: got {told(x)} as the state of system {system.name!r}; {wanted}.") from None
    fits = state.shape == (len(names),)
    if not (fits and np.isfinite(state).all()):
        shown = f"[{', '.join(map(str, state))}]" if fits else f"an array of shape {state.shape}"
        raise ModelError(f"from_motion: got {shown} as the state of system {system.name!r}; {wanted}.")
    return state


@door(system=System)
def from_motion(system: System, x: ArrayLike) -> Sampled:
    """Follow a motion until it repeats itself, by an integrator that copes with stiff systems; return its last period.

    Parameters
    ----------
    system : System
        At whose values.
    x : array_like, shape (n_states,)
        Where it begins.

    Raises
    ------
    ConvergenceError
        When it comes to rest, grows without limit, or does not repeat itself.
    ModelError
        When an element jumps, or the state is not one of the system.
    """
    p, rates, x = system.vector(), Rates(system), _state(system, x)
    one = rates.of_one(p)
    size = np.maximum(np.abs(x), 1e-6 * max(float(np.abs(x).max()), 1e-300))

    run = LSODA(
        lambda _, y: one(y)[0],
        0.0,
        x,
        np.inf,
        rtol=ACCURACY,
        atol=1e-3 * ACCURACY * size,
        jac=lambda _, y: one(y)[1],
    )
    t, y, slopes = [0.0], [x], np.empty((0, len(x)))
    for _ in range(CHUNKS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it is told by the status
            for _ in range(CHUNK):
                try:
                    run.step()
                except (RuntimeError, ValueError) as error:
                    raise _lost(system, f"the integration failed at t = {run.t:g} s, {error}") from error
                if run.status == "finished":  # the steps have grown without limit
                    raise _lost(system, f"the motion comes to rest at t = {t[-1]:g} s")
                if run.status == "failed" or not np.isfinite(run.y).all():
                    raise _lost(system, f"the motion left every bound at t = {run.t:g} s")
                if run.t > t[-1]:
                    t.append(run.t)
                    y.append(run.y.copy())
        T, X = np.array(t), np.array(y)
        late = X[len(X) // 2 :]
        if (np.ptp(late, axis=0) <= REST * np.abs(late).max(axis=0)).all():
            raise _lost(system, f"the motion comes to rest at t = {run.t:g} s")
        new = np.vstack([X[len(slopes) :], np.tile(X[-1], (CHUNK + 1, 1))])[: CHUNK + 1]  # one function for all chunks
        slopes = np.vstack([slopes, rates(new, p)[0][: len(X) - len(slopes)]])
        spline = CubicHermiteSpline(T, X, slopes)
        if (found := _last_period(T, X, spline)) is not None:
            begin, end = found
            inner = T[(begin < T) & (end > T)]
            times = np.concatenate([[begin], inner, [end]])
            span = end - begin
            shares = (times - begin) / span
            return Sampled(system, partial(_shifted, spline, begin, span), shares, span, dict(system.values))
    turns = turns_of(system.dynamics)
    if (np.ptp(late[:, : system.n], axis=0) >= np.where(turns, turns, np.inf)).any():
        raise _lost(system, "an angle runs on; take find_cycles, and from_orbit for one of its cycles")
    raise _lost(system, f"the motion does not repeat itself within {CHUNK * CHUNKS} steps, up to t = {run.t:g} s")


def _last_period(t: Array, x: Array, spline: CubicHermiteSpline) -> tuple[float, float] | None:
    """Return two times at which a motion passes the same state, the last of its passages of a plane and one before."""
    late = x[len(x) // 2 :]
    low, high = late.min(axis=0), late.max(axis=0)
    width = np.where(high > low, high - low, 1.0)
    k = int(np.argmax((high - low) / np.maximum(np.abs(late).max(axis=0), np.finfo(float).tiny)))
    level = 0.5 * (low[k] + high[k])
    up = np.flatnonzero((x[:-1, k] < level) & (x[1:, k] >= level))
    if len(up) < 2:
        return None
    times = _crossings(t, spline, k, level, up)
    states = spline(times)
    gap = np.abs((states[:-1] - states[-1]) / width).max(axis=1)
    near = np.flatnonzero(gap <= CLOSED)
    return (float(times[near[-1]]), float(times[-1])) if len(near) else None


def _crossings(t: Array, spline: CubicHermiteSpline, k: int, level: float, up: NDArray[np.int_]) -> Array:
    """Return when state k rises through a level within the steps ``up``, by bisection."""
    a, b = t[up].copy(), t[up + 1].copy()
    for _ in range(50):
        middle = 0.5 * (a + b)
        above = spline(middle)[:, k] >= level
        a, b = np.where(above, a, middle), np.where(above, middle, b)
    return 0.5 * (a + b)


def _shifted(spline: CubicHermiteSpline, begin: float, span: float, s: Array) -> Array:
    return np.asarray(spline(begin + span * s))


def _lost(system: System, why: str) -> ConvergenceError:
    return ConvergenceError(f"system {system.name!r}: no cycle was found to begin with: {why}.")
