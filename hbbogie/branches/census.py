"""The census of cycles at one value of a parameter: candidates from branches and motions, polished by shooting."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from hbbogie.branches.decaying import decays
from hbbogie.branches.motions import recurrences, sample_distance, state_of
from hbbogie.branches.onsets import beginnings, distinct
from hbbogie.branches.polishing import EXACT, FINER, Polishing
from hbbogie.branches.relatives import MIRROR, relatives, turned
from hbbogie.branches.relaxation import on_one_of, settled, solved
from hbbogie.branches.same import alike, signature
from hbbogie.branches.starts import RANDOM, Equilibrium, beside_cycle, equilibria_at, equilibrium_near, sizes, starts_of
from hbbogie.branches.walks import Walked, Walker
from hbbogie.deadline import time_is_over
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.find import find_equilibria
from hbbogie.methods.condensation import frequency_scale
from hbbogie.methods.scales import amplitude_scale
from hbbogie.methods.size import has_coupled_groups, has_many_states
from hbbogie.model.ranges import widened
from hbbogie.model.system import System
from hbbogie.motion.energy import group_states, sets_looked_at, together
from hbbogie.results import Orbit, SpecialPoint
from hbbogie.results.failure import FAILURES

Array = NDArray[np.float64]
FEW_FAILURES, MOST_FAILURES = 2, 6  # recurrences that shooting does not close near by, with and without a cycle found
MOST_FOLLOWED = 6  # branches through cycles that motions have found
MOST_SWITCHED = 6  # branches that begin at special points of others
LEAST_STATES = 3  # of a system whose cycles lose their symmetry or double their period
SAME = 1e-3  # distance of cycles, and of values relative to the interval, up to which special points are one
ZERO = 1e-12  # share of the interval up to which a value of the parameter is zero
ROUGH = 1e-3  # share of the highest harmonics of a recurrence beyond which stiff integration tells more of it
ALIKE = 0.01  # share of a period by which that of a recurrence may be off
ROUGHEST = 0.05  # the same, beyond which its harmonics lead nowhere
ENDS = {
    "known": "came to a cycle found already",
    "rest": "came to rest",
    "unbounded": "left every bound",
    "singular": "ended where the equations are singular",
}
SOLVED = ("exact", "collocation")  # methods whose cycles need no polish


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
        self.span = widened(system, parameter, interval)
        self.branches = find_equilibria(system, parameter, self.span, start=start)
        self.hopf = distinct(self.branches.special("hopf"))
        self.equilibria: list[Equilibrium] = equilibria_at(system, self.branches, self.value)
        self.found: list[Orbit] = []
        self.marks: list[Array] = []
        self.on_branch: list[bool] = []  # whether the branch of each cycle was followed
        self.failures, self.unsettled, self.running = 0, 0, ""
        self.undecided = {False: 0, True: 0}  # motions, by whether backwards in time
        self.walker, self.polishing = Walker(system, parameter, self.span), Polishing(system, parameter, self.found)
        self.open: list[str] = []  # what was not followed to its end
        self.walked: list[
            tuple[Walked, str]
        ] = []  # branches, with their names, whose special points were not looked at
        self.forks: list[SpecialPoint] = []  # at which other branches begin or cross
        self.evidence: list[str] = list(self.branches.evidence)
        at = f"at {parameter} = {self.value:.6g}"
        self.evidence += [f"{at}: {e.text(system.coordinate_names)}" for e in self.equilibria]
        if not self.equilibria:
            late = time_is_over()
            self.evidence.append(f"{at}: no equilibrium was {'followed to this value in time' if late else 'found'}")

    def follow_branches(self) -> None:
        """Follow the branch from every Hopf point, and consider the cycles at the value."""
        walks: list[Walked] = []
        for hopf, which in (start for point in self.hopf for start in beginnings(self.system, point)):
            name = f"the branch from the Hopf point at {self.parameter} = {hopf.value:.9g}{which}"
            if time_is_over():
                self.evidence.append(f"{name} was not followed: the time limit was reached")
                return
            if not which and any(walked.reaches(hopf, self.span[1] - self.span[0]) for walked in walks):
                self.evidence.append(f"{name} is one that was followed and ends there")
                continue
            for walked in self.walker.from_hopf(hopf, name):
                self._take(walked, name)
                walks.append(walked)

    def follow_cycles(self) -> None:
        """Follow the branches of cycles that lie on none followed yet, and consider what each cycle lets expect."""
        beside = followed = switched = 0
        while not time_is_over():
            if beside < len(self.found):
                orbit, beside = self.found[beside], beside + 1
                for what, guess in relatives(self.system, orbit):
                    self.consider(guess, f"{what} of the cycle of period {orbit.period:.9g} s", finer=())
                self._leave_cycle(orbit)
            elif self.walked:
                self._look_for_forks(*self.walked.pop(0))
            elif switched < len(self.forks):
                fork, switched = self.forks[switched], switched + 1
                value = fork.value if abs(fork.value) > ZERO * (self.span[1] - self.span[0]) else 0.0
                name = f"the branch from the {fork.kind} at {self.parameter} = {value:.9g}"
                if switched > MOST_SWITCHED:
                    self._leave(f"{name} was not followed: {MOST_SWITCHED} others were")
                else:
                    self._take(self.walker.beyond(fork, name), name)
            elif (k := next((i for i, known in enumerate(self.on_branch) if not known), None)) is None:
                return
            else:
                self.on_branch[k] = True
                name = f"the branch through the cycle of period {self.found[k].period:.9g} s"
                if self._mirrored(k):
                    self.evidence.append(f"{name} is the mirror image of one that was followed")
                elif followed == MOST_FOLLOWED:
                    self._leave(f"{name} was not followed: {MOST_FOLLOWED} others were")
                else:
                    followed += 1
                    self._take(self.walker.through(self.found[k], name), name)

    def _leave_cycle(self, orbit: Orbit) -> None:
        """Follow the motion that leaves a cycle which has lost its stability to one of less symmetry."""
        if (x := beside_cycle(self.system, orbit)) is not None:
            where = f"beside the cycle of period {orbit.period:.9g} s"
            what = self._motion(self.system, False, where, x, self._sample_distance(), self._sizes())
            self.evidence.append(f"the motion from {where}, whose symmetry or period breaks: {what}")

    def _look_for_forks(self, walked: Walked, name: str) -> None:
        """Take note of the special points of a branch at which others begin or cross, each once."""
        try:
            found = walked.forks()
        except FAILURES as error:
            self._leave(f"{name} was not searched for others that begin there: {str(error).partition(chr(10))[0]}")
            return
        for fork in found:
            seen = [fork.orbit, *(guess for what, guess in relatives(self.system, fork.orbit) if what == MIRROR)]
            near = (o for o in self.forks if abs(o.value - fork.value) <= SAME * (self.span[1] - self.span[0]))
            if not any(alike(orbit, other.orbit, SAME) for other in near for orbit in seen):
                self.forks.append(fork)

    def _mirrored(self, k: int) -> bool:
        """Tell whether a cycle is the mirror image of one whose branch was followed."""
        guesses = [guess for what, guess in relatives(self.system, self.found[k]) if what == MIRROR]
        known = [o for i, o in enumerate(self.found) if self.on_branch[i] and i != k]
        return any(alike(guess, other) for guess in guesses for other in known)

    def _take(self, walked: Walked, name: str) -> None:
        """Take note of a branch, and of its cycles at the value, which lie on it."""
        self.evidence.append(walked.said)
        if not walked.complete:
            self.open.append(walked.said)
        if self.system.n_states >= LEAST_STATES:
            self.walked.append((walked, name))
        for orbit in walked.cycles:
            if _unknown(orbit) or not orbit.method.startswith(SOLVED):
                self.consider(orbit, name, on_branch=True)
            else:
                peaks = {c: EXACT * orbit.amplitude(c) for c in orbit.coordinates}
                errors = {"omega": EXACT * orbit.omega, "waveform": max(EXACT, orbit.tail), **peaks}
                self._keep(orbit.replace(errors={**errors, **(orbit.errors or {})}), name, on_branch=True)

    def _leave(self, said: str) -> None:
        self.evidence.append(said)
        self.open.append(said)

    def simulate(self, random: bool | None = None) -> None:
        """Follow motions, and consider the cycles they come near; only those from random states, or no such."""
        system, size = self.system, self._sizes()
        starts = [s for s in starts_of(system, self.equilibria, size) if random in (None, s[0] == RANDOM)]
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
        known = [signature(turned(o) if sense else o) for o in self.found]
        many = has_many_states(self.system)  # to look whether harmonics confirm a recurrence takes little time
        for met in recurrences(there, x, h, size, known):
            if met.kind == "cycle" and met.orbit is not None:
                if met.state is not None and met.orbit.tail > ROUGH:  # samples miss what is steep
                    if what := self._settled(met.state, sense, where, met.orbit.period):
                        return what
                    if met.orbit.tail > ROUGHEST:
                        continue
                if not many and self.failures >= (FEW_FAILURES if self.found else MOST_FAILURES):
                    continue
                orbit = turned(met.orbit) if sense else met.orbit
                if (cycle := self.consider(orbit, f"a motion from {where}", near=True)) is not None:
                    if many and cycle.verdict == "unstable":  # a motion that passes by
                        continue
                    return "came to a cycle"
                if self.polishing.family:
                    return "came to one of a continuous family of cycles"
                self.failures += 1
            elif met.kind == "running":
                name, period = met.turns
                self.running = (
                    f"{name} goes on by a turn every {period:.6g} s: a running motion, which is a cycle only where the "
                    f'angle is declared as one, Coordinate("{name}", "rad", turn=2 * pi)'
                )
                return "run on"
            elif met.kind in ENDS:
                return ENDS[met.kind]
            elif met.state is not None and self._decays(there, met.state):
                return "decays to rest as its linear motion does"
        if what := self._settled(x, sense, where):
            return what
        self.undecided[sense] += 1
        which = "a motion backwards in time" if sense else "a motion"
        said = f"{which} from {where} has neither settled nor come back to itself"
        self.evidence += [said] if said not in self.evidence else []
        return "undecided"

    def _decays(self, there: System, x: Array) -> bool:
        """Tell whether a motion, forwards or backwards in time, decays to an equilibrium."""
        found = (equilibrium_near(there, e.x[: there.n]) for e in self.equilibria)
        return decays(there, x, [e for e in found if e is not None])

    def _settled(self, x: Array, sense: bool, where: str, period: float = 0.0) -> str:
        """Follow a motion by the integrator for stiff systems; return what it came to, empty where that is open.

        A motion that has recurred after a ``period`` and comes to a cycle of another one goes on beyond a first cycle.
        """
        if self.unsettled >= MOST_FAILURES:
            return ""
        if (motion := settled(self.system, x, backwards=sense)) is not None:
            times = period / motion.period
            if abs(times - round(times)) > ALIKE * times:
                return ""
            if on_one_of(motion, self.marks):
                return ENDS["known"]
            if (cycle := solved(self.system, motion)) is not None:
                if (member := self.polishing.isolated(cycle.orbit())) is None:
                    return "came to one of a continuous family of cycles"
                self._keep(member, f"a motion from {where}", cycle.mark())
                return "came to a cycle"
        self.unsettled += 1
        return ""

    def _sizes(self) -> Array:
        system, p = self.system, self.system.vector()
        amplitude = amplitude_scale(system.parts(True), p, frequency_scale(system, p))
        return sizes(system, self.equilibria, self.found, amplitude)

    def _sample_distance(self) -> float:
        eigenvalues = np.concatenate([e.eigenvalues for e in self.equilibria] or [np.empty(0, dtype=complex)])
        return sample_distance(eigenvalues)

    def look_in_groups(self) -> None:
        """Follow motions in which one group of bodies moves as in a cycle found, and those in which several do.

        Of many states each group alone was displaced before.
        """
        states = group_states
        if has_coupled_groups(self.system):
            states = together
            self.evidence.append(f"motions are begun {sets_looked_at(self.system)}")
        for where, x in states(self.system, self.found):
            what = "not begun before the time limit"
            if not time_is_over():
                what = self._motion(self.system, False, where, x, self._sample_distance(), self._sizes())
            self.evidence.append(f"the motion from {where}: {what}")

    def consider(
        self,
        orbit: Orbit,
        origin: str,
        *,
        near: bool = False,
        finer: tuple[int, ...] = FINER,
        on_branch: bool = False,
    ) -> Orbit | None:
        """Polish a candidate and keep the cycle, if it is new; return it where there is one (near it, if asked)."""
        polished = self.polishing.polished(orbit, () if near else finer)
        if polished is None:
            if not near:
                self.evidence.append(
                    f"a candidate of period {orbit.period:.6g} s on {origin} is not confirmed by shooting"
                )
            return None
        if near and not self.polishing.is_near(polished, orbit):
            return None
        self._keep(polished, origin, on_branch=on_branch)
        return polished

    def _keep(self, polished: Orbit, origin: str, mark: Array | None = None, *, on_branch: bool = False) -> None:
        """Add a cycle to those found, if it is new; its mark tells it from others better than that of its harmonics."""
        same = next((i for i, other in enumerate(self.found) if alike(polished, other)), None)
        if same is None:
            self.found.append(polished)
            self.marks.append(signature(polished)[: 1 + 3 * self.system.n] if mark is None else mark)
            self.on_branch.append(on_branch)
            self.evidence.append(f"a cycle of period {polished.period:.9g} s, from {origin}")
            return
        self.on_branch[same] |= on_branch
        if _unknown(self.found[same]) and not _unknown(polished):
            self.found[same] = polished

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
        for count, sense in ((self.undecided[False], ""), (self.undecided[True], " backwards in time")):
            still += f"; {count} motion(s){sense} stay undecided" if count else ""
        self.evidence.insert(0, f"no cycle was found at {self.parameter} = {self.value:.6g}: {about}; {text}{still}")


def _unknown(orbit: Orbit) -> bool:
    return orbit.stability is None or orbit.stability.verdict == "unknown"
