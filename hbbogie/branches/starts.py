"""Equilibria at one value of a parameter, and the states from which motions are simulated there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.relatives import ODD
from hbbogie.methods.size import has_many_states
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.motion.integration import states_after
from hbbogie.results import Equilibria, Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.stability.multipliers import floquet

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
NUDGE = 1e-2  # along unstable directions, relative to the size of the states
DISPLACED = 1.25  # a group of bodies, relative to the size of the states
STATES = 24  # random states times states of the system
NEWTON = 20
LONGEST = 100  # periods in which a motion leaves a cycle
TOLERANCE = 1e-7  # of its integration
RANDOM = "a random state"


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """An equilibrium with its eigenvalues [1/s] and vectors, those of largest real part first."""

    x: Array
    eigenvalues: Complex
    vectors: Complex

    @property
    def unstable(self) -> int:
        """Number of eigenvalues in the right half plane."""
        return int((self.eigenvalues.real > 1e-9 * np.abs(self.eigenvalues)).sum())

    def text(self, names: tuple[str, ...]) -> str:
        """Return the equilibrium in a sentence."""
        values = ", ".join(f"{name} = {x:.6g}" for name, x in zip(names[:4], self.x, strict=False))
        shown = ", ".join(
            f"{v.real:.4g}" + (f" {'+' if v.imag > 0 else '-'} {abs(v.imag):.4g}i" if v.imag else "")
            for v in self.eigenvalues[:4]
        )
        more = "" if len(self.eigenvalues) <= 4 else f" and {len(self.eigenvalues) - 4} to their left"
        return f"equilibrium {values}{', ...' if len(names) > 4 else ''}: eigenvalues {shown}{more} 1/s"


def equilibria_at(system: System, branches: Equilibria, value: float) -> list[Equilibrium]:
    """Return the equilibria at a value of the parameter, where branches over it cross that."""
    found: list[Equilibrium] = []
    for branch in branches:
        V = branch.values
        for i in np.flatnonzero((V[:-1] - value) * (V[1:] - value) <= 0):
            a, b = branch.orbits[i], branch.orbits[i + 1]
            share = (value - V[i]) / (V[i + 1] - V[i]) if V[i + 1] != V[i] else 0.0
            q = (1 - share) * a.coefficients[0] + share * b.coefficients[0]
            at = equilibrium_near(system, q)
            if at is not None and not any(np.allclose(at.x, e.x, rtol=1e-7, atol=1e-10) for e in found):
                found.append(at)
    return found


def equilibrium_near(system: System, q: Array) -> Equilibrium | None:
    """Return the equilibrium to which Newton's method leads from coordinates at rest; None where to none."""
    x, p = np.append(q, np.zeros(system.n_states - system.n)), system.vector()
    try:
        for _ in range(NEWTON):
            with np.errstate(all="ignore"):
                step = np.linalg.lstsq(system.state_matrix(x, p), system.ode(x, p).full().ravel(), rcond=1e-12)[0]
            x = x - step
            if np.abs(step).max() <= 1e-12 * np.abs(x).max():
                break
        eigenvalues, vectors = np.linalg.eig(system.state_matrix(x, p))
    except (ConvergenceError, np.linalg.LinAlgError):
        return None
    order = np.argsort(-eigenvalues.real, kind="stable")
    return Equilibrium(x, eigenvalues[order].astype(complex), vectors[:, order])


def sizes(system: System, equilibria: list[Equilibrium], cycles: list[Orbit], amplitude: float) -> Array:
    """Return the size of each state, shape (n_states,): of cycles, equilibria, bounds, else the amplitude scale."""
    n, second = system.n, list(system.second_order)
    declared = [max((abs(b) for b in c.bounds if np.isfinite(b)), default=0.0) for c in system.coordinates]
    size = np.maximum(declared, 0.5 * turns_of(system.dynamics))
    for orbit in cycles:
        size = np.maximum(size, np.abs(orbit.coefficients).sum(axis=0))
    for e in equilibria:
        size = np.maximum(size, np.abs(e.x[:n]))
    size = np.where(size > 1e-9 * amplitude, size, amplitude)
    rates = [abs(e.eigenvalues.imag).max() for e in equilibria] + [o.omega for o in cycles]
    return np.append(size, (max(rates, default=1.0) or 1.0) * size[second])


