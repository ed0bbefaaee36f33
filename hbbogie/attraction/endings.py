"""How motions end, many at once: proved to come to rest, settled to a known stable cycle, or undecided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.errors import ModelError
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System
from hbbogie.motion.integration import TOO_LARGE, runge_kutta_step
from hbbogie.results import Orbit

Array = NDArray[np.float64]

BATCHES = (32, 16, 8, 4, 2, 1)  # motions advanced by one call
PHASES = 256  # points of a cycle to which distances are measured
NEAR = 2e-2  # distance from a stable cycle, relative to its size, at which a motion may have settled on it
APART = 0.2  # the same, in units of the distance from the next cycle
TINY = 1e-3  # size, relative to the smallest cycle, of the neighbourhood of rest of a smooth system
STEPS = (256, 512, 1024, 2048, 4096, 8192)  # numbers of steps per period that may be chosen
STEP_TIMES_EIGENVALUE = 0.2
UNROLLED = 8  # steps written out in one function, which halves the time because parameters are passed only once

GROWN = "the motion grew without bound, or the steps are too long for it"
OVER = "neither at rest nor on a known stable cycle when the time was over"
PROVED = "inside all gaps for good: the sum of the moduli of its modes is smaller than the gaps"
SMALL = f"within {TINY:g} of the smallest cycle about a stable equilibrium"
EXACT = "the equilibrium itself"
SETTLED = "close to a stable cycle, and coming closer from period to period"


@dataclass(frozen=True, eq=False)
class Place:
    """The data that decide how motions end at one set of parameter values.

    Attributes
    ----------
    p : ndarray, shape (parameters,)
    period : float, s
        Time between two checks of a motion: the period of the largest stable cycle, or otherwise of the slowest
        decaying mode.
    equilibrium : ndarray, shape (n_states,)
    modes : ndarray of complex, shape (n_states, n_states), or None
        Inverse of the matrix of eigenvectors; None if the equilibrium is not linearly stable.
    reach : ndarray, shape (contacts + states, n_states)
        Moduli of the effect of each mode on each contact, and on each state of a system that is not piecewise linear,
        relative to what is allowed.
    proof : str
        What follows if the sums over the modes stay below 1.
    samples : ndarray, shape (stable cycles, PHASES + 1, n_states)
        States along each stable cycle.
    scale : ndarray, shape (n_states,)
        Size of the states on the cycles.
    near : ndarray, shape (stable cycles,)
        Distance at which a motion counts as settled.
    """

    p: Array
    period: float
    equilibrium: Array
    modes: NDArray[np.complex128] | None
    reach: Array
    proof: str
    samples: Array
    scale: Array
    near: Array


@dataclass(frozen=True, eq=False)
class Ends:
    """How some motions ended.

    Attributes
    ----------
    outcome : ndarray of str, shape (motions,)
        "rest", "cycle" or "undecided".
    time : ndarray, shape (motions,), s
    cycle : ndarray of int, shape (motions,)
        Place of the stable cycle reached; -1 if there is none.
    reason : ndarray of str, shape (motions,)
    """

    outcome: NDArray[np.str_]
    time: Array
    cycle: NDArray[np.int_]
    reason: NDArray[np.str_]


# --- data at one place ------------------------------------------------------------------------


def check_not_running(cycles: Sequence[Orbit]) -> None:
    """Raise `ModelError` where a coordinate runs on in a cycle: motions are not compared with those."""
    if running := [o for o in cycles if o.advance]:
        raise ModelError(
            f"system {running[0].system!r}: an angle runs on in the cycle of period {running[0].period:.6g} s, and "
            "which motions come to such a cycle is not computed; follow motions with simulate, or take "
            "find_cycles(start=...)."
        )


def states_of(system: System, orbit: Orbit, count: int = PHASES) -> Array:
    """Return the states along a cycle, the first and the last the same, shape (count + 1, n_states)."""
    t = orbit.period * np.arange(count + 1) / count
    second = np.array(system.second_order)
    return np.hstack([orbit.q(t), orbit.v(t)[:, second]])


def place_of(system: System, parameter: str, cycles: Sequence[Orbit], others: Sequence[Orbit]) -> Place:
    """Return the data that decide how motions end at the system's parameter values.

    Parameters
    ----------
    system : System
    parameter : str
        The parameter along which the equilibrium is followed.
    cycles : sequence of Orbit
        The cycles at these values, with their stability.
    others : sequence of Orbit
        Cycles at other values, which give the sizes of the states if there are none here.

    Raises
    ------
    ConvergenceError
        If there is neither an equilibrium nor a cycle.
    """
    line, value = Linearisation(system, parameter), system.values[parameter]
    check_not_running(cycles)
    stable = [o for o in cycles if o.stability is not None and o.stability.verdict == "stable"]
    samples = np.array([states_of(system, o) for o in stable]).reshape(len(stable), PHASES + 1, system.n_states)
    scale = _sizes(system, list(cycles) or list(others))
    rest = np.zeros(system.n_states)
    rest[: system.n] = line.equilibrium(value)
    eigenvalues, vectors = line.eigen(value)
    inverse: NDArray[np.complex128] | None = None
    reach, proof = np.empty((0, system.n_states)), ""
    if eigenvalues.real.max() < -1e-9 * np.abs(eigenvalues).max():
        reach, proof = _reach(system, rest, scale, _smallest(system, cycles, scale), vectors)
        inverse = np.linalg.inv(vectors).astype(complex)
    slow = eigenvalues[eigenvalues.imag > 1e-9 * np.abs(eigenvalues).max()]
    periods = [*(o.period for o in reversed(stable)), *(2 * np.pi / slow.imag), *(o.period for o in [*cycles, *others])]
    fastest = float(np.abs(eigenvalues).max())
    period = float(next(iter(periods), 2 * np.pi / fastest if fastest else 1.0))
    near = [min(NEAR, APART * _gap(system, o, cycles, scale)) for o in stable]
    return Place(system.vector(), period, rest, inverse, reach, proof, samples, scale, np.array(near))


def _sizes(system: System, orbits: Sequence[Orbit]) -> Array:
    """Return the sizes of the states on the smallest cycle, or the scales of the equations if there are no cycles."""
    if not orbits:
        return np.full(system.n_states, float(HarmonicBalance(1).equations(system).scale[0]))
    size = np.ptp(min((states_of(system, o) for o in orbits), key=lambda x: float(np.ptp(x, axis=0).max())), axis=0) / 2
    for part in (slice(0, system.n), slice(system.n, None)):  # a state that hardly moves gets the size of the others
        size[part] = np.maximum(size[part], 1e-3 * size[part].max(initial=0.0))
    return size


def _smallest(system: System, cycles: Sequence[Orbit], scale: Array) -> float:
    """Return the size of the smallest cycle in units of the scale, at most 1."""
    sizes = [float((np.ptp(states_of(system, o), axis=0) / 2 / scale).max()) for o in cycles]
    return min([1.0, *sizes])


def _gap(system: System, orbit: Orbit, cycles: Sequence[Orbit], scale: Array) -> float:
    """Return the distance of a cycle from the nearest other one."""
    x = states_of(system, orbit)[:-1]
    others = [states_of(system, o) for o in cycles if o is not orbit]
    return min((float(distances(x, y, scale).min()) for y in others), default=np.inf)


def _reach(
    system: System, rest: Array, scale: Array, smallest: float, vectors: NDArray[np.complex128]
) -> tuple[Array, str]:
    """Return the effect of each mode of unit size, relative to what is allowed, and what that proves."""
    p, rows = system.vector(), [np.empty((0, system.n_states))]
    contacts = [e for e in system.elements if e.ramps is not None]
    if contacts:
        u, slope = (m.full() for m in system.once("contacts", lambda: _contacts(system))(rest, p))
        for i, e in enumerate(contacts):
            threshold = e.ramps(p)[3].full().ravel()
            room = np.abs(threshold - np.array(e.directions) * u[i]).min()  # to the nearest kink
            rows.append(np.abs(slope[[i]] @ vectors) / max(room, 1e-300))
    # without contacts only a constant remains: the system is linear up to the nearest kink
    remainder = system.parts(contact=True).remainder
    if not any(remainder.jac_sparsity(0, i).nnz() for i in range(3)):
        return np.vstack(rows), PROVED
    rows.append(np.abs(vectors) / (TINY * smallest * scale)[:, None])
    return np.vstack(rows), SMALL


def _contacts(system: System) -> ca.Function:
    """Return (x, p) -> the contacts' arguments and their derivative in the state."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    q, v = x[: system.n], system.ode(x, p)[: system.n]
    u = ca.vertcat(*(e.argument(q, v, p) for e in system.elements if e.ramps is not None))
    return ca.Function("contacts", [x, p], [ca.densify(u), ca.densify(ca.jacobian(u, x))])


