"""The census of cycles at one value of a parameter: candidates from branches and motions, polished by shooting."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.closed_form import exact_crossings, exact_walk
from hbbogie.branches.continuation import trace
from hbbogie.branches.crossing import crossings, extent, family_message
from hbbogie.branches.motions import recurrences, sample_distance, state_of
from hbbogie.branches.onsets import beginnings
from hbbogie.branches.relatives import relatives
from hbbogie.branches.relaxation import on_one_of, settled, solved
from hbbogie.branches.same import alike, of_prime_period, signature
from hbbogie.branches.starts import Equilibrium, equilibria_at, sizes, starts_of
from hbbogie.collocation.starting import from_orbit
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.find import find_equilibria
from hbbogie.methods.condensation import frequency_scale
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.methods.scales import amplitude_scale
from hbbogie.model.conserved import conserved_quantities
from hbbogie.model.ranges import check_interval
from hbbogie.model.system import System
from hbbogie.motion.energy import alone
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES, ConvergenceError
from hbbogie.solving.solvers import solve
from hbbogie.stability.multipliers import floquet
from hbbogie.stability.verification import verify

Array = NDArray[np.float64]
COARSE = 15  # highest harmonic with which branches are followed
FINER = (31, 63)  # with which a candidate is tried again where shooting does not close it
UNRESOLVED = 1e-2  # tail of an orbit beyond which collocation is tried before shooting
CONVERGED = 1e-3  # change of the frequency with more harmonics of a cycle that shooting does not confirm
BEYOND = 0.5  # share of the interval by which Hopf points are looked for beyond its ends
FEW_FAILURES, MOST_FAILURES = 2, 6  # recurrences that shooting does not close near by, with and without a cycle found
EXACT = 1e-10  # error of shooting, and of cycles in closed form
SAME = 1e-8  # share of the interval up to which values of the parameter are one


class Census:
    """The search for cycles at a value, and what it has found.

    Parameters
    ----------
    system : System
        At its values.
    parameter : str
        Along which branches are followed.
    interval : (float, float), unit of the parameter
    start : see `find_cycles`
    backwards : bool
        Whether motions are followed backwards in time as well.
    """

    def __init__(
        self, system: System, parameter: str, interval: tuple[float, float], start: Start | None, backwards: bool
    ):
        self.system, self.parameter, self.start, self.backwards = system, parameter, start, backwards
        self.value = system.values[parameter]
        width = BEYOND * (interval[1] - interval[0])
        self.span = check_interval(system, parameter, (interval[0] - width, interval[1] + width))
        self.branches = find_equilibria(system, parameter, self.span, start=start)
        self.hopf = _distinct(self.branches.special("hopf"))
        self.equilibria: list[Equilibrium] = equilibria_at(system, self.branches, self.value)
        self.found: list[Orbit] = []
        self.failures, self.unsettled, self.undecided, self.family, self.running = 0, 0, 0, "", ""
        self.marks: list[Array] = []
        self.evidence: list[str] = list(self.branches.evidence)
        at = f"at {parameter} = {self.value:.6g}"
        self.evidence += [f"{at}: {e.text(system.coordinate_names)}" for e in self.equilibria]
        if not self.equilibria:
            self.evidence.append(f"{at}: no equilibrium was found")

    @cached_property
    def equations(self) -> Equations:
        """The equations of harmonic balance with which branches are followed."""
        return HarmonicBalance(COARSE).equations(self.system)

    def follow_branches(self) -> None:
        """Follow the branch from every Hopf point, and consider the cycles at the value."""
        for hopf, which in (start for point in self.hopf for start in beginnings(self.system, point)):
            name = f"the branch from the Hopf point at {self.parameter} = {hopf.value:.9g}{which}"
            if time_is_over():
                self.evidence.append(f"{name} was not followed: the time limit was reached")
            elif not self._in_closed_form(hopf, name):
                self._by_harmonic_balance(hopf, name)

    def _in_closed_form(self, hopf: SpecialPoint, name: str) -> bool:
        """Follow the exact cycles of a system that is linear between switchings; tell whether that succeeds."""
        try:
            walk = exact_walk(self.system, hopf, self.span)
            cycles = [orbit for _, orbit in exact_crossings(walk, self.value)]
        except FAILURES:
            return False
        values = [point.value for point in walk.points]
        low, high = min(values), max(values)
        lost = walk.marked("not located") + walk.marked("fold not located")
        if lost or not walk.end.complete or high - low <= SAME * (self.span[1] - self.span[0]):
            return False
        self.evidence.append(f"{name} was followed in closed form from {low:.6g} to {high:.6g}: {walk.end}")
        for orbit in cycles:
            if _unknown(orbit):
                self.consider(orbit, name)
            else:
                peaks = {c: EXACT * orbit.amplitude(c) for c in orbit.coordinates}
                errors = {"omega": EXACT * orbit.omega, "waveform": max(EXACT, orbit.tail), **peaks}
                self._keep(orbit.replace(errors=errors), name)
        return True

    def _by_harmonic_balance(self, hopf: SpecialPoint, name: str) -> None:
        """Follow the cycles of harmonic balance, and consider those at the value."""
        equations = self.equations
        try:
            branch = trace(equations, hopf, self.parameter, self.span, families=False, stability=False)
        except FAILURES as error:
            self.evidence.append(f"{name} was not followed: {error}")
            return
        self.evidence.append(extent(name, branch))
        before = _before(equations, hopf, branch.orbits[0], self.value)
        for orbit in [*before, *crossings(equations, branch, self.value)]:
            self.consider(orbit, name)

    def simulate(self) -> None:
        """Follow motions, and consider the cycles they come near."""
        system, size = self.system, self._sizes()
        starts = starts_of(system, self.equilibria, size)
        if self.start is not None:
            starts = [("the start", state_of(system, self.start))]
        h = self._sample_distance()
        for sense, there in (("", system), (" backwards in time", system.backwards())):
            if sense and not self.backwards:
                continue
            counted: Counter[str] = Counter()
            for where, x in starts:
                if time_is_over():
                    counted["not begun before the time limit"] += 1
                    continue
                x = np.where(np.arange(len(x)) < system.n, x, -x) if sense else x
                counted[self._motion(there, bool(sense), where, x, h, size)] += 1
            told = ", ".join(f"{count} {what}" for what, count in counted.items())
            self.evidence.append(f"{len(starts)} motions{sense}: {told}")
        if self.running:
            self.evidence.append(self.running)

    def _motion(self, there: System, sense: bool, where: str, x: Array, h: float, size: Array) -> str:
        """Follow a motion; return what it came to, for people."""
        known = [signature(_turned(o) if sense else o) for o in self.found]
        for met in recurrences(there, x, h, size, known):
            if (
                met.kind == "cycle"
                and met.orbit is not None
                and self.failures < (FEW_FAILURES if self.found else MOST_FAILURES)
            ):
                orbit = _turned(met.orbit) if sense else met.orbit
                if self.consider(orbit, f"a motion from {where}", near=True):
                    return "came to a cycle"
                if self.family:
                    return "came to one of a continuous family of cycles"
                self.failures += 1
            elif met.kind == "known":
                return "came to a cycle found already"
            elif met.kind == "rest":
                return "came to rest"
            elif met.kind == "running":
                name, period = met.turns
                self.running = (
                    f"{name} goes on by a turn every {period:.6g} s: a running motion, which is no cycle here"
                )
                return "run on"
            elif met.kind == "unbounded":
                return "left every bound"
        if self.unsettled < MOST_FAILURES:
            if (motion := settled(self.system, x, backwards=sense)) is not None:
                if on_one_of(motion, self.marks):
                    return "came to a cycle found already"
                if (cycle := solved(self.system, motion)) is not None:
                    self._keep(cycle.orbit(), f"a motion from {where}", cycle.mark())
                    return "came to a cycle"
            self.unsettled += 1
        self.undecided += 1
        said = f"a motion from {where} has neither settled nor come back to itself"
        self.evidence += [said] if said not in self.evidence else []
        return "undecided"

    def _sizes(self) -> Array:
        system, p = self.system, self.system.vector()
        amplitude = amplitude_scale(system.parts(True), p, frequency_scale(system, p))
        return sizes(system, self.equilibria, self.found, amplitude)

    def _sample_distance(self) -> float:
        eigenvalues = np.concatenate([e.eigenvalues for e in self.equilibria] or [np.empty(0, dtype=complex)])
        return sample_distance(eigenvalues)

    def look_in_groups(self) -> None:
        """Follow motions in which one group of bodies moves as in a cycle found, and the others rest."""
        for where, x in alone(self.system, self.found):
            what = "not begun before the time limit"
            if not time_is_over():
                what = self._motion(self.system, False, where, x, self._sample_distance(), self._sizes())
            self.evidence.append(f"the motion from {where}: {what}")

    def look_beside(self) -> None:
        """Consider what each cycle found lets expect beside it."""
        for orbit in self.found:  # which may grow meanwhile
            for what, guess in () if time_is_over() else relatives(self.system, orbit):
                self.consider(guess, f"{what} of the cycle of period {orbit.period:.9g} s", finer=())

    def consider(self, orbit: Orbit, origin: str, *, near: bool = False, finer: tuple[int, ...] = FINER) -> bool:
        """Polish a candidate and keep the cycle, if it is new; tell whether there is one (near it, if asked)."""
        polished = self.polished(orbit, () if near else finer)
        if polished is None:
            if not near:
                self.evidence.append(
                    f"a candidate of period {orbit.period:.6g} s on {origin} is not confirmed by shooting"
                )
            return False
        times = max(1, round(polished.omega / orbit.omega))  # a recurrence may be several periods long
        if near and not alike(polished, orbit.replace(omega=times * orbit.omega), 0.05):
            return False
        self._keep(polished, origin)
        return True

    def _keep(self, polished: Orbit, origin: str, mark: Array | None = None) -> None:
        """Add a cycle to those found, if it is new; its mark tells it from others better than that of its harmonics."""
        same = next((i for i, other in enumerate(self.found) if alike(polished, other)), None)
        if same is None:
            self.found.append(polished)
            self.marks.append(signature(polished)[: 1 + 3 * self.system.n] if mark is None else mark)
            self.evidence.append(f"a cycle of period {polished.period:.9g} s, from {origin}")
        elif _unknown(self.found[same]) and not _unknown(polished):
            self.found[same] = polished

    def polished(self, orbit: Orbit, finer_harmonics: tuple[int, ...] = FINER) -> Orbit | None:
        """Return the cycle that shooting leads to, or, where it cannot, collocation, or that more harmonics confirm."""
        if orbit.tail > UNRESOLVED and (cycle := solved(self.system, from_orbit(self.system, orbit))) is not None:
            return cycle.orbit()
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
                continue
            except FAILURES:
                break
        if orbit.tail <= UNRESOLVED and (cycle := solved(self.system, from_orbit(self.system, orbit))) is not None:
            return cycle.orbit()
        if not resolved or finer.tail > CONVERGED**0.5:
            return None
        stability = floquet(self.system, finer)
        reason = f"shooting does not confirm the cycle; {stability.reason}"
        unknown = replace(stability, verdict="unknown", reason=reason)
        return finer.replace(stability=unknown, status=f"{finer.status}; shooting does not confirm it")

    def _checked(self, orbit: Orbit) -> Orbit:
        system = self.system
        checked = verify(system, orbit)
        found = of_prime_period(checked.orbit)
        if found is not checked.orbit:
            return self._checked(found)
        if not checked.isolated:
            size = np.abs(orbit.coefficients).sum(axis=0)
            states = np.append(size, orbit.omega * size[list(system.second_order)])
            if not len(conserved_quantities(system, system.vector(), states)):
                self.family = family_message(system, self.parameter, found)
                raise ConvergenceError(self.family, orbit=orbit)
        errors = {"omega": max(checked.closure, EXACT) * found.omega, "waveform": max(checked.closure, EXACT)}
        errors |= {c: max(checked.closure, EXACT) * peak for c, peak in checked.amplitudes.items()}
        return found.replace(errors=errors)

    def say_none(self) -> None:
        """Say why no cycle was found."""
        nearest = min(self.hopf, key=lambda s: abs(s.value - self.value), default=None)
        text = (
            f"the nearest Hopf point is {self.parameter} = {nearest.value:.9g}"
            if nearest
            else f"there is no Hopf point for {self.parameter} from {self.span[0]:.6g} to {self.span[1]:.6g}"
        )
        rest = nearest.orbit.coefficients[0] if nearest else np.zeros(self.system.n)
        closest = min(self.equilibria, key=lambda e: float(np.linalg.norm(e.x[: len(rest)] - rest)), default=None)
        about = closest.text(self.system.coordinate_names) if closest else "no equilibrium was found"
        still = f"; {self.running}" if self.running else ""
        still += f"; {self.undecided} motion(s) stay undecided" if self.undecided else ""
        self.evidence.insert(0, f"no cycle was found at {self.parameter} = {self.value:.6g}: {about}; {text}{still}")


def _distinct(points: list[SpecialPoint]) -> list[SpecialPoint]:
    """Return the Hopf points that differ in value, frequency or equilibrium."""
    kept: list[SpecialPoint] = []
    for point in points:
        mark = np.append([point.value, point.omega], point.orbit.coefficients[0])
        marks = (np.append([other.value, other.omega], other.orbit.coefficients[0]) for other in kept)
        if not any(np.allclose(mark, other, rtol=1e-6, atol=1e-9) for other in marks):
            kept.append(point)
    return kept


def _unknown(orbit: Orbit) -> bool:
    return orbit.stability is None or orbit.stability.verdict == "unknown"


def _turned(orbit: Orbit) -> Orbit:
    """Return the motion backwards in time."""
    c = orbit.coefficients.copy()
    c[2::2] *= -1  # of the sines
    return orbit.replace(coefficients=c)


def _before(equations: Equations, hopf: SpecialPoint, first: Orbit, value: float) -> list[Orbit]:
    """Return the cycle at a value between a Hopf point and the first cycle computed of its branch, if there is one."""
    width = first.parameters[hopf.parameter] - hopf.value
    share = (value - hopf.value) / width if width else 0.0
    if not 0 < share < 1:
        return []
    c = np.sqrt(share) * first.coefficients  # the parameter goes with the square of the amplitude
    c[0] = hopf.orbit.coefficients[0] + share * (first.coefficients[0] - hopf.orbit.coefficients[0])
    try:
        at: dict[str, Any] = {hopf.parameter: value}
        return [solve(equations, first.replace(coefficients=c), method="newton", **at)]
    except ConvergenceError:
        return []
