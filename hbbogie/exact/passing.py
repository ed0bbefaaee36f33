"""One pass through the motion from a state: it finds the sequence of contacts if local rules do not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hbbogie.exact.closing import Closing
from hbbogie.exact.sequence import Sequence, Sides, crossed
from hbbogie.exponential import exponentials

Array = NDArray[np.float64]

STEPS = 512  # samples over the span of a cycle
AHEAD = 32  # samples computed together
MOST = 60  # largest number of crossings
LATE = 0.3  # allowed error in the time of the cycle's last crossing, as a share of the span


def sequence_passed(closing: Closing, y: Array) -> tuple[Sequence, Array] | None:
    """Return the sequence of the motion from the start of a cycle, and the unknowns that belong to it.

    The motion is followed to its first crossing and from there for the span of the cycle. The result is None if the
    motion crosses nothing, sticks at a jump, or does not return to the surface at which it began.

    Parameters
    ----------
    closing : Closing
        Of one cycle; its sequence only tells whether the phases make up a whole period or half of one.
    y : ndarray, shape (m + 1,)
        The start, the span as sum of the durations, and the parameter.
    """
    n, S, model, sigma = closing.n, closing.sequence.S, closing.model, closing.sequence.sigma
    span = float(y[n : n + S].sum())
    times, events, sides, states = _crossings(closing, y, span)
    if len(times) < 2:
        return None
    first = events[0]
    last = first if sigma > 0 or model.mirror is None else int(model.mirror[first])
    late = [abs(t - times[0] - span) if k == last else np.inf for t, k in zip(times, events, strict=True)]
    end = int(np.argmin(late[1:])) + 1
    if not late[end] <= LATE * span:
        return None
    sequence = Sequence(tuple(sides[1 : end + 1]), tuple(events[1 : end + 1]), sigma)
    if not sequence.closes(model):
        return None
    return sequence, np.concatenate([states[0][:n], np.diff(times[: end + 1]), y[-1:]])


def _crossings(closing: Closing, y: Array, span: float) -> tuple[list[float], list[int], list[Sides], list[Array]]:
    """Return times, surfaces and states of the crossings, and the contact states before each and after the last."""
    x = np.append(y[: closing.n], 1.0)
    A, rows = _matrices(closing, y, closing.sequence.sides[0])
    here: Sides = tuple(map(bool, rows @ (x + 1e-9 * (A @ x)) > 0))
    t, dt = 0.0, span / STEPS
    times: list[float] = []
    events: list[int] = []
    sides, states = [here], list[Array]()
    while len(times) < MOST and t < (1 + LATE) * span + (times[0] if times else span):
        A, rows = _matrices(closing, y, here)
        rows = rows * (2 * np.array(here, dtype=float) - 1)[:, None]
        x, passed, k = _until_crossing(A, rows, x, dt)
        t += passed
        if k is None:
            continue
        beyond = crossed(here, k)
        A, rows = _matrices(closing, y, beyond)
        if not (rows[k] @ A @ x) * (1 if beyond[k] else -1) > 0:
            break  # the field beyond the surface leads back, so the motion sticks
        here = beyond
        times.append(t)
        events.append(k)
        sides.append(here)
        states.append(x)
    return times, events, sides, states


def _matrices(closing: Closing, y: Array, sides: Sides) -> tuple[Array, Array]:
    """Return the scaled state matrix, shape (N, N), and surfaces, shape (K, N), of one contact state."""
    A, rows = closing.model.matrices(np.array([sides], dtype=float), closing.parameters(y[None]))
    return A[0] * closing.frame.matrix_scale[0, 0], rows[0] * closing.frame.row_scale[0, 0]


def _until_crossing(A: Array, rows: Array, x: Array, dt: float) -> tuple[Array, float, int | None]:
    """Return state and time at the first negative depth ``rows @ x``, and its surface; or those after some steps."""
    E = _flow(A, dt)
    path = x[:, None]
    power = E
    while path.shape[1] < AHEAD:
        path, power = np.hstack([path, power @ path]), power @ power
    path = np.hstack([path, E @ path[:, -1:]])
    below = rows @ path[:, 1:] < 0
    if not below.any():
        return path[:, -1], AHEAD * dt, None
    j = int(np.argmax(below.any(axis=0)))
    found = [(_root(A, rows[k], path[:, j], dt), int(k)) for k in np.flatnonzero(below[:, j])]
    t, k = min(found)
    return _flow(A, t) @ path[:, j], j * dt + t, k


def _root(A: Array, row: Array, x: Array, dt: float) -> float:
    """Return when a depth that is negative after a step becomes negative, by safeguarded Newton steps."""
    low, high, t = 0.0, dt, 0.5 * dt
    for _ in range(60):
        here = _flow(A, t) @ x
        depth, rate = float(row @ here), float(row @ A @ here)
        low, high = (t, high) if depth > 0 else (low, t)
        new = t - depth / rate if rate else np.inf
        new = new if low < new < high else 0.5 * (low + high)
        if abs(new - t) <= 1e-13 * dt:
            break
        t = new
    return t


def _flow(A: Array, t: float) -> Array:
    return exponentials(A[None, None], np.zeros(1, dtype=int), np.array([[t]]))[-1][0, 0]
