"""Verification: a cycle polished by multiple shooting, and the true errors of the one it came from."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.brief import brief
from hbbogie.errors import ModelError, door, positive
from hbbogie.model.conserved import state_names
from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.results.failure import ConvergenceError
from hbbogie.stability.alignment import HARMONICS, aligned, coefficients_of
from hbbogie.stability.jumps import Passages, passages_along, passages_of
from hbbogie.stability.paths import TO_LEGENDRE, NewtonStep, Path, Pattern, states_at
from hbbogie.stability.shooting import SINGULAR, Shooting
from hbbogie.stability.transitions import product
from hbbogie.stability.variation import Waveforms, check_orbit
from hbbogie.stability.verdicts import Motion, judge

Array = NDArray[np.float64]

EITHER_SIDE = 1e-8  # rad; distance before and after the time of a contact at which it is tested
ATTEMPTS = 5  # orders of contacts tried
SAMPLES = 16  # intervals of an element in the search for contacts and peaks
TRUSTED = 1e-4  # largest error of the trivial multiplier and, relative to its size, of the logarithm of the determinant


@dataclass(frozen=True, eq=False)
class Verification:
    """A polished cycle, and the distance of the given cycle from it.

    Attributes
    ----------
    orbit : Orbit
        The polished cycle, in phase with the given one. Its frequency is as accurate as ``closure``.
    amplitudes : dict of float, unit of the coordinate
        Its peaks, without truncation.
    omega_error : float, rad/s
        Given frequency minus polished.
    amplitude_errors : dict of float, unit of the coordinate
        Given peak minus polished, by coordinate.
    waveform_error : float
        Largest distance of the two waveforms over the period, relative to the peak of the coordinate, or, where it
        runs on, to its growth in a period.
    defect : float
        Largest residual of the equations along the given waveform, relative to the largest of their linear terms.
    closure : float
        Largest relative jump of a state between neighbouring elements, each integrated again in two halves.
    trivial_error : float
        Distance of the nearest multiplier from 1.
    isolated : bool
        False if the cycle belongs to a continuous family. Its errors then mean little.
    status : str, a sentence
    """

    orbit: Orbit
    amplitudes: dict[str, float]
    omega_error: float
    amplitude_errors: dict[str, float]
    waveform_error: float
    defect: float
    closure: float
    trivial_error: float
    isolated: bool
    status: str

    __repr__ = brief

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers of the polished cycle, shape (n_states,), largest modulus first."""
        return self.orbit.stability.multipliers if self.orbit.stability else np.empty(0, dtype=complex)