def distances(x: Array, cycle: Array, scale: Array) -> Array:
    """Return the distance of states from a closed curve, in units of the scale.

    Parameters
    ----------
    x : ndarray, shape (k, n_states)
    cycle : ndarray, shape (N + 1, n_states)
        Its points, whose neighbours are joined by straight lines.
    scale : ndarray, shape (n_states,)

    Returns
    -------
    ndarray, shape (k,)
        Root mean square over the states.
    """
    a, y = cycle[:-1] / scale, x / scale
    edge = np.diff(cycle / scale, axis=0)
    length = np.maximum((edge**2).sum(axis=1), 1e-300)
    along = y @ edge.T - (a * edge).sum(axis=1)
    share = np.clip(along / length, 0.0, 1.0)
    square = (y**2).sum(axis=1)[:, None] + (a**2).sum(axis=1) - 2 * y @ a.T - 2 * share * along + share**2 * length
    return np.asarray(np.sqrt(np.maximum(square.min(axis=1), 0.0) / x.shape[1]))


def steps_for(system: System, starts: Sequence[tuple[Place, Array]]) -> int:
    """Return a number of steps per period with which motions at all places are integrated accurately.

    Parameters
    ----------
    system : System
    starts : sequence of (Place, ndarray of shape (n_states,))
        Places, and the farthest state from the equilibrium at each.
    """
    wanted = 0.0
    for place, farthest in starts:
        around = place.samples[:, :: PHASES // 32].reshape(-1, system.n_states)
        x = np.vstack([place.equilibrium, place.equilibrium + farthest, *around])
        A = np.array([system.state_matrix(state, place.p) for state in x])
        wanted = max(wanted, place.period * float(np.abs(np.linalg.eigvals(A)).max()) / STEP_TIMES_EIGENVALUE)
    return next((s for s in STEPS if s >= wanted), STEPS[-1])


# --- motions ----------------------------------------------------------------------------------


def decide(
    system: System,
    place: Place,
    x: Array,
    duration: float,
    steps: int,
    stopped: Callable[[], bool] = lambda: False,
) -> Ends:
    """Follow motions until they are decided or the time is over.

    Parameters
    ----------
    system : System
    place : Place
    x : ndarray, shape (motions, n_states)
        Where they start.
    duration : float, s
        Rounded up to whole periods of the place.
    steps : int
        Steps per period of the place.
    stopped : callable
        Called after every period; tells whether to give up.
    """
    count, looks = len(x), int(np.ceil(duration / place.period * (1 - 1e-12)))
    outcome, reason = np.full(count, "undecided", dtype="<U9"), np.full(count, OVER, dtype=object)
    exact: NDArray[np.bool_] = (system.ode(x.T, place.p).full() == 0).all(axis=0)
    time, cycle = np.full(count, looks * place.period), np.full(count, -1)
    active, states = np.arange(count), x.copy()
    before = np.zeros((count, len(place.samples)))
    for k in range(looks + 1):
        y = states[active]
        lost = np.asarray(~(np.abs(y) < TOO_LARGE).all(axis=1), dtype=bool)
        y = np.where(lost[:, None], 0.0, y)
        away = [distances(y, c, place.scale) for c in place.samples]
        far = np.column_stack(away) if away else np.empty((len(y), 0))
        coming = far < np.maximum(before[active], 0.1 * place.near) if k else np.zeros(far.shape, dtype=bool)
        settled = (far < place.near) & coming & ~lost[:, None]
        before[active] = far
        rest, on_cycle = (_at_rest(place, y) | exact[active]) & ~lost, settled.any(axis=1)
        done = lost | rest | on_cycle
        outcome[active[rest]], outcome[active[on_cycle]] = "rest", "cycle"
        reason[active[lost]], reason[active[on_cycle]] = GROWN, SETTLED
        reason[active[rest]] = np.where(exact[active[rest]], EXACT, place.proof)
        cycle[active[on_cycle]] = settled[on_cycle].argmax(axis=1) if away else -1
        time[active[done]] = k * place.period
        active = active[~done]
        if not len(active) or k == looks or stopped():
            break
        states[active] = _advanced(system, place, states[active], steps)
    return Ends(outcome, time, cycle, reason.astype(str))


def _at_rest(place: Place, x: Array) -> NDArray[np.bool_]:
    """Tell which motions stay inside all limits for ever, because the moduli of their modes only decrease."""
    if place.modes is None:
        return np.zeros(len(x), dtype=bool)
    modes = np.abs((x - place.equilibrium) @ place.modes.T)
    return np.asarray((modes @ place.reach.T < 1).all(axis=1))


def _advanced(system: System, place: Place, x: Array, steps: int) -> Array:
    """Return the states one period later, shape (motions, n_states)."""
    out, i = np.empty_like(x), 0
    while i < len(x):
        size = next(b for b in BATCHES if b <= len(x) - i)
        run = system.once(("follow", steps, size), lambda size=size: _periods(system, steps).map(size))  # type: ignore[misc]
        p = np.repeat(place.p[:, None], size, axis=1)
        out[i : i + size] = run(x[i : i + size].T, p, place.period / steps).full().T
        i += size
    return out


def _periods(system: System, steps: int) -> ca.Function:
    """Return (x, p, h) -> the state after the given number of steps of the classical Runge-Kutta method."""
    start, p, h = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters)), ca.SX.sym("h")
    x = start
    for _ in range(UNROLLED):
        x = runge_kutta_step(lambda y: system.ode(y, p), x, h)
    few = ca.Function("few", [start, p, h], [x], {"cse": True})
    return few.fold(steps // UNROLLED)
