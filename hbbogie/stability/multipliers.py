"""Stability of orbits: Floquet multipliers from the variational equations, and a verdict with its reason."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door
from hbbogie.model.conserved import conserved_in_each, state_names
from hbbogie.model.parts import is_odd
from hbbogie.model.stacked import at_each
from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.stability.families import may_be_member, within_level
from hbbogie.stability.jumps import passages_along
from hbbogie.stability.transitions import product, transitions_along
from hbbogie.stability.variation import Waveforms, check_orbit
from hbbogie.stability.verdicts import Motion, judge, scaled

Array = NDArray[np.float64]

AT_REST = 1e-6  # smallest size of a state that counts, relative to the largest


@door(system=System, orbit=Orbit)
def floquet(
    system: System,
    orbit: Orbit,
    *,
    steps: int | None = None,
    tolerance: float = 1e-2,
    half: bool | None = None,
) -> Stability:
    """Return the Floquet multipliers of a cycle, or the eigenvalues of an equilibrium, and a verdict.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle, or an equilibrium (H = 0). The parameter values are those of the orbit.
    steps : int
        Elements per period, of equal length but for the contact times. By default, systems that are linear between
        switchings need none, since their exponentials are taken. Other systems begin with 32 elements, which are
        divided until the error of each is small. Systems of more than 64 states take Runge-Kutta steps: at least 256,
        at least 10 for each harmonic, and enough to keep a step times the largest eigenvalue of the state matrix below
        0.075.
    tolerance : float
        Largest error of the trivial multiplier, and largest error of the logarithm of the determinant
        relative to its size (or to 1), that are still trusted.
    half : bool
        Whether to integrate only half a period, for which system and orbit must be odd. This is the default if they are
        odd.

    Returns
    -------
    Stability
        For an equilibrium, the multipliers are the exponentials of the eigenvalues over one second.

    Raises
    ------
    ModelError
        When the orbit does not belong to the system, steps or tolerance are not acceptable, or half a period is
        requested but not sufficient.

    Notes
    -----
    The variational equations Phi' = A(t) Phi are integrated along the orbit's Fourier series over the intervals of a
    mesh. The product of the transition matrices is the monodromy matrix. The contact times of piecewise-linear elements
    are mesh points, and inside an interval their slopes are those at its middle, so that no interval straddles a kink.
    If A depends only on these slopes, it is constant between contact times, and the transition matrices are its
    exponentials (eq-phase-map). Otherwise each is that of Gauss collocation of order 12 from the identity, and its
    error is estimated from what is left of the equations between the Gauss points (eq-element-error). Where an element
    jumps, the jump matrix (eq-jump) is a further factor. A motion that sticks there instead of passing is not followed,
    and the verdict is "unknown". A kink that is written into the equations, as ``fmax``, instead of as an element takes
    many elements, and a jump, as ``sign``, is not detected. With the default elements, multipliers above 1e-4 have a
    relative error of about 1e-6 for the given orbit. The error of the orbit itself comes on top.

    One multiplier of a cycle is 1. The distance of the nearest computed multiplier from 1 measures the errors of the
    orbit and the integration together. The determinant measures the integration alone: the sum of log abs det over the
    intervals and the jumps must be the integral of the trace of A (Liouville) plus the logarithms of the jumps' known
    determinants. If either check fails, or if a multiplier lies closer to the unit circle than five times the trivial
    error, the verdict is "unknown". Multipliers below about 1e-12 are round-off.

    If something is conserved, a cycle is one of a family, and a further multiplier is 1. Where there is just one such
    multiplier, and another cycle of the family is found, the verdict is that among motions of one level, and the reason
    says so.

    When system and orbit are odd, q(t + T/2) = -q(t), half the period is enough (eq-half-period). The multipliers are
    the squares of those of G = -Phi(T/2), which are kept as well because they tell more. Besides the trivial one, +1, G
    has +1 at a fold and -1 at a pitchfork that breaks the symmetry. Over the full period both are +1. With G, the
    trivial multiplier of a pitchfork also remains separate from the critical one.
    """
    if not tolerance > 0:
        raise ModelError(f"tolerance: got {tolerance!r}; give a number above 0.")
    if steps is not None and not (isinstance(steps, int | np.integer) and steps >= 4):
        raise ModelError(f"steps: got {steps!r}; give a whole number, 4 or more.")
    return floquet_of_each(system, [orbit], steps=steps, tolerance=tolerance, half=half)[0]


def floquet_of_each(
    system: System,
    orbits: Sequence[Orbit],
    *,
    steps: int | None = None,
    tolerance: float = 1e-2,
    half: bool | None = None,
    level: bool = True,
) -> list[Stability]:
    """Return what `floquet` does of each of some orbits, as of a branch, in one batch.

    Cycles of a family are judged among motions of their level unless ``level`` is false, or most cycles are of none: a
    few of a branch are at folds.
    """
    found: dict[int, Stability] = {}
    held: dict[int, int] = {}
    cycles: dict[bool, list[int]] = {True: [], False: []}
    for orbit in orbits:
        check_orbit(system, orbit)
    p = np.array([system.vector(**orbit.parameters) for orbit in orbits])
    for k, orbit in enumerate(orbits):
        cycles[is_halved(system, orbit, half)].append(k)
        if orbit.H == 0:
            found[cycles[False].pop()] = _equilibrium(system, orbit, p[k], tolerance)
    for halved, places in cycles.items():
        if places:
            chosen = [orbits[k] for k in places]
            judged = _judged(Waveforms(system, chosen, p[places]), steps, tolerance, halved)
            for k, (stability, count) in zip(places, judged, strict=True):
                found[k], held[k] = stability, count
    members = [k for k in held if may_be_member(found[k], held[k])] if level else []
    if 2 * len(members) >= len(orbits):
        found |= {k: within_level(system, orbits[k], found[k], held[k]) for k in members}
    return [found[k] for k in range(len(orbits))]


def _judged(waveforms: Waveforms, steps: int | None, tolerance: float, halved: bool) -> list[tuple[Stability, int]]:
    """Return the verdicts on cycles, each with the number of linear quantities that are conserved."""
    system, p, sizes = waveforms.system, waveforms.p, _sizes(waveforms.all_states.size, waveforms.system.n)
    every, parts = np.arange(len(p)), 2 if halved else 1
    rates = at_each(system.once, system.ode, waveforms.all_states.at(np.zeros(len(p)), of=every), p)[..., 0]
    conserved, names = conserved_in_each(system, p, sizes), state_names(system)
    found = []
    for k, along in enumerate(transitions_along(waveforms, steps, half=halved)):
        passages = passages_along(waveforms, along.mesh, k)
        transitions = passages.inserted(along.matrices)
        monodromy = product(transitions)
        if passages.obstacle or not np.isfinite(monodromy).all():
            overflow = f"the variational equations overflow in {len(transitions)} steps; take more steps"
            none = np.full(system.n_states, np.nan, dtype=complex)
            found.append((Stability("unknown", none, float("nan"), 0, f"{passages.obstacle or overflow}."), 0))
            continue
        log_det = parts * float(np.linalg.slogdet(transitions)[1].sum())
        trace = parts * (along.trace + passages.log_determinant)
        motion = Motion(rates[k], sizes[k], conserved[k], names)
        judged = judge(-monodromy if halved else monodromy, parts, log_det, trace, tolerance, motion)
        found.append((judged, len(conserved[k])))
    return found


def _sizes(size: Array, n: int) -> Array:
    """Return sizes of the states, at least `AT_REST` of the largest: disturbances of a state at rest are not huge."""
    largest = [x.max(axis=1, keepdims=True, initial=0.0) for x in (size[:, :n], size[:, n:])]
    return np.maximum(size, AT_REST * np.repeat(np.hstack(largest), [n, size.shape[1] - n], axis=1))


def is_halved(system: System, orbit: Orbit, half: bool | None = None) -> bool:
    """Return whether half a period is to be integrated; raise `ModelError` if it is requested but not sufficient."""
    if half is False:
        return False
    odd = orbit.is_odd()
    if orbit.H == 0:
        why = "the orbit is an equilibrium"
    elif not (system.odd or (odd and is_odd(system.dynamics, system.vector(**orbit.parameters)))):
        why = f"the system {system.name!r} is not odd"
    elif not odd:
        why = "the orbit has a mean or even harmonics"
    else:
        return True
    if half:
        raise ModelError(f"half=True: {why}; half a period is enough for odd cycles of odd systems only. Leave it out.")
    return False


def _equilibrium(system: System, orbit: Orbit, p: Array, tolerance: float) -> Stability:
    """Return the verdict on an equilibrium from the real parts of its eigenvalues."""
    x = np.zeros(system.n_states)
    x[: system.n] = orbit.coefficients[0]
    A, rate = system.state_matrix(x, p), system.ode(x, p).full().ravel()
    eigenvalues, vectors = np.linalg.eig(A)
    order = np.argsort(-eigenvalues.real, kind="stable")
    eigenvalues, vectors = eigenvalues[order].astype(complex), vectors[:, order]
    margin = 1e-9 * float(np.abs(eigenvalues).max(initial=0.0))
    growing = int((eigenvalues.real > margin).sum())
    neutral = int((np.abs(eigenvalues.real) <= margin).sum())
    largest = f"largest real part {eigenvalues[0].real:.6g} 1/s"
    distance = float(np.abs(np.linalg.lstsq(A, rate, rcond=None)[0]).max())
    if distance > max(1e-12, tolerance * float(np.abs(x).max())):
        verdict = "unknown"
        reason = f"not an equilibrium: a Newton step would still move it by {distance:.2g}."
    elif growing:
        verdict, reason = "unstable", f"{growing} eigenvalue(s) in the right half plane, {largest}."
    elif neutral:
        verdict = "unknown"
        reason = f"{neutral} eigenvalue(s) on the imaginary axis, {largest}: neutral as far as can be told."
    else:
        verdict, reason = "stable", f"all eigenvalues in the left half plane, {largest}."
    with np.errstate(over="ignore"):  # a multiplier beyond the largest number is infinite and unstable
        multipliers = np.exp(eigenvalues)
    critical = complex(multipliers[0])
    return Stability(verdict, multipliers, 0.0, growing, reason, None, critical, scaled(vectors[:, 0]))