@door(system=System, orbit=Orbit)
def verify(system: System, orbit: Orbit, *, tolerance: float = 1e-10) -> Verification:
    """Polish a cycle by multiple shooting and measure the errors of the given one.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle, stable or not, for example from `solve`. The parameter values are those of the orbit.
    tolerance : float
        Largest local error of the polished motion, relative to the size of each state.

    Returns
    -------
    Verification

    Raises
    ------
    ModelError
        When the orbit does not belong to the system, or is an equilibrium, or where shooting would take more than
        2 GB of memory.
    ConvergenceError
        When shooting does not converge from the orbit, or no order of contacts agrees with the motion.

    Notes
    -----
    The method is multiple shooting. The period is divided where contacts of piecewise-linear elements change their
    line. These times are unknowns, determined by the contacts' own conditions, and the motion is smooth between them.
    It is integrated by Gauss collocation of order 24, on elements so short that the last coefficients of their
    polynomials are below the tolerance. Newton's method solves for the durations and for the states between elements at
    once, so that it also converges to unstable and to stiff cycles. The monodromy matrix is the product of the
    elements' transition matrices. Afterwards every element is searched for contacts. If one was missed, the order of
    contacts is taken from the new motion. Where an element jumps, the motion must pass, and one that sticks raises a
    `ConvergenceError`. The monodromy matrix then contains the jump matrices (eq-jump). A kink that is not written as an
    element requires many collocation elements. A jump that is not written as an element raises a `ConvergenceError`.
    """
    _check(system, orbit)
    tolerance = positive("tolerance", tolerance, "1")
    try:
        shooting, path, step = _closed(system, orbit, tolerance)
    except ConvergenceError as error:
        waveforms = Waveforms(system, [orbit], system.vector(**orbit.parameters)[None])
        _check_passing(passages_along(waveforms, np.append(waveforms.switchings()[0], 2 * np.pi)), orbit, error)
        raise
    passages = passages_of(shooting, path)
    _check_passing(passages, orbit)
    halves = shooting.split(path, step.f, np.full(len(path.x), 2))
    closure = max(float(np.abs(shooting.gaps(halves)).max()), float(np.abs(step.off).max(initial=0.0)))
    omega = float(2 * np.pi / path.durations.sum())
    amplitudes = _peaks(shooting, path, step)
    ranges = np.ptp(_dense(shooting, path, step)[1][..., : system.n], axis=(0, 1))
    given = np.subtract(*orbit.extremes[::-1]) + np.abs(orbit.advance or 0.0)
    share = float((ranges / np.maximum(given, 1e-9 * given.max())).max())
    if share < 1e-2 or closure > max(1e3 * tolerance, 1e-9):
        reason = f"the motion has shrunk to {share:.2g} of the orbit" if share < 1e-2 else f"closed to {closure:.2g}"
        raise ConvergenceError(
            f"system {system.name!r}: shooting did not end on a cycle ({reason}); the orbit is too far from one, or "
            "there is none. Take more harmonics.",
            orbit=orbit,
        )
    coefficients, distance = aligned(shooting, path, step, orbit)
    isolated = shooting.isolation(path, step) > SINGULAR
    stability = _stability(shooting, path, step, passages)
    status = _status(path, shooting, closure, distance, isolated)
    changes = {"method": f"multiple shooting, {len(path.x)} elements", "residual": closure, "status": status}
    changes["naming"] = system.naming  # an orbit from a file does not know how outputs are measured
    polished = orbit.replace(coefficients=coefficients, omega=omega, stability=stability, **changes)
    amplitudes |= {c: polished.amplitude(c) for c, by in zip(orbit.coordinates, orbit.advance, strict=False) if by}
    errors = {c: orbit.amplitude(c) - amplitudes[c] for c in orbit.coordinates}
    numbers = (distance, defect(system, orbit), closure, stability.trivial_error)
    return Verification(polished, amplitudes, orbit.omega - omega, errors, *numbers, isolated, status)


def _check(system: System, orbit: Orbit) -> None:
    """Raise `ModelError` unless the orbit is a cycle of the system."""
    check_orbit(system, orbit)
    if not np.isfinite(orbit.coefficients).all():
        raise ModelError("the orbit has coefficients that are not finite; give a cycle that was solved for.")
    if not orbit.H or not (np.abs(orbit.coefficients[1:]).max() > 0 or orbit.advance):
        raise ModelError("the orbit is an equilibrium, so there is nothing to polish; give a cycle.")


def _check_passing(passages: Passages, orbit: Orbit, error: ConvergenceError | None = None) -> None:
    """Raise `ConvergenceError` where the motion sticks at a jump."""
    if passages.sticking:
        raise ConvergenceError(f"system {orbit.system!r}: {passages.sticking}.", orbit=orbit) from error


def _status(path: Path, shooting: Shooting, closure: float, distance: float, isolated: bool) -> str:
    contacts = len(shooting.pattern.contact)
    status = f"polished by shooting to {closure:.1e} on {len(path.x)} elements with {contacts} contact(s) located"
    if not isolated:
        status += "; not isolated: it belongs to a continuous family, as in a conservative system (or at a fold); "
        status += "one of its cycles was taken, and the errors against it mean little"
    if distance > 0.5:
        status += f"; the given orbit is far from it, {distance:.2g} of the peak"
    return status + "."


