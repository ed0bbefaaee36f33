"""Cycles to which simulated motions settle, forwards and backwards in time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from hbbogie.branches.same import once_each
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.motion.integration import default_step
from hbbogie.motion.settling import Settled, last_orbit, settle
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.solvers import solve

STARTS = (0.1, 1.0, 4.0)  # amplitudes from which motions are simulated, in units of the amplitude scale
SMALL = 1e-3  # amplitude, in the same units, below which a motion that is not at rest yet has died out
CHUNK, LONGEST = 2e3, 1.2e5  # steps simulated between two looks at the motion, and at most
SLOWEST = 60.0  # or so many time constants of the slowest mode
MOST = 5e5  # steps of a motion in any case: a stiff system has time constants that no simulation reaches
FINEST = 511  # highest harmonic of a motion from which shooting may go on
NEAR = 0.2  # share by which the frequency of a motion may be off the cycle it has settled on


def settled_cycles(equations: Equations, parameter: str) -> list[Orbit]:
    """Let motions from states of several sizes settle, and solve for the cycles they settle on.

    Forwards in time they settle on stable cycles, backwards on those that repel from all sides. Of a conservative
    system, whose motions settle at once, these are some cycles of a continuous family.

    Raises
    ------
    ConvergenceError
        When a motion goes on without settling, or settles on a cycle that the harmonics kept do not
        resolve: then "no cycle" would be a guess. Its ``orbit`` is that motion.
    """
    system, H = equations.system, (equations.coefficients.size1_out(0) - 1) // 2
    line = Linearisation(system, parameter)
    value = line.p[line.place]
    rest, (_, vectors) = line.equilibrium(value), line.eigen(value)
    mode = vectors[: system.n, 0].real
    mode = mode / np.abs(mode).max(initial=1e-300)
    moving = max(system.nonlinear_coordinates or system.coordinate_names, key=lambda n: abs(mode[system.index(n)]))
    starts = [
        dict(zip(system.coordinate_names, map(float, rest + size * float(equations.scale[0]) * mode), strict=True))
        for size in STARTS
    ]
    found: list[Orbit] = []
    open_questions: list[str] = []
    unresolved: Orbit | None = None
    goes_on = False
    for settled in _settled(system, starts, moving):
        if settled.kind == "undecided":
            open_questions.append(settled.status.partition("; give a larger")[0].removesuffix("."))
            goes_on |= settled.amplitudes[moving] > SMALL * float(equations.scale[0])
        if settled.kind != "cycle":
            continue
        guess = last_orbit(system, settled.trajectory, H, moving)
        try:
            found.append(_near(equations, guess))
        except ConvergenceError as error:
            unresolved = last_orbit(system, settled.trajectory, FINEST, moving)
            open_questions.append(
                f"a motion settles on a cycle of period {guess.period:.6g} s that {equations.method} do not resolve "
                f"(ask for more with harmonics=...): {error}"
            )
    before = system.backwards()
    for settled in _settled(before, starts, moving):
        if settled.kind == "cycle":
            guess = last_orbit(before, settled.trajectory, H, moving)
            c = guess.coefficients.copy()
            c[2::2] *= -1  # of the sines
            with suppress(ConvergenceError):
                found.append(_near(equations, guess.replace(coefficients=c)))
    if open_questions and not found:
        raise ConvergenceError(
            f"whether {system.name!r} has a cycle at {parameter} = {value:g} is undecided: no branch from a Hopf point "
            f"reaches this value, and a motion is {open_questions[0]}",
            orbit=unresolved,
            # whether more harmonics might help, and whether a motion does not die out
            statistics={"unresolved": unresolved is not None, "goes on": goes_on or unresolved is not None},
        )
    return once_each(found)


def _near(equations: Equations, guess: Orbit) -> Orbit:
    """Return the cycle that a motion has settled on; raise `ConvergenceError` where another one is found."""
    found = solve(equations, guess, method="newton")  # the guess is good, or these harmonics are too few
    if abs(found.omega / guess.omega - 1) > NEAR:
        raise ConvergenceError(f"they lead to another period, {found.period:.6g} s", orbit=found)
    return found


def _settled(system: System, starts: list[dict[str, float]], coordinate: str) -> Iterator[Settled]:
    """Give how motions from several states settle, but for those that grow without limit: there is no cycle there."""
    A = system.state_matrix(np.zeros(system.n_states), system.vector())
    rates = np.abs(np.linalg.eigvals(A))
    rates = rates[rates > 1e-6 * rates.max(initial=0.0)]
    # 1 ms is right for motions of about 1 rad/s; slower ones are given as much more time
    step = max(default_step(system, system.vector()), 1e-3 / float(rates.max())) if len(rates) else 1e-3
    longest = max(LONGEST * step, SLOWEST / float(rates.min(initial=np.inf)))
    for start in starts:
        if time_is_over():
            return
        for h in (step, step / 8):  # what blows up may be the integration only
            most = min(longest, MOST * h)
            try:
                yield settle(system, start, coordinate=coordinate, chunk=CHUNK * step, longest=most, step=h)
                break
            except ConvergenceError:
                continue