def starts_of(system: System, equilibria: list[Equilibrium], size: Array) -> list[tuple[str, Array]]:
    """Return the states from which motions are simulated: beside equilibria, and random ones of a fixed seed.

    Of many states, also those in which one group of bodies is displaced and all others rest.
    """
    starts = _in_groups(system, equilibria, size) if has_many_states(system) else []
    for k, e in enumerate(equilibria, 1):
        where = f"beside equilibrium {k}"
        for j in range(e.unstable):
            if e.eigenvalues[j].imag < 0:
                continue
            v = e.vectors[:, j].real
            v = v / np.abs(v / size).max() * NUDGE
            starts += (
                [(where, e.x + v), (where, e.x - v)]
                if e.eigenvalues[j].imag == 0 or e.unstable > 2
                else [(where, e.x + v)]
            )
        if not e.unstable and len(e.eigenvalues):
            v = e.vectors[:, 0].real
            v = v / np.abs(v / size).max()
            starts += [(where, e.x + s * v) for s in (0.3, 3.0)]
    rng = np.random.default_rng(1995)
    low, high = (np.array([c.bounds[i] for c in system.coordinates]) for i in (0, 1))
    usual = np.sign(sum((e.x for e in equilibria), np.zeros(len(size))))
    for k in range(max(2, STATES // system.n_states)):
        signs = rng.choice([-1.0, 1.0], len(size))
        if k % 2 == 0:  # where the equilibria are: many equations make sense for positive values only
            signs = np.where(usual, usual, signs)
        x = size * 10.0 ** rng.uniform(-1, 0.5, len(size)) * signs
        x[: system.n] = np.where(np.isfinite(low) & (x[: system.n] < low), low + np.abs(x[: system.n]), x[: system.n])
        x[: system.n] = np.clip(x[: system.n], low, high)
        starts.append((RANDOM, x))
    inside = [(where, np.append(np.clip(x[: system.n], low, high), x[system.n :])) for where, x in starts]
    return _on_level(system, inside, equilibria, size)


def beside_cycle(system: System, orbit: Orbit) -> Array | None:
    """Return a state of a motion that leaves an unstable cycle for one of less symmetry, or of twice the period.

    Such cycles begin where a multiplier, of half a period for an odd cycle, passes -1 (a pitchfork, a period doubling).
    The motion begins along its mode.

    Returns
    -------
    ndarray, shape (n_states,), or None
        None for a stable cycle, and where another multiplier is the largest.
    """
    verdict = orbit.stability
    if verdict is None or verdict.verdict != "unstable" or verdict.critical is None or verdict.critical.imag:
        return None
    if orbit.advance or not (verdict.critical.real < 0 or orbit.is_odd(ODD)):
        return None
    judged = floquet(system, orbit)  # a polished cycle has the multipliers of its full period, and no mode
    halves, mode = judged.half_multipliers, judged.mode
    known = judged.multipliers if halves is None else halves
    if mode is None or judged.critical is None:
        return None
    largest = known[np.argmin(np.abs(judged.multipliers - judged.critical))]
    if largest.imag or largest.real > -1:
        return None
    second = list(system.second_order)
    x = np.append(orbit.q(0.0)[0], orbit.v(0.0)[0][second])
    width = np.ptp(orbit.extremes, axis=0)
    size = np.append(width, orbit.omega * width[second])
    share = np.divide(np.abs(mode.real), size, out=np.zeros(len(size)), where=size > 0).max()
    if not share > 0:
        return None
    x = x + NUDGE / share * mode.real
    leaving = int(min(np.ceil(np.log(1 / NUDGE) / np.log(abs(judged.critical))), LONGEST))  # periods, linearly
    try:
        return np.asarray(states_after(system, x, system.vector(), orbit.period, leaving, TOLERANCE)[-1])
    except ConvergenceError:
        return None


def _in_groups(system: System, equilibria: list[Equilibrium], size: Array) -> list[tuple[str, Array]]:
    """Return states in which all coordinates of one group are displaced alike from the first equilibrium."""
    rest, starts = equilibria[0].x if equilibria else np.zeros(len(size)), []
    for name, own in system.groups.items() if len(system.groups) > 1 else ():
        x, places = rest.copy(), [system.index(coordinate) for coordinate in own]
        x[places] += DISPLACED * size[places]
        starts.append((f"a state in which only the {name} is displaced", x))
    return starts


def _on_level(
    system: System, starts: list[tuple[str, Array]], equilibria: list[Equilibrium], size: Array
) -> list[tuple[str, Array]]:
    """Return the states moved to the level of what is conserved, that of the first equilibrium (or of zero)."""
    rows = conserved_quantities(system, system.vector(), size)
    if not len(rows):
        return starts
    held = rows @ (equilibria[0].x if equilibria else np.zeros(len(size)))
    scaled = rows * size
    return [(where, x - size * np.linalg.lstsq(scaled, rows @ x - held, rcond=None)[0]) for where, x in starts]
