"""Basins of attraction: motions from many initial states at many parameter values, and where each ends."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.attraction.endings import Ends, Place, decide, place_of, states_of, steps_for
from hbbogie.branches.comparison import shown_coordinates
from hbbogie.branches.crossing import branches_from_hopf, crossings
from hbbogie.branches.judging import stability_of
from hbbogie.branches.same import once_each
from hbbogie.errors import ModelError, door, positive
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.ranges import default_reach
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.motion.integration import initial_state
from hbbogie.parallel.pool import worker_pool
from hbbogie.parallel.processes import LOOK, interruptions, told_to_stop
from hbbogie.progress import Progress, silent
from hbbogie.results import Basin, Branch, Orbit
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
HARMONICS = 31  # highest harmonic of the cycles with which motions are compared
PERIODS = 130  # for which a motion is followed by default
MOTIONS = 32  # in one task; one call of the mapped integrator advances them all


@door(system=System, parameter=str)
def find_basin(
    system: System,
    parameter: str,
    values: ArrayLike,
    factors: ArrayLike,
    *,
    along: Mapping[str, float] | None = None,
    duration: float | None = None,
    branches: Sequence[Branch] | None = None,
    workers: int = 1,
    progress: Progress = silent,
) -> Basin:
    """Determine how motions end: at rest, on a stable cycle, or undecided.

    Parameters
    ----------
    system : System
    parameter : str
    values : array_like, shape (values,), unit of the parameter
    factors : array_like, shape (factors,)
        Each factor multiplies the direction, which gives the initial displacement from the equilibrium.
    along : mapping from name to value, unit of the coordinate (with a prime: per second), optional
        The direction. With ``{"q1": 1, "q3": 1}`` and factors in m, two coordinates are released from the same
        displacement. The default is the state at phase 0 on the smallest unstable cycle at each value, or at the
        nearest value that has one. The boundary of the basin along this direction is then at factor 1.
    duration : float, s, optional
        Longest time for which a motion is followed; by default 130 periods.
    branches : sequence of Branch, optional
        The cycles over the parameter; by default they are traced from its Hopf points.
    workers : int
        Number of processes. With more than 1, a script has to guard its code by ``if __name__ == "__main__":``.
    progress : callable
        Called with (message, fraction done or None).

    Returns
    -------
    Basin
        A motion that cannot be followed is "undecided", with a reason.

    Raises
    ------
    ModelError
        For invalid names or values, or if there is no unstable cycle that could give the direction.

    Notes
    -----
    Motions are advanced by the classical Runge-Kutta method with at least 256 steps per period, and checked once per
    period.

    *Rest* is proved if the equilibrium is linearly stable and the system is linear except for gaps. With the
    eigenvectors v_i and the motion at x = x_0 + sum_i c_i v_i, the argument u = w . x of every contact obeys abs(u -
    u_0) <= sum_i abs(c_i w . v_i) from then on, as long as no kink is met. If this sum is smaller than the distance to
    the nearest kink, no kink is ever met, and the motion decays (eq-rest). In a system with another nonlinearity,
    "rest" means that the same sum has fallen, for every state, below a thousandth of the smallest cycle.

    *Cycle* means that the state is near a stable cycle, closer than a fiftieth of its size and a fifth of its distance
    from the next cycle, and was farther away one period earlier.
    """
    system.parameter(parameter)
    V, f = _increasing("values", values), _increasing("factors", factors)
    name, start = check(system, along, duration, workers)
    notes: list[str] = []
    if branches is None:
        progress("tracing the cycles", None)
        middle = system.with_parameters(**{parameter: float(np.median(V))})
        reach = default_reach(middle, parameter)
        branches = branches_from_hopf(_equations(system), parameter, reach)
    cycles = _cycles(system, parameter, V, branches, notes, progress)
    everywhere = [o for some in cycles for o in some]
    at = [system.with_parameters(**{parameter: float(v)}) for v in V]
    places = [_place(s, parameter, some, everywhere, notes) for s, some in zip(at, cycles, strict=True)]
    unstable = np.array([min(_peaks(some, "unstable", name), default=np.nan) for some in cycles])
    if start is None:
        text = "the state at phase 0 on the smallest unstable cycle, relative to the equilibrium"
        nearest = _nearest(parameter, V, unstable, name)
        shapes = np.array([_shape(system, cycles[k], places[k], name) for k in nearest])
        amplitudes = np.abs(f) * unstable[nearest][:, None]
    else:
        text = ", ".join(f"{key} = {value:g}" for key, value in (along or {}).items())
        shapes = np.tile(start, (len(V), 1))
        amplitudes = np.tile(np.abs(f * start[system.index(name)]), (len(V), 1))
    longest = [duration or PERIODS * (place.period if place else 0.0) for place in places]
    steps = steps_for(system, [(place, np.abs(f).max() * x) for place, x in zip(places, shapes, strict=True) if place])
    ends = _ends(_Job(system, places, longest, steps), shapes, f, int(workers), progress)
    stable = [_peaks(some, "stable", name) for some in cycles]  # in the order of the places
    at_rest = np.where(ends.outcome == "rest", 0.0, np.nan)
    peaks = np.array(
        [[some[k] if k >= 0 else np.nan for k in row] for some, row in zip(stable, ends.cycle, strict=True)]
    )
    return Basin(
        system=system.name,
        parameter=parameter,
        parameter_unit=system.parameter(parameter).unit,
        values=V,
        coordinate=name,
        unit=system.coordinates[system.index(name)].unit,
        factors=f,
        amplitudes=amplitudes,
        direction=text,
        outcome=ends.outcome,
        time=ends.time,
        reached=np.where(ends.outcome == "cycle", peaks, at_rest),
        reason=ends.reason,
        unstable=unstable,
        stable=np.array([max(some, default=np.nan) for some in stable]),
        parameters={key: value for key, value in system.values.items() if key != parameter},
        notes=tuple(dict.fromkeys(notes)),
        attractor=_attractors(system, cycles, ends.cycle) if system.groups else None,
    )


def _attractors(system: System, cycles: Sequence[Sequence[Orbit]], reached: NDArray[np.int_]) -> NDArray[np.str_]:
    """Return what moves on the cycle that each motion reaches, "" where it reaches none."""
    names = [[moving_groups(system, o) for o in some if o.verdict == "stable"] for some in cycles]
    return np.array(
        [[own[k] if k >= 0 else "" for k in row] for own, row in zip(names, reached, strict=True)], dtype=str
    )


def _increasing(name: str, given: ArrayLike) -> Array:
    """Return increasing numbers; raise `ModelError` for anything else."""
    x = np.atleast_1d(np.asarray(given, dtype=float))
    if x.ndim != 1 or not len(x) or not np.isfinite(x).all() or (np.diff(x) <= 0).any():
        raise ModelError(f"{name}: got {np.array2string(x, threshold=8)}; give finite numbers in increasing order.")
    return x


def check(
    system: System, along: Mapping[str, float] | None, duration: float | None, workers: int
) -> tuple[str, Array | None]:
    """Check the arguments of `find_basin`.

    Parameters
    ----------
    system, along, duration, workers
        As in `find_basin`.

    Returns
    -------
    name : str
        The coordinate in which amplitudes are given.
    start : ndarray, shape (n_states,), or None
        The state for factor 1 if a direction is given.

    Raises
    ------
    ModelError
        For invalid input.
    """
    if duration is not None:
        positive("duration", duration, "s")
    if int(workers) != workers or workers < 1:
        raise ModelError(f"workers: got {workers!r}; give a whole number of processes, 1 or more.")
    if along is None:
        return shown_coordinates(system)[0], None
    start = initial_state(system, along)[1]
    moved = [key for key in along if key in system.coordinate_names and along[key] != 0]
    if not moved:
        raise ModelError(
            f"along: got {dict(along)!r}; give at least one coordinate that is displaced, such as "
            f"{{{system.coordinate_names[0]!r}: 1}}."
        )
    return moved[0], start


def _equations(system: System) -> Equations:
    return HarmonicBalance(HARMONICS).equations(system)


def _cycles(
    system: System, parameter: str, V: Array, branches: Sequence[Branch], notes: list[str], progress: Progress
) -> list[list[Orbit]]:
    """Return the cycles at each value, in order of amplitude, with their stability."""
    equations, found = _equations(system), []
    for i, value in enumerate(V):
        progress(f"cycles: {parameter} = {value:.5g}", i / len(V))
        here: list[Orbit] = []
        for branch in branches:
            try:
                here += crossings(equations, branch, float(value))
            except (ModelError, ConvergenceError) as error:
                notes.append(f"Cycles at {parameter} = {value:g}: {error}")
        found.append([o.replace(stability=stability_of(system, o)) for o in once_each(here)])
    return found


def _place(
    system: System, parameter: str, cycles: Sequence[Orbit], others: Sequence[Orbit], notes: list[str]
) -> Place | None:
    """Return what decides how motions end; None, and a note, if there is no equilibrium."""
    try:
        return place_of(system, parameter, cycles, others)
    except ConvergenceError as error:
        notes.append(str(error))
        return None


def _peaks(cycles: Sequence[Orbit], verdict: str, name: str) -> list[float]:
    """Return the peaks of a coordinate on the cycles with one verdict, in their order."""
    return [o.amplitude(name) for o in cycles if o.stability is not None and o.stability.verdict == verdict]


def _nearest(parameter: str, V: Array, unstable: Array, name: str) -> NDArray[np.int_]:
    """Return for each value the place of the nearest one with an unstable cycle."""
    there = np.flatnonzero(np.isfinite(unstable))
    if not len(there):
        raise ModelError(
            f"no unstable cycle was found at any value of {parameter} from {V[0]:g} to {V[-1]:g} that could give "
            f"the initial states; give a direction, along={{{name!r}: 1}} (--along {name}=1), or other values."
        )
    return there[np.argmin(np.abs(V[:, None] - V[there]), axis=1)]


def _shape(system: System, cycles: Sequence[Orbit], place: Place | None, name: str) -> Array:
    """Return the state at phase 0 on the smallest unstable cycle, relative to the equilibrium, shape (n_states,)."""
    unstable = [o for o in cycles if o.stability is not None and o.stability.verdict == "unstable"]
    rest = place.equilibrium if place else 0.0
    return np.asarray(states_of(system, min(unstable, key=lambda o: o.amplitude(name)), 1)[0] - rest)


# --- processes --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Job:
    """The data of every task: the system, the places, the longest time at each [s], and the steps per period."""

    system: System
    places: list[Place | None]
    longest: list[float]
    steps: int

    def run(self, i: int, x: Array, stopped: Callable[[], bool] = lambda: False) -> Ends:
        """Follow the motions that start at x, relative to the equilibrium, at the place i."""
        place = self.places[i]
        if place is None:
            return _failed(len(x), "no equilibrium was found")
        try:
            return decide(self.system, place, place.equilibrium + x, self.longest[i], self.steps, stopped)
        except (RuntimeError, np.linalg.LinAlgError) as error:
            return _failed(len(x), str(error))


def _failed(count: int, reason: str) -> Ends:
    return Ends(np.full(count, "undecided"), np.zeros(count), np.full(count, -1), np.full(count, reason))


def _ends(job: _Job, shapes: Array, factors: Array, workers: int, progress: Progress) -> Ends:
    """Return how all motions end, each array of shape (values, factors)."""
    cuts = range(0, len(factors), MOTIONS)
    tasks = [(i, slice(k, k + MOTIONS)) for i in range(len(shapes)) for k in cuts]
    starts = [np.outer(factors[part], shapes[i]) for i, part in tasks]
    done: list[Ends | None] = [None] * len(tasks)
    run = _in_processes if workers > 1 else _in_turn
    progress("following motions", 0.0)
    for count, (k, ends) in enumerate(run(job, [i for i, _ in tasks], starts, min(workers, len(tasks)))):
        done[k] = ends
        progress("following motions", (count + 1) / len(tasks))
    kept = [ends or _failed(len(x), "the process that followed it ended") for ends, x in zip(done, starts, strict=True)]
    grid = (len(shapes), len(factors))
    fields = (np.concatenate([getattr(e, name) for e in kept]) for name in ("outcome", "time", "cycle", "reason"))
    return Ends(*(field.reshape(grid) for field in fields))


def _in_turn(job: _Job, at: Sequence[int], starts: Sequence[Array], workers: int) -> Iterator[tuple[int, Ends]]:
    for k, (i, x) in enumerate(zip(at, starts, strict=True)):
        yield k, job.run(i, x)


@functools.lru_cache(maxsize=1)
def _unpacked(payload: bytes) -> _Job:
    job: _Job = pickle.loads(payload)
    return job


def _task(payload: bytes, i: int, x: Array) -> Ends:
    if told_to_stop():
        raise CancelledError
    return _unpacked(payload).run(i, x, told_to_stop)


def _in_processes(job: _Job, at: Sequence[int], starts: Sequence[Array], workers: int) -> Iterator[tuple[int, Ends]]:
    """Yield the ends of the motions of each finished task. Tasks that a broken process did not finish are left out."""
    payload = pickle.dumps(job)
    with interruptions() as pressed, worker_pool(workers) as pool:
        futures = {pool.submit(_task, payload, i, x): k for k, (i, x) in enumerate(zip(at, starts, strict=True))}
        waiting = set(futures)
        try:
            while waiting and not pressed():
                finished, waiting = wait(waiting, LOOK, FIRST_COMPLETED)
                for future in finished:
                    if not isinstance(future.exception(), BrokenProcessPool):
                        yield futures[future], future.result()
        finally:  # running motions end at their next check, or at once after a second Ctrl-C
            pool.stop()
            while waiting and pressed() < 2:
                waiting = wait(waiting, LOOK).not_done
            if waiting:
                pool.kill()
        if pressed():
            raise KeyboardInterrupt