def defect(system: System, orbit: Orbit) -> float:
    """Return the largest residual of the equations of motion along an orbit's waveform.

    Each equation is taken relative to the largest of its linear terms over the period.
    """
    p = system.vector(**orbit.parameters)
    tau = fourier.phases(max(512, 32 * orbit.H))
    motion = [orbit.omega**k * orbit.at(tau, k) for k in range(3)]
    r = np.abs(system.residual(*(x.T for x in motion), p).full())
    matrices = [np.abs(m(p).full()) for m in reversed(system.linear)]
    size = np.max([(m[:, None] * np.abs(x)).max(axis=(1, 2)) for m, x in zip(matrices, motion, strict=True)], axis=0)
    return float((r.max(axis=1) / np.where(size > 0, size, 1.0)).max())


def pattern_of(waveforms: Waveforms) -> tuple[Pattern, NDArray[np.bool_]]:
    """Return the order of contacts along an orbit, and which ramps are active, shape (S, number of ramps)."""
    owner, levels = waveforms.model.owner, waveforms.model.direction * waveforms.threshold[0]
    contacts, values = waveforms.levels
    pairs = list(zip(contacts, values[0], strict=True))
    events: list[tuple[float, int, float]] = []
    for tau in waveforms.switchings()[0]:
        if events and tau - events[-1][0] < EITHER_SIDE:
            continue  # simultaneous contacts are all found at the first of them
        before, after = waveforms.u.at(tau + EITHER_SIDE * np.array([-1.0, 1.0]))
        events += [(tau, int(i), g) for i, g in pairs if (before[i] < g) != (after[i] < g)]
    starts = np.array([e[0] for e in events] or [0.0])
    lengths = np.diff(np.append(starts, starts[0] + 2 * np.pi))
    S, first = len(starts), int(np.argmax(lengths))
    state = waveforms.depth(starts[first] + lengths[first] / 2)[0] > 0
    active = np.tile(state, (S, 1))
    for k in range(first + 1, first + 1 + len(events)):  # once round, back to the beginning
        _, i, g = events[k % S]
        state = state ^ ((owner == i) & (levels == g))
        if k < first + S:
            active[k % S] = state
    if (state != active[first]).any():
        raise ConvergenceError(
            f"system {waveforms.system.name!r}: the contacts along the orbit do not close (one lasts less than "
            f"{EITHER_SIDE:g} rad, or grazes); take more harmonics."
        )
    contact, level = np.array([e[1] for e in events], dtype=int), np.array([e[2] for e in events])
    return Pattern(starts, lengths, contact, level, waveforms.lines_of(active)), active


def _closed(system: System, orbit: Orbit, tolerance: float) -> tuple[Shooting, Path, NewtonStep]:
    """Return the closed motion with an order of contacts that agrees with it."""
    guess, p = orbit, system.vector(**orbit.parameters)
    for _ in range(ATTEMPTS):
        waveforms = Waveforms(system, [guess], p[None])
        pattern, active = pattern_of(waveforms)
        shooting = Shooting(system, guess, pattern)
        path, step = shooting.close(tolerance)
        backwards = float(-(path.durations / path.durations.sum()).min())  # contacts in the wrong order
        wrong = max(_missed(shooting, waveforms, active, path, step), backwards)
        if wrong <= max(1e-9, 10 * tolerance):
            return shooting, path, step
        c = coefficients_of(shooting, path, step, 0.0, HARMONICS[0])
        guess = orbit.replace(coefficients=c, omega=float(2 * np.pi / path.durations.sum()))
    raise ConvergenceError(
        f"system {system.name!r}: no order of contacts agrees with its own motion (a contact is missed by "
        f"{wrong:.2g} of its range or of the period; grazing?). Take more harmonics, or other parameters.",
        orbit=orbit,
    )


