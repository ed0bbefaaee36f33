"""Where a motion settles: to a cycle, to rest, or undecided; and its last period as an orbit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.brief import brief
from hbbogie.deadline import time_is_over
from hbbogie.errors import ModelError, door, positive
from hbbogie.model.system import System
from hbbogie.motion.integration import Initial, default_step, simulate
from hbbogie.results import Orbit, Trajectory
from hbbogie.results.periodic import FourierSeries

Array = NDArray[np.float64]

BESIDE = 0.1  # if elements jump, maybe at the mean, periods are marked this far from it, relative to the range


@dataclass(frozen=True, eq=False, kw_only=True)
class Settled:
    """Where a motion settled.

    Attributes
    ----------
    kind : {"cycle", "rest", "undecided"}
    omega : float, rad/s
        Frequency of the cycle; NaN if there is none.
    amplitudes : dict
        Largest absolute value of each coordinate over the last period, or over the last stretch if there is no cycle.
    trajectory : Trajectory
        The last stretch of the motion; for a cycle, its last periods.
    status : str
        A sentence on how it was decided.
    """

    kind: str
    omega: float
    amplitudes: dict[str, float]
    trajectory: Trajectory
    status: str

    __repr__ = brief


@door(system=System, coordinate=str)
def settle(
    system: System,
    initial: Initial,
    *,
    coordinate: str | None = None,
    tolerance: float = 1e-5,
    chunk: float = 2.0,
    longest: float = 120.0,
    method: str = "rk4",
    step: float | None = None,
    **parameters: float,
) -> Settled:
    """Integrate until the motion is periodic or at rest, or until the time is over.

    Parameters
    ----------
    system : System
    initial : mapping, Orbit or Trajectory
        As in `simulate`.
    coordinate : str
        The coordinate whose upward crossings of its mean mark the periods. If elements jump, a level beside the mean is
        taken. By default the first nonlinear coordinate.
    tolerance : float
        Distance from the limit at which the motion counts as settled, relative to the range of the motion.
    chunk : float, s
        Time between two checks of the motion. It is lengthened if it contains too few periods.
    longest : float, s
        The motion is "undecided" when it has not settled by then.
    method, step, **parameters
        As in `simulate`.

    Returns
    -------
    Settled

    Raises
    ------
    ModelError, ConvergenceError
        As in `simulate`.

    Notes
    -----
    *Cycle.* Near a weakly attracting cycle successive changes are small long before the limit is reached. Positions,
    speed and period at the crossings of the second half of the motion are therefore averaged in four blocks. With D the
    last change between blocks and R < 1 the largest ratio of successive changes, D R / (1 - R) is the change still to
    come. Either it must be within the tolerance, or the changes must be below a third of the tolerance and show no
    trend. The latter is the case if contacts fall between the samples, so that crossings scatter without drifting. A
    motion whose crossings scatter by more than a thousandth of the range is not called a cycle (it may be a torus).

    *Rest.* Either the range of every state has fallen to the tolerance, relative to its largest value, or the motion
    decays at the rate and the frequency of the least damped eigenvalue of the linearised system. In the latter case
    nothing nonlinear is left to stop the decay.
    """
    names = system.nonlinear_coordinates or system.coordinate_names
    watch = _Watch(system, coordinate if coordinate is not None else names[0], tolerance, parameters)
    chunk, longest = positive("chunk", chunk, "s"), positive("longest", longest, "s")
    step = default_step(system, system.vector(**parameters)) if step is None else positive("step", step, "s")
    elapsed, state = 0.0, initial
    while True:
        remaining = longest - elapsed
        length = remaining if remaining < 1.5 * chunk else chunk  # no last piece shorter than a period
        piece = simulate(system, state, length, method=method, step=step, **parameters)
        elapsed, state = elapsed + length, piece
        kind, why = watch.judge(piece)
        if kind != "undecided" or longest - elapsed < 0.5 * step:
            break
        if time_is_over():
            why = f"the time limit was reached; {why}"
            break
        if watch.seen < 4 * watch.turns:
            chunk *= 2
    if kind == "cycle" and piece.t[-1] - piece.t[0] < 2.5 * watch.period:  # too short to contain a whole period
        piece = simulate(system, piece, 2.5 * watch.period, method=method, step=step, **parameters)
    since = piece.t[-1] - watch.period if kind == "cycle" else None
    amplitudes = {c: piece.amplitude(c, since=since) for c in piece.coordinates}
    omega = 2 * np.pi / watch.period if kind == "cycle" else float("nan")
    hint = "; give a larger `longest`, or a better initial state" if kind == "undecided" else ""
    return Settled(
        kind=kind,
        omega=omega,
        amplitudes=amplitudes,
        trajectory=piece,
        status=f"{kind} after {elapsed:g} s: {why}{hint}.",
    )


class _Watch:
    """The upward crossings of a motion that arrives in pieces, and the decision whether it has settled."""

    def __init__(self, system: System, coordinate: str, tolerance: float, parameters: Mapping[str, float]):
        self.i, self.name = system.index(coordinate), coordinate
        self.tolerance = positive("tolerance", tolerance, "1")
        self.system, self.p = system, system.vector(**parameters)
        self.beside = BESIDE if any(e.heights is not None for e in system.elements) else 0.0
        self.level, self.period = float("nan"), float("nan")
        self.seen, self.turns = 0, 1  # crossings in the last piece and in a period
        self.times, self.states = np.empty(0), np.empty((0, system.n + 1))  # s; all q, one v
        self.largest = np.zeros(2 * system.n)

    def judge(self, piece: Trajectory) -> tuple[str, str]:
        """Add the next piece of the motion; return "cycle", "rest" or "undecided", and the reason."""
        ranges = np.ptp(np.hstack([piece.q, piece.v]), axis=0)
        self.largest = np.maximum(self.largest, ranges)
        floor = 1e-13 * self.largest.max()  # a state that moves only by rounding
        if (ranges <= np.maximum(self.tolerance * self.largest, floor)).all():
            return "rest", f"every state's range has fallen to {self.tolerance:g} of its largest"
        self._collect(piece, ranges[self.i])
        if self._decays(piece):
            return "rest", "the motion decays as the linearised system does"
        n = self.system.n
        return self._converged(np.maximum(ranges, 1e-9 * ranges.max())[[*range(n), n + self.i]])

    def _collect(self, piece: Trajectory, span: float) -> None:
        """Add the crossings of the piece; start again if their level has moved by a twentieth of the range."""
        last = piece.crossings(self.name)[-2:]
        cycle = piece.at(np.linspace(last[0], last[1], 256, endpoint=False))[0] if len(last) == 2 else piece.q
        level = float(cycle[:, self.i].mean()) + self.beside * span
        if not abs(level - self.level) <= 0.05 * span:
            self.level = level
            self.times, self.states = self.times[:0], self.states[:0]
        times = piece.crossings(self.name, self.level)
        q, v = piece.at(times)
        self.seen = len(times)
        self.times, self.states = np.r_[self.times, times], np.vstack([self.states, np.c_[q, v[:, self.i]]])

    def _decays(self, piece: Trajectory) -> bool:
        """Tell whether the last crossings decay like the least damped mode of the linearised system."""
        times, speed = self.times[-9:], self.states[-9:, -1]
        if len(times) < 9 or speed[-1] >= speed[0] or speed.min() <= 0:
            return False
        x = np.zeros(self.system.n_states)
        x[: self.system.n] = piece.at(np.linspace(times[-2], times[-1], 256, endpoint=False))[0].mean(axis=0)
        eigenvalues = np.linalg.eigvals(self.system.state_matrix(x, self.p))
        mode = eigenvalues[np.argmax(eigenvalues.real)]
        rate, omega = np.diff(np.log(speed)) / np.diff(times), 2 * np.pi / np.diff(times)
        close = np.abs(rate - mode.real) < 0.01 * abs(mode.real)
        return bool(mode.real < 0 and close.all() and (np.abs(omega - abs(mode.imag)) < 1e-3 * omega).all())

    def _converged(self, scale: Array) -> tuple[str, str]:
        """Judge the second half of the crossings; scale, shape (n + 1,), contains the range of their columns."""
        self.turns = m = Trajectory.recurrence(self.states / scale) if len(self.times) > 1 else 1
        L = m * (max(0, len(self.times) - m) // (8 * m))
        if L == 0 or self.seen <= 2 * m:
            return "undecided", f"{self.name!r} crossed its mean only {len(self.times)} times"
        periods = self.times[m:] - self.times[:-m]
        self.period = float(periods[-L:].mean())
        rows = np.c_[self.states[m:] / scale, periods / self.period]
        blocks = rows[-4 * L :].reshape(4, L, -1).mean(axis=1)
        change = np.abs(np.diff(blocks, axis=0)).max(axis=1)
        ratio = float((change[1:] / np.maximum(change[:-1], np.finfo(float).tiny)).max())
        left = float(change[2] * ratio / (1 - ratio)) if ratio < 1 else np.inf
        scatter = float(np.abs(rows[-2 * L :] - rows[-2 * L - m : -m]).max())
        repeat = f"crossings repeat to {scatter:.1g} of the range"
        if scatter < 1e-3 and max(left, change[2]) < self.tolerance:
            return "cycle", f"by extrapolation {left:.1g} of the range away from the limit, and {repeat}"
        drifts = np.abs(blocks[3] - blocks[0]).max() > 1.2 * change.max()
        small = self.tolerance / (3 if 3 * m <= L else 100)
        if scatter < 1e-3 and change.max() < small and not drifts:
            return "cycle", f"{repeat} and do not drift"
        trend = f"are by extrapolation {left:.1g} of it away from the limit" if ratio < 1 else "do not come closer"
        return "undecided", f"successive crossings differ by {scatter:.1g} of the range and {trend}"


def last_orbit(system: System, trajectory: Trajectory, H: int, coordinate: str | None = None) -> Orbit:
    """Return the last period of a motion as an orbit, by Fourier projection.

    Parameters
    ----------
    system : System
    trajectory : Trajectory
        Settled on a cycle.
    H : int
        Highest harmonic.
    coordinate : str, optional
        The coordinate whose crossings mark the period; by default the first nonlinear one.

    Returns
    -------
    Orbit
        The time origin is where the first harmonic of that coordinate has its peak. The `residual` is the largest
        distance between both ends of the period, relative to the range.

    Raises
    ------
    ModelError
        When the motion contains no whole period, or H is not a whole number above 0.
    """
    if int(H) != H or H < 1:
        raise ModelError(f"highest harmonic H: got {H!r}; give a whole number, 1 or more.")
    name = coordinate or (system.nonlinear_coordinates or system.coordinate_names)[0]
    T, end = trajectory.period(name), trajectory.t[-1]
    samples = max(512, 8 * int(H))
    q = trajectory.at(end - T + T * np.arange(samples + 1) / samples)[0]
    c = fourier.analysis(int(H), samples) @ q[:-1]
    cosine, sine = c[1:3, system.index(name)]
    closure = float((np.abs(q[-1] - q[0]) / np.maximum(np.ptp(q, axis=0), np.finfo(float).tiny)).max())
    return Orbit(
        system=system.name,
        coordinates=trajectory.coordinates,
        naming=trajectory.naming,
        units=trajectory.units,
        motion=FourierSeries(fourier.shift(c, float(np.arctan2(sine, cosine)))),
        omega=2 * np.pi / T,
        parameters=dict(trajectory.parameters),
        method="integration",
        residual=closure,
        status=f"last period before {end:g} s ({trajectory.method}); its ends differ by {closure:.1g} of the range",
    )
