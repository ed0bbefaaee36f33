"""Starting points of exact cycles: the grazing of a Hopf point's linear cycles, or an orbit of another method."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import ModelError, door
from hbbogie.exact.batch import Fold
from hbbogie.exact.closing import Closing, Frame
from hbbogie.exact.model import SwitchedLinear, switched_linear
from hbbogie.exact.multipliers import stabilities
from hbbogie.exact.passing import sequence_passed
from hbbogie.exact.points import Point, correct, unit
from hbbogie.exact.sequence import Sequence
from hbbogie.exact.touching import consistent, depths, repaired
from hbbogie.exact.walk import SHORT
from hbbogie.model.system import System
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.results.linear_phases import LinearPhases
from hbbogie.stability.variation import Waveforms, check_orbit

Array = NDArray[np.float64]

SAMPLES = 2048  # samples per period in the search for crossings of an orbit
REPAIRS = 12  # largest number of corrections of the sequence
SMALLEST = 1e-6  # smallest scale of a state, relative to the largest of its kind


def frame_of(model: SwitchedLinear, states: Array, omega: float, p: Array, place: int) -> Frame:
    """Return the scales of a cycle with known states, shape (any number, n), and frequency [rad/s]."""
    size, positions = np.abs(states).max(axis=0), np.arange(states.shape[1]) < model.system.n
    for group in (positions, ~positions):
        size[group] = np.maximum(size[group], SMALLEST * size[group].max(initial=0.0))
    size = np.append(np.where(size > 0, size, 1.0), 1.0)
    rows = np.abs(model.matrices(np.zeros((1, len(model.surfaces))), p[None])[1][0])
    return Frame(size[None], np.array([omega]), (rows[:, :-1] @ size[:-1])[None], np.array([abs(p[place]) or 1.0]))


@door(system=System, hopf=SpecialPoint)
def at_grazing(system: System, hopf: SpecialPoint) -> Point:
    """Return the first cycle of a Hopf point's branch: the linear cycle that just touches a surface.

    Raises
    ------
    ModelError
        When the system is not linear between switchings.
    ConvergenceError
        When the linear cycles of the Hopf point touch nothing.
    """
    model = switched_linear(system)
    orbit, place = hopf.orbit, system.parameter_names.index(hopf.parameter)
    p = system.vector(**orbit.parameters)
    second = [i for i, s in enumerate(system.second_order) if s]
    mode = orbit.coefficients[1] - 1j * orbit.coefficients[2]
    mode = np.append(mode, 1j * orbit.omega * mode[second])
    rest = np.concatenate([orbit.coefficients[0], np.zeros(len(second)), [1.0]])
    sides, rows = _sides_at(model, rest, p)
    reach, room = rows[:, :-1] @ mode, rows @ rest
    with np.errstate(divide="ignore"):
        factor = np.where((np.abs(reach) > 0) & (room != 0), np.abs(room) / np.abs(reach), np.inf)
    k = int(np.argmin(factor))
    if not np.isfinite(factor[k]):
        raise ConvergenceError(
            f"system {system.name!r}: the linear cycles of the Hopf point at {hopf.parameter} = {hopf.value:g} touch "
            "no contact, or rest on one; no branch of cycles in closed form begins here."
        )
    x: Array = rest[:-1] + (factor[k] * mode * np.exp(1j * (np.angle(-room[k]) - np.angle(reach[k])))).real
    sigma = -1 if model.symmetric and not np.any(rest[:-1]) else 1
    touched = tuple(bool(s != (j == k)) for j, s in enumerate(sides))
    sequence = Sequence((tuple(map(bool, sides)), touched), (k, k), sigma)
    states = np.abs(rest[None, :-1]) + factor[k] * np.abs(mode)[None]
    closing = Closing(model, sequence, p[None], place, frame_of(model, states, orbit.omega, p, place))
    frame = closing.frame
    y = np.concatenate([sigma * x / frame.state[0, :-1], [np.pi if sigma < 0 else 2 * np.pi, 0.0, 0.0]])
    y[-1] = hopf.value / frame.parameter[0]
    point, _ = correct(closing, y, unit(len(y), len(y) - 2))
    if point is None:
        raise ConvergenceError(
            f"system {system.name!r}: no cycle was found where those of the Hopf point at {hopf.parameter} = "
            f"{hopf.value:g} first touch {model.surfaces[k].name!r}."
        )
    ahead = point.y + SHORT * unit(len(y), len(y) - 2)
    near, _ = correct(closing, ahead, unit(len(y), len(y) - 2))
    along = 0.0 if near is None else float(near.tangent[-1] * np.sign(near.tangent[-2]))
    return replace(point, tangent=point.tangent * np.sign(point.tangent[-2]), kind="grazing", along=along)


def _sides_at(model: SwitchedLinear, x: Array, p: Array) -> tuple[Array, Array]:
    """Return the contact state at a state, shape (K,), and the surfaces there, shape (K, N)."""
    sides = np.zeros(len(model.surfaces))
    for _ in range(len(sides) + 1):  # surfaces may themselves depend on the contact state
        rows = model.matrices(sides[None], p[None])[1][0]
        new = (rows @ x > 0).astype(float)
        if (new == sides).all():
            break
        sides = new
    return sides, rows


@door(system=System, orbit=Orbit, parameter=str)
def exact_cycle(system: System, orbit: Orbit, parameter: str, *, free: bool = False) -> Point:
    """Return the exact cycle near an orbit of another method.

    Parameters
    ----------
    system : System
    orbit : Orbit
    parameter : str
        The parameter that is an unknown of the equations.
    free : bool
        Whether this parameter is solved for as well, which gives the cycle nearest to the orbit in all unknowns. In a
        conservative system a damping parameter then becomes 0, for a cycle of that size.

    Raises
    ------
    ModelError
        When the system is not linear between switchings, or the orbit is not one of its cycles.
    ConvergenceError
        When no sequence of contacts agrees with the motion.
    """
    model = switched_linear(system)
    check_orbit(system, orbit)
    if orbit.advance:
        raise ModelError(
            f"system {system.name!r}: a coordinate runs on in the orbit, and cycles in closed form do not; take "
            "HarmonicBalance, or Collocation where the system is smooth."
        )
    if not orbit.H:
        raise ModelError("exact_cycle: the orbit is an equilibrium; give a cycle.")
    place = system.parameter_names.index(system.parameter(parameter).name)
    p = system.vector(**orbit.parameters)
    sigma = -1 if model.symmetric and orbit.is_odd() else 1
    waveforms = Waveforms(system, [orbit], p[None])
    sequence, begin, h = _sequence_along(model, waveforms, sigma)
    frame = frame_of(model, waveforms.all_states.at(fourier.phases(256)), orbit.omega, p, place)
    x = waveforms.all_states.at(np.array([begin]))[0]
    y = np.concatenate([x / frame.state[0, :-1], h, [p[place] / frame.parameter[0]]])
    return settled(Closing(model, sequence, p[None], place, frame), y, free)


def _sequence_along(model: SwitchedLinear, waveforms: Waveforms, sigma: int) -> tuple[Sequence, float, Array]:
    """Return the sequence along an orbit, the phase at which it begins [rad] and the durations [rad]."""
    level = [s.level for s in model.surfaces]
    tau = fourier.phases(max(SAMPLES, 16 * waveforms.H))
    d = waveforms.depth(tau)[:, level]
    after = np.roll(d, -1, axis=0)
    j, k = np.nonzero((d > 0) != (after > 0))
    if not len(j):
        raise ConvergenceError(
            f"system {waveforms.system.name!r}: the orbit crosses no surface at which a law changes its line. It "
            "is a cycle of a linear system; give one that reaches a contact."
        )
    when = tau[j] + (tau[1] - tau[0]) * d[j, k] / (d[j, k] - after[j, k])
    order = np.argsort(when, kind="stable")
    when, k = when[order], k[order]
    first = int(np.argmax(np.diff(np.append(when, when[0] + 2 * np.pi))))
    when, k = np.roll(when, -first), np.roll(k, -first)
    when = when + 2 * np.pi * (when < when[0])
    span = np.pi if sigma < 0 else 2 * np.pi
    inside = when[1:] < when[0] + span - 0.5 * (tau[1] - tau[0])
    last = int(k[0]) if model.mirror is None or sigma > 0 else int(model.mirror[k[0]])
    ends = np.concatenate([when[:1], when[1:][inside], [when[0] + span]])
    events = (*(int(e) for e in k[1:][inside]), last)
    middle = waveforms.depth(0.5 * (ends[1:] + ends[:-1]))[:, level] > 0
    sequence = Sequence(tuple(tuple(map(bool, m)) for m in middle), events, sigma)
    return sequence, float(when[0]), np.diff(ends)


def settled(closing: Closing, y: Array, free: bool = False) -> Point:
    """Return the cycle at the given parameter, or one near the guess, in the sequence that agrees with the motion.

    The sequence is corrected by local rules; where these lead nowhere it is taken from one pass through the motion.
    """
    point = _by_rules(closing, y, free)
    if point is None:
        passed = sequence_passed(closing, y)
        if passed is not None:
            point = _by_rules(replace(closing, sequence=passed[0]), passed[1], free)
    if point is None:
        raise ConvergenceError(
            f"system {closing.model.system.name!r}: no sequence of contacts was found that agrees with the motion near "
            "the guess; give a guess with more harmonics, or other parameters."
        )
    return point


def _by_rules(closing: Closing, y: Array, free: bool) -> Point | None:
    for _ in range(REPAIRS):
        normal = np.linalg.svd(closing.linearise(y[None]).J[0])[2][-1] if free else unit(len(y), len(y) - 1)
        point, _ = correct(closing, y, normal)
        if point is None:
            return None
        found = depths(closing, point.y[None], point.at)
        if consistent(closing, point.y[None], point.at, found)[0]:
            return point
        changed = repaired(closing.sequence, point.y, closing.n, closing.model, point.at, found)
        if changed is None:
            return None
        closing, y = replace(closing, sequence=changed[0]), changed[1]
    return None


def cycle_of(point: Point | Fold) -> Orbit:
    """Return a point of a branch, or the fold of a design, as an orbit, its stability not judged."""
    closing, y, n = point.closing, point.y, point.closing.n
    sequence, frame, system = closing.sequence, closing.frame, closing.model.system
    p = closing.parameters(y[None])[0]
    A, _ = closing.model.matrices(sequence.states, np.repeat(p[None], len(sequence.states), axis=0))
    durations = y[n : n + sequence.S] / frame.rate[0]
    omega = 2 * np.pi / (durations.sum() * (2 if sequence.sigma < 0 else 1))
    motion = LinearPhases(
        system.n,
        sequence.sigma,
        np.array(sequence.sides),
        np.array(sequence.events),
        np.append(y[:n], 1.0) * frame.state[0],
        omega * durations,
        A[sequence.of] / omega,
    )
    return Orbit(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        motion,
        float(omega),
        dict(zip(system.parameter_names, map(float, p), strict=True)),
        "exact",
        status=f"cycle in closed form, {sequence.S} phases",
        naming=system.naming,
    )


def orbit_of(point: Point) -> Orbit:
    """Return a point of a branch as an orbit with multipliers and verdict, all of them exact."""
    stability = stabilities(point.closing, point.y[None], point.at)[0]
    return cycle_of(point).replace(residual=float(np.abs(point.at.F).max()), stability=stability)