def _dense(shooting: Shooting, path: Path, step: NewtonStep) -> tuple[Array, Array]:
    """Return sigma, shape (SAMPLES + 1,), and the states there, shape (N, SAMPLES + 1, n_states)."""
    N, sigma = len(path.x), np.linspace(0, 1, SAMPLES + 1)
    x = states_at(path, step.f, np.repeat(np.arange(N), len(sigma)), np.tile(sigma, N)) * shooting.scale
    return sigma, x.reshape(N, len(sigma), -1)


def _missed(shooting: Shooting, waveforms: Waveforms, active: NDArray[np.bool_], path: Path, step: NewtonStep) -> float:
    """Return how far a contact is on the wrong side of a level inside an element, relative to its range."""
    owner, direction, threshold = waveforms.model.owner, waveforms.model.direction, waveforms.threshold[0]
    if not len(owner):
        return 0.0
    sigma, x = _dense(shooting, path, step)
    lines = shooting.pattern.lines[np.repeat(path.segment, len(sigma))]
    u = shooting.arguments(x.reshape(-1, x.shape[-1]).T, lines.T, shooting.p)[0].full()
    u = u.reshape(-1, len(x), len(sigma))
    bend, rise = u[..., 2:] - 2 * u[..., 1:-1] + u[..., :-2], u[..., 2:] - u[..., :-2]
    inside = np.abs(rise) < 2 * np.abs(bend)  # the parabola through three samples has its extreme between them
    peak = u[..., 1:-1] - np.divide(rise**2, 8 * bend, out=np.zeros_like(bend), where=inside)
    span = np.maximum(np.abs(u).max(axis=(1, 2)), np.finfo(float).tiny)[owner]
    beyond = direction[:, None, None] * np.concatenate([u, peak], axis=-1)[owner] - threshold[:, None, None]
    wrong = np.where(active[path.segment].T[..., None], -beyond, beyond)
    return float((wrong.max(axis=(1, 2)) / span).max())


def _peaks(shooting: Shooting, path: Path, step: NewtonStep) -> dict[str, float]:
    """Return the largest absolute value of each coordinate, from the roots of its rate in the elements near it."""
    _, x = _dense(shooting, path, step)
    peaks = {}
    for i, name in enumerate(shooting.system.coordinate_names):
        largest = np.abs(x[..., i]).max(axis=1)
        found = float(largest.max())
        for e in {(int(np.argmax(largest)) + k) % len(x) for k in (-1, 0, 1)}:
            roots = legendre.legroots(legendre.legtrim(TO_LEGENDRE @ step.f[e, :, i]))
            roots = np.real(roots[(np.abs(np.imag(roots)) < 1e-9) & (np.abs(np.real(roots)) <= 1)])
            values = states_at(path, step.f, np.full(len(roots), e), (roots + 1) / 2)[:, i] * shooting.scale[i]
            found = max(found, float(np.abs(values).max(initial=0.0)))
        peaks[name] = found
    return peaks


def _stability(shooting: Shooting, path: Path, step: NewtonStep, passages: Passages) -> Stability:
    """Return multipliers and verdict from the transition matrices of the elements and those of the jumps."""
    if passages.corner:
        none = np.full(step.gap.shape[1], np.nan, dtype=complex)
        return Stability("unknown", none, float("nan"), 0, f"{passages.corner}.")
    transitions = passages.inserted(step.transitions)
    log_det, trace = float(np.linalg.slogdet(transitions)[1].sum()), shooting.trace(path) + passages.log_determinant
    size, system = shooting.scale, shooting.system
    motion = Motion(size * step.f[0, 0], size, shooting.held, state_names(system))
    matrix = size[:, None] * product(transitions) / size
    found = judge(matrix, 1, log_det, trace, TRUSTED, motion)
    return replace(found, mode=None)  # it belongs to the path's beginning and not to phase 0
