"""Motions from many states, and the cycles near which they recur."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hbbogie import fourier
from hbbogie.branches.confirming import by_harmonics, come_to
from hbbogie.branches.same import BLOCKS, in_one_turn, of_prime_period, signature
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.rest import angles_of
from hbbogie.errors import ModelError
from hbbogie.methods.size import has_many_states
from hbbogie.model.system import System
from hbbogie.model.turns import changed, turns_of
from hbbogie.motion.integration import PART, initial_state, states_after, states_in_steps
from hbbogie.results import Orbit, Trajectory
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.periodic import FourierSeries
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.sparse_transitions import radius
from hbbogie.stability.verification import verify

Array = NDArray[np.float64]
CHUNK, CHUNKS = 500, 8  # samples between two looks at a motion, and looks
LONG = 40  # looks where many states, of bodies coupled weakly, take hundreds of periods to move in step
PER_PERIOD = 40  # samples of a period of the linear motion
TOLERANCE = 1e-7  # of the integration
STEPPED = 30  # states beyond which steps of a fixed length take less time than those of CVODES
MOST_STEPS = 16  # of a fixed length between the first samples; systems that need more are stiff
SMALL = 1e-3  # range of a motion at rest, relative to the size of the states
NEAR = 0.1  # distance from an equilibrium, likewise, beyond which a motion that hardly moves is not at rest
RECURS = 0.01  # distance of a recurrence from closed, relative to the range
NEARLY = 0.1  # the same of many states, where Newton's method leads on to the cycle
LIKE = 0.03  # distance of means and extremes up to which a motion is near a known cycle, relative to its range
AT_REST = 1e-2  # range of a state of many, relative to the largest, up to which it counts as none
CLOSER = 3.0, 2.0  # a recurrence is another candidate when it is closer by so much, of few states and of many
TURN = 2 * np.pi
STATES = (Trajectory, Mapping, np.ndarray)  # types of what gives a state
HARMONICS = 255  # of the recurrence, at most
AROUND, FINE = 4, 200  # samples on each side of a recurrence, and places looked at between two of them
PIECES, BRIEF = 60, 200  # of a motion whose integration fails, shorter and shorter ones, and steps of each at most
GROWN = 30.0  # size of a state, in units of its own, at which such a motion is about to leave every bound
STOPPED, STEEP = 1e-9, 100.0  # share of the time in which it gets no further, and growth of the rates until then
CANDIDATES = 6  # samples near which the end of a motion may be met before
ONE_RETURN = 1e-3  # distance of a return from closed that makes it a period, whether or not later ones are closer


@dataclass(frozen=True, eq=False)
class Recurrence:
    """What a motion has come to.

    Attributes
    ----------
    kind : {"cycle", "known", "rest", "running", "undecided", "unbounded", "singular"}
        A motion is "singular" where it ends in finite time, as where an equation divides by zero.
    orbit : Orbit or None
        Its last recurrence.
    after : float, s
    turns : tuple of (str, float)
        Of a running motion: the angle that grows or falls by a turn, and in which time [s].
    state : ndarray, shape (n_states,), or None
        Of an undecided motion: the last one.
    """

    kind: str
    orbit: Orbit | None
    after: float
    turns: tuple[str, float] = ("", 0.0)
    state: Array | None = None


def sample_distance(eigenvalues: NDArray[np.complex128]) -> float:
    """Return the distance of samples [s] that resolves the least damped oscillation about the equilibria."""
    turning = eigenvalues[np.abs(eigenvalues.imag) > 1e-3 * np.abs(eigenvalues)]
    if len(turning):
        rate = abs(turning[np.argmax(turning.real / np.abs(turning))].imag)
    else:
        sizes = np.abs(eigenvalues[np.abs(eigenvalues) > 0])
        rate = float(np.median(sizes)) if len(sizes) else 1.0
    return float(2 * np.pi / rate / PER_PERIOD)


def state_of(system: System, start: Start) -> Array:
    """Return the state of a start, shape (n_states,)."""
    if isinstance(start, Orbit | Trajectory | Mapping):
        return initial_state(system, start)[1]
    x = np.zeros(system.n_states)
    try:
        given = np.asarray(start, dtype=float).ravel()
        if len(given) not in (system.n, system.n_states):
            raise ValueError
        x[: len(given)] = given
    except (TypeError, ValueError):
        raise ModelError(
            f"start: got {start!r}; give a state of {system.n} or {system.n_states} numbers, values by name, a "
            "trajectory, an orbit or a special point."
        ) from None
    return x


def cycle_after(system: System, start: Start) -> Orbit:
    """Return the cycle that the motion from a state comes to, polished; in a family of cycles one near the state.

    Parameters
    ----------
    system : System
        At whose values.
    start : Orbit, Trajectory, mapping from name to value or sequence of float
        The state; a mapping names velocities with a prime, and what it does not name is zero.

    Raises
    ------
    ConvergenceError
        Where it comes to rest, leaves every bound or is undecided.
    """
    x = state_of(system, start)
    kind, orbit = "undecided", None
    h = sample_distance(np.linalg.eigvals(system.state_matrix(x, system.vector())).astype(complex))
    size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max(initial=1e-300))
    for met in recurrences(system, x, h, size, []):
        kind, orbit = met.kind, met.orbit
        if has_many_states(system) and orbit is not None and (cycle := come_to(system, orbit, AT_REST)) is not None:
            return of_prime_period(cycle, turns_of(system.dynamics))
    if orbit is None or kind in ("rest", "unbounded"):
        ends = {"rest": "comes to rest", "unbounded": "leaves every bound"}
        raise ConvergenceError(
            f"the motion from the start {ends.get(kind, 'has not come back to itself')}: there is no cycle to begin "
            "with. What to try: another state, or a cycle of find_cycles."
        )
    if has_many_states(system):
        return of_prime_period(by_harmonics(system, orbit), turns_of(system.dynamics))
    checked = verify(system, orbit)
    found = of_prime_period(checked.orbit, turns_of(system.dynamics))
    return found if checked.isolated else found.replace(stability=floquet(system, found))


def recurrences(system: System, x: Array, h: float, size: Array, known: list[Array]) -> Iterator[Recurrence]:
    """Follow a motion until it rests, recurs or is given up; yield each closer recurrence that is not known.

    Parameters
    ----------
    system : System
        At whose values.
    x : ndarray, shape (n_states,)
        Where it begins.
    h : float, s
        Distance of the samples to begin with.
    size : ndarray, shape (n_states,)
        Size of the states.
    known : list of ndarray
        Signatures of known cycles (see `signature`); may grow meanwhile.
    """
    p, elapsed = system.vector(), 0.0
    turns = np.append(turns_of(system.dynamics), np.zeros(system.n_states - system.n))
    many = has_many_states(system)
    least = AT_REST if many else 0.0  # what hardly moves, far from what does, need not come back
    orbit: Orbit | None = None
    closest, rate = NEARLY if many else RECURS, _rate(system, x, p, h) if system.n_states > STEPPED else np.inf
    most = MOST_STEPS if many else np.inf  # of few states the looks are few
    for _ in range(LONG if many else CHUNKS):
        if time_is_over():
            break
        try:
            later = states_in_steps(system, x, p, h, CHUNK, rate, most) if rate < np.inf else None
            states = np.vstack([x, states_after(system, x, p, h, CHUNK, TOLERANCE) if later is None else later])
        except ConvergenceError:
            kind = _lost(system, x, p, h, size)
            yield Recurrence(kind, orbit if kind == "undecided" else None, elapsed)
            return
        if not np.isfinite(states).all() or (np.abs(states) > 1e6 * size).any():
            yield Recurrence("unbounded", None, elapsed)
            return
        x, elapsed = states[-1], elapsed + CHUNK * h
        late = states[CHUNK // 2 :]
        spread = np.ptp(late, axis=0)
        calm = (spread <= SMALL * size).all()
        calm = calm and (np.ptp(states[-CHUNK // 4 :], axis=0) <= 0.9 * spread + 1e-9 * size).all()
        if calm and _near_equilibrium(system, x, p, size):
            yield Recurrence("rest", None, elapsed)
            return
        if not turns.any() and (running := _running(system, states, h)) is not None:
            yield Recurrence("running", None, elapsed, running)
            return
        spread = np.where(turns, np.minimum(spread, turns), spread)
        found = _recurrence(states, np.maximum(spread, least * spread.max()), turns, NEARLY if many else ONE_RETURN)
        if found is None:
            h *= 2
            continue
        back, gap = found
        advance = _whole(x - states[round(len(states) - 1 - back)], turns)[: system.n]
        rounds = np.abs(advance / np.where(advance, turns[: system.n], 1.0)).max(initial=1.0)
        if back < 12 * rounds:
            h /= 4
            continue
        if gap <= closest:
            closest = gap / CLOSER[many]
            if advance.any() and changed(system.dynamics, advance):  # angles that turn together have not
                continue
            orbit = _orbit(system, states, back, h, advance)
            width = np.tile(np.maximum(spread[: system.n], 1e-9 * size[: system.n]), BLOCKS)
            if any(_alike(signature(orbit), other, width) for other in known):
                yield Recurrence("known", orbit, elapsed)
                return
            yield Recurrence("cycle", orbit, elapsed, state=x)
        if back > CHUNK // 4:
            h *= 2
    yield Recurrence("undecided", orbit, elapsed, state=x)


def _rate(system: System, x: Array, p: Array, h: float) -> float:
    """Return the largest modulus of the eigenvalues at a state and at rest [1/s].

    Infinite where there are none, and where fixed steps would be many between samples at a distance of h [s].
    """
    matrices = (system.ode_jacobian(at, p).sparse().tocsr() for at in (x, np.zeros(len(x))))
    rate = max(radius(matrix) if np.isfinite(matrix.data).all() else np.inf for matrix in matrices)
    return rate if h * rate <= MOST_STEPS * PART else np.inf


def _lost(system: System, x: Array, p: Array, h: float, size: Array) -> str:
    """Return what kind of motion cannot be followed over a time: "unbounded", "singular" or "undecided"."""
    whole = piece = CHUNK * h
    rate = first = _speed(system, x, p, size)
    for _ in range(PIECES):
        try:
            there = states_after(system, x, p, piece, 1, TOLERANCE, BRIEF)[0]
        except ConvergenceError:
            if piece <= STOPPED * whole:
                return "singular" if rate > STEEP * first else "undecided"
            piece /= 4
            continue
        if not np.isfinite(there).all() or (np.abs(there) > GROWN * size).any():
            return "unbounded"
        x, rate = there, _speed(system, there, p, size)
    return "undecided"


def _speed(system: System, x: Array, p: Array, size: Array) -> float:
    return float(np.abs(system.ode(x, p).full().ravel() / size).max())


def _running(system: System, states: Array, h: float) -> tuple[str, float] | None:
    """Return an angle that goes on by a turn while all else comes back, and the time of a turn; None without one."""
    far = np.abs(states[0] - states[-1])[: system.n] >= 3 * TURN
    for i in np.flatnonzero(far & (angles_of(system) > 0)) if far.any() else ():
        back = np.abs(states[:, i] - states[-1, i])
        k = int(np.flatnonzero(back >= TURN)[-1])  # the last sample a turn ago
        if len(states) - k < 12:
            continue
        share = (back[k] - TURN) / (back[k] - back[k + 1])
        then = states[k] + share * (states[k + 1] - states[k])
        others = np.arange(len(then)) != i
        away = np.abs(states[-1] - then)[others]
        moving = np.maximum(np.ptp(states[k:], axis=0), np.abs(states[k:]).max(axis=0))[others]
        if (away <= RECURS * moving).all():
            return system.coordinate_names[i], float((len(states) - 1 - k - share) * h)
    return None


def _alike(mark: Array, known: Array, width: Array) -> bool:
    """Tell whether a recurrence is near a known cycle, run through once or several times."""
    times, last = known[0] / mark[0], len(width) // BLOCKS
    whole = max(1, round(times))
    off = np.abs(np.append(mark[1:-last], mark[-last:] / whole) - known[1:])  # an angle advances each time
    return bool(abs(times / whole - 1) < LIKE and (off < LIKE * width).all())


def _near_equilibrium(system: System, x: Array, p: Array, size: Array) -> bool:
    """Tell whether a Newton step to an equilibrium is small; on the slow part of a relaxation cycle it is not."""
    try:
        step = np.linalg.lstsq(system.state_matrix(x, p), system.ode(x, p).full().ravel(), rcond=1e-12)[0]
    except (ConvergenceError, np.linalg.LinAlgError):
        return True
    return bool((np.abs(step) <= NEAR * size).all())


def _whole(difference: Array, turns: Array) -> Array:
    """Return the whole turns nearest to a difference of states, shape and unit of the difference."""
    return np.asarray(turns * np.round(difference / np.where(turns, turns, np.inf)) + 0.0)


def _recurrence(states: Array, spread: Array, turns: Array, enough: float) -> tuple[float, float] | None:
    """Return after how many samples the end of a motion was met before, and how closely, relative to the ranges.

    A state is met where angles are whole turns away, too. The first return that is close ``enough`` counts.
    """
    wide = np.where(spread > 1e-9 * spread.max(), spread, np.inf)
    away_by = states[::-1] - states[-1]
    distance = np.sqrt((((away_by - _whole(away_by, turns)) / wide) ** 2).sum(axis=1))
    away = np.flatnonzero(distance > 0.25)
    if not len(away):
        return None
    d = distance[away[0] :]
    low = 1 + np.flatnonzero((d[1:-1] <= d[:-2]) & (d[1:-1] < d[2:]))
    if not len(low):
        return None
    last = len(states) - 1
    lowest = np.sort(low[np.argsort(d[low])[:CANDIDATES]]) + int(away[0])
    shifts = (states[-1] + _whole(states[last - k] - states[-1], turns) for k in lowest)
    returns = [_closest(states / wide, last - k, end / wide) for k, end in zip(lowest, shifts, strict=True)]
    near = max(2 * min(gap for _, gap in returns), enough)
    # the first return is a period, later ones are several
    place, gap = next(r for r in returns if r[1] <= near)
    return last - place, gap


def _closest(samples: Array, k: int, end: Array) -> tuple[float, float]:
    """Return where between the samples around one of them the last one is met most closely, and how closely.

    The samples lie on a cubic: their distance is too long for a straight line where a motion is not smooth.
    """
    around = np.arange(max(0, k - AROUND), min(len(samples) - 1, k + AROUND) + 1)
    places = k + np.linspace(-1, 1, 2 * FINE + 1)
    gaps = np.linalg.norm(CubicSpline(around, samples[around])(places) - end, axis=1)
    closest = int(np.argmin(gaps))
    return float(places[closest]), float(gaps[closest])


def _orbit(system: System, states: Array, back: float, h: float, advance: Array) -> Orbit:
    """Return the last period of sampled states as an orbit, made to close but for its advance."""
    count = len(states) - 1
    first = max(0, int(count - back) - 3)
    spline = CubicSpline(np.arange(first, count + 1), states[first:, : system.n])
    H = int(np.clip(back / 4, 15, HARMONICS))
    N = 8 * (H + 1)
    share = np.arange(N) / N
    q = spline(count - back + back * share)
    q = q - share[:, None] * advance
    q = q - (share - 0.5)[:, None] * (states[-1, : system.n] - spline(count - back) - advance)
    found = Orbit(
        system=system.name,
        coordinates=system.coordinate_names,
        naming=system.naming,
        units=tuple(c.unit for c in system.coordinates),
        motion=FourierSeries(fourier.analysis(H, N) @ q),
        omega=2 * np.pi / (back * h),
        parameters=dict(system.values),
        method="integration",
        status="a recurrence of a simulated motion",
        advance=tuple(advance.tolist()) if advance.any() else (),
    )
    return in_one_turn(system, found)
