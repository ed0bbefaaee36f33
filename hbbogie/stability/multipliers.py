"""Stability of orbits: Floquet multipliers from the variational equations, and a verdict with its reason."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, door
from hbbogie.model.conserved import conserved_in_each, expression, state_names
from hbbogie.model.parts import is_odd
from hbbogie.model.system import System
from hbbogie.results import Orbit, Stability
from hbbogie.stability.jumps import passages_along
from hbbogie.stability.transitions import product, transitions_along
from hbbogie.stability.variation import Waveforms, check_orbit

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MARGIN = 5.0  # distance from the unit circle, in errors of the trivial multiplier, beyond which the side is certain
CANDIDATES = 0.3  # distance from 1 up to which a multiplier may be the trivial one
AT_REST = 1e-6  # smallest size of a state that counts, relative to the largest
ALIGNED = 0.999  # ratio of cosines of angles with the motion's direction above which they count as equal


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
        Runge-Kutta steps per period. By default, systems that are linear between switchings need none, since their
        exponentials are taken. Other systems take at least 256 steps, at least 10 for each harmonic, and enough to keep
        a step times the largest eigenvalue of the state matrix below 0.075. The number is rounded up to one of a few
        values.
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
    are mesh points, and inside an interval their slopes are those at its middle, so that no step straddles a kink. If A
    depends only on these slopes, it is constant between contact times, and the transition matrices are its exponentials
    (eq-phase-map). Otherwise each is one fourth-order Runge-Kutta step from the identity. Where an element jumps, the
    jump matrix (eq-jump) is a further factor. A motion that sticks there instead of passing is not followed, and the
    verdict is "unknown". A kink or jump that is written into the equations, as ``fmax`` or ``sign``, instead of as an
    element is not detected and costs accuracy. With the default steps, multipliers above 1e-4 have a relative error of
    about 1e-6 for the given orbit. The error of the orbit itself comes on top.

    One multiplier of a cycle is 1. The distance of the nearest computed multiplier from 1 measures the errors of the
    orbit and the integration together. The determinant measures the integration alone: the sum of log abs det over the
    intervals and the jumps must be the integral of the trace of A (Liouville) plus the logarithms of the jumps' known
    determinants. If either check fails, or if a multiplier lies closer to the unit circle than five times the trivial
    error, the verdict is "unknown". Multipliers below about 1e-12 are round-off.

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
) -> list[Stability]:
    """Return what `floquet` does of each of some orbits, as of a branch, in one batch."""
    found: dict[int, Stability] = {}
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
            waveforms = Waveforms(system, [orbits[k] for k in places], p[places])
            found |= zip(places, _judged(waveforms, steps, tolerance, halved), strict=True)
    return [found[k] for k in range(len(orbits))]


def _judged(waveforms: Waveforms, steps: int | None, tolerance: float, halved: bool) -> list[Stability]:
    """Return the verdicts on cycles."""
    system, p, sizes = waveforms.system, waveforms.p, _sizes(waveforms.all_states.size, waveforms.system.n)
    every, parts = np.arange(len(p)), 2 if halved else 1
    rates = system.ode(waveforms.all_states.at(np.zeros(len(p)), of=every).T, p.T).full().T
    conserved, names = conserved_in_each(system, p, sizes), state_names(system)
    found = []
    for k, along in enumerate(transitions_along(waveforms, steps, half=halved)):
        passages = passages_along(waveforms, along.mesh, k)
        transitions = passages.inserted(along.matrices)
        monodromy = product(transitions)
        if passages.obstacle or not np.isfinite(monodromy).all():
            overflow = f"the variational equations overflow in {len(transitions)} steps; take more steps"
            none = np.full(system.n_states, np.nan, dtype=complex)
            found.append(Stability("unknown", none, float("nan"), 0, f"{passages.obstacle or overflow}."))
            continue
        log_det = parts * float(np.linalg.slogdet(transitions)[1].sum())
        trace = parts * (along.trace + passages.log_determinant)
        motion = Motion(rates[k], sizes[k], conserved[k], names)
        found.append(judge(-monodromy if halved else monodromy, parts, log_det, trace, tolerance, motion))
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


# --- verdicts ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Motion:
    """What is known about a cycle besides its map.

    Attributes
    ----------
    rate : ndarray, shape (n_states,)
        dx/dt where the map begins: the direction of the trivial multiplier.
    size : ndarray, shape (n_states,)
        Size of each state.
    conserved : ndarray, shape (k, n_states)
        Rows w with w . x constant along every motion.
    names : tuple of str
        Of the states.
    """

    rate: Array
    size: Array
    conserved: Array
    names: tuple[str, ...]


def judge(
    matrix: Array, parts: int, log_det: float, trace: float, tolerance: float, motion: Motion | None = None
) -> Stability:
    """Return the verdict on a cycle from its map and from Liouville's formula.

    If linear quantities are conserved, there is one multiplier 1 for each of them, besides the trivial one. The cycle
    is then judged among motions with the same values of these quantities, by the map restricted to disturbances that do
    not change them.

    Parameters
    ----------
    matrix : ndarray, shape (n_states, n_states)
        The monodromy matrix (parts = 1), or G, whose square it is (parts = 2).
    parts : int
    log_det, trace : float
        Over the full period: log abs det accumulated over the mesh, and the integral of the trace.
    tolerance : float
        Largest error of the trivial multiplier, and of the logarithm of the determinant relative to its size.
    motion : Motion, optional
        Used to distinguish the trivial multiplier from others near 1.
    """
    k = 0 if motion is None else len(motion.conserved)
    level = np.eye(len(matrix))
    if motion is not None and k:  # an orthonormal basis of the disturbances that conserve, in states of size 1
        size = np.where(motion.size > 0, motion.size, 1.0)
        level = np.linalg.svd(motion.conserved * size)[2][k:].T
        matrix = level.T @ (matrix / size[:, None] * size) @ level
        level = size[:, None] * level
    values, vectors = np.linalg.eig(matrix)
    order = np.argsort(-np.abs(values), kind="stable")
    values, vectors = values[order].astype(complex), level @ vectors[:, order]
    trivial = int(np.argmin(np.abs(values - 1)))
    if motion is not None:
        trivial = trivial_of(values, vectors, motion.rate, motion.size)
    multipliers = values**parts
    error, liouville = float(abs(multipliers[trivial] - 1)), abs(log_det - trace) / max(1.0, abs(trace))
    doubt = ""
    if not error <= tolerance:
        doubt = (
            f"the multiplier nearest to 1 is {error:.2g} away from it, allowed is {tolerance:g}: the orbit is not "
            "accurate enough; take more harmonics or solve it to a smaller tolerance"
        )
        if np.sort(np.abs(values - 1))[:2].max() < 2 * abs(values[trivial] - 1):
            doubt += " (two are equally near: multipliers that meet at 1, in a conservative system or at a fold, "
            doubt += "err by the square root of the orbit's error)"
    elif not liouville <= tolerance:
        doubt = (
            f"the determinant is off (Liouville): its logarithm is {log_det:.6g}, the integral of the trace "
            f"{trace:.6g}; take more steps"
        )
    verdict, outside, reason = sides(multipliers, trivial, error, doubt)
    reason += f"; error of the trivial multiplier {error:.2g}, of the determinant {liouville:.2g}."
    if motion is not None and k:
        held = ", ".join(expression(row, motion.names) for row in motion.conserved)
        reason += f" Judged among motions with the same conserved values: {held} {'is' if k == 1 else 'are'} "
        reason += f"conserved, which gives {k} multiplier{'s' * (k > 1)} equal to 1."
    others = [i for i in range(len(values)) if i != trivial]
    critical = complex(multipliers[others[0]]) if others else None
    mode = _scaled(vectors[:, others[0]]) if others else None
    ones = np.ones(k, dtype=complex)
    values = np.concatenate([values, -ones if parts == 2 else ones])
    order = np.argsort(-np.abs(values), kind="stable")
    halves = values[order] if parts == 2 else None
    return Stability(verdict, values[order] ** parts, error, outside, reason, halves, critical, mode)


def trivial_of(values: Complex, vectors: Complex, rate: Array, size: Array) -> int:
    """Return the place of the trivial multiplier: of those near 1 the one whose vector is the motion's direction.

    Of a cycle that is not resolved another one may be nearer.

    Parameters
    ----------
    values : ndarray, shape (m,)
    vectors : ndarray, shape (n_states, m)
    rate, size : ndarray, shape (n_states,)
        dx/dt where the map begins, and the size of each state.
    """
    distance = np.abs(values - 1)
    near = np.flatnonzero(distance <= CANDIDATES)
    if len(near) < 2 or not np.isfinite(rate).all():
        return int(np.argmin(distance))
    size = np.where(size > 0, size, 1.0)
    along = np.abs((rate / size) @ (vectors[:, near] / size[:, None]))
    along /= np.linalg.norm(vectors[:, near] / size[:, None], axis=0)
    aligned = near[along >= ALIGNED * along.max()]  # where two vectors meet, at a fold, they have the same direction
    return int(aligned[np.argmin(distance[aligned])])


def sides(multipliers: Complex, trivial: int, error: float, doubt: str) -> tuple[str, int, str]:
    """Return the verdict, the number of multipliers outside the unit circle, and the beginning of the reason.

    Parameters
    ----------
    multipliers : ndarray, shape (n_states,)
    trivial : int
        The place of the trivial one.
    error : float
        Error of the multipliers near the unit circle. A multiplier closer to it than `MARGIN` times this error has no
        definite side.
    doubt : str
        Why the verdict is "unknown" whatever the multipliers are; empty if there is no such reason.
    """
    moduli, margin = np.abs(np.delete(multipliers, trivial)), max(MARGIN * error, 1e-8)
    outside, near = int((moduli > 1 + margin).sum()), int((np.abs(moduli - 1) <= margin).sum())
    largest = f"the largest {moduli.max(initial=0.0):.6g}"
    if doubt:
        return "unknown", outside, doubt
    if outside:
        return "unstable", outside, f"{outside} multiplier(s) outside the unit circle, {largest}"
    if near:
        reason = f"{near} multiplier(s) besides the trivial one within {margin:.2g} of the unit circle: "
        reason += "neutral as far as can be told (a conservative system or a bifurcation)"
        if ones := int((np.abs(np.delete(multipliers, trivial) - 1) <= margin).sum()):
            inside = float(moduli[moduli < 1 - margin].max(initial=0.0))
            reason += f"; {ones} at 1, as where something is conserved and cycles form a family"
            if ones == near:
                reason += f": among cycles of one level the largest is {inside:.6g}" if near < len(moduli) else ""
        return "unknown", 0, reason
    return "stable", 0, f"all multipliers but the trivial one inside the unit circle, {largest}"


def _scaled(vector: NDArray[Any]) -> Complex:
    """Return the vector scaled so that its largest entry is 1."""
    return np.asarray(vector / vector[np.argmax(np.abs(vector))], dtype=complex)


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
    return Stability(verdict, multipliers, 0.0, growing, reason, None, critical, _scaled(vectors[:, 0]))
