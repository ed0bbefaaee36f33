"""Polishing a candidate: the cycle that shooting, collocation or more harmonics confirm."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from hbbogie.branches.confirming import by_harmonics
from hbbogie.branches.crossing import family_message
from hbbogie.branches.motions import AT_REST
from hbbogie.branches.relaxation import solved
from hbbogie.branches.same import alike, in_one_turn, of_prime_period, peaks_near
from hbbogie.collocation.starting import from_orbit
from hbbogie.deadline import time_is_over
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.methods.size import has_many_states
from hbbogie.model.conserved import conserved_along
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.results import Orbit
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.verification import verify

FINER = (31, 63)  # harmonics with which a candidate is tried again where shooting does not close it
UNRESOLVED = 1e-2  # tail of an orbit beyond which collocation is tried before shooting
ENOUGH = 320  # intervals of collocation for a cycle that harmonics resolve
CONVERGED = 1e-3  # change of the frequency with more harmonics of a cycle that shooting does not confirm
ONE, SPLIT = 1e-2, 1e-6  # largest error of the trivial multiplier, and distance from 1 of others that are 1 as well
NEAR = 0.05  # distance, see `alike`, of a cycle from a recurrence of a motion that comes to it
EXACT = 1e-10  # error of shooting, and of cycles in closed form


@dataclass(eq=False)
class Polishing:
    """What confirms candidates of a system.

    Attributes
    ----------
    system : System
    parameter : str
        Over which branches are followed, for messages.
    known : list of Orbit
        Cycles found already; may grow.
    family : str
        What to say where a candidate was one of a continuous family, empty so far.
    """

    system: System
    parameter: str
    known: list[Orbit]
    family: str = field(default="")

    def polished(self, orbit: Orbit, finer_harmonics: tuple[int, ...] = FINER) -> Orbit | None:
        """Return the cycle that shooting leads to, or, where it cannot, collocation, or that more harmonics confirm.

        Where there are many states, more harmonics alone confirm it. None where nothing does, and where the limit of
        time is over.
        """
        if time_is_over():
            return None
        if has_many_states(self.system):
            try:
                return self.isolated(by_harmonics(self.system, orbit, self.known))
            except FAILURES:
                return None
        if orbit.tail > UNRESOLVED and (cycle := solved(self.system, from_orbit(self.system, orbit))) is not None:
            return self.isolated(cycle.orbit())
        finer, resolved = orbit, False
        for H in (0, *finer_harmonics):
            try:
                if H and H <= finer.H:
                    continue
                if H:
                    last, finer = finer, solve(HarmonicBalance(H).equations(self.system), finer, method="newton")
                    resolved = abs(finer.omega / last.omega - 1) <= CONVERGED
                return self._checked(finer)
            except ConvergenceError:
                if time_is_over():
                    return None
            except FAILURES:
                break
        if self.family:
            return None
        guess = from_orbit(self.system, orbit)
        if orbit.tail <= UNRESOLVED and (cycle := solved(self.system, guess, most=ENOUGH)) is not None:
            return self.isolated(cycle.orbit())
        if not resolved or finer.tail > CONVERGED**0.5:
            return None
        stability = floquet(self.system, finer)
        reason = f"shooting does not confirm the cycle; {stability.reason}"
        unknown = replace(stability, verdict="unknown", reason=reason)
        return finer.replace(stability=unknown, status=f"{finer.status}; shooting does not confirm it")

    def is_near(self, cycle: Orbit, recurrence: Orbit) -> bool:
        """Tell whether a cycle is the one that a motion comes to, of which a recurrence, of some periods, is known."""
        times = max(1, round(cycle.omega / recurrence.omega))
        advance = tuple(by / times for by in recurrence.advance)
        once = recurrence.replace(omega=times * recurrence.omega, advance=advance)
        if has_many_states(self.system):  # what hardly moves has not come to rest when the recurrence is taken
            return peaks_near(cycle, once, AT_REST)
        return alike(cycle, once, NEAR)

    def _checked(self, orbit: Orbit) -> Orbit:
        system = self.system
        checked = verify(system, orbit)
        found = of_prime_period(checked.orbit, turns_of(system.dynamics))
        if found is not checked.orbit:
            return self._checked(found)
        found = in_one_turn(system, found)
        if not checked.isolated and not self._conserved(orbit):
            self.family = family_message(system, self.parameter, found)
            raise ConvergenceError(self.family, orbit=orbit)
        errors = {"omega": max(checked.closure, EXACT) * found.omega, "waveform": max(checked.closure, EXACT)}
        errors |= {c: max(checked.closure, EXACT) * peak for c, peak in checked.amplitudes.items()}
        return found.replace(errors=errors)

    def _conserved(self, orbit: Orbit) -> int:
        """Return how many linear quantities are conserved."""
        return len(conserved_along(self.system, orbit, self.system.vector()))

    def isolated(self, cycle: Orbit) -> Orbit | None:
        """Return a cycle of collocation; None for one of a continuous family, which has a further multiplier 1."""
        s = cycle.stability
        if s is not None and s.trivial_error <= ONE:
            ones = np.count_nonzero(np.abs(s.multipliers - 1) <= max(SPLIT, 3 * s.trivial_error))
            if ones > 1 + self._conserved(cycle):
                self.family = family_message(self.system, self.parameter, cycle)
                return None
        return cycle
