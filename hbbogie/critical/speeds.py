"""All critical values of a parameter over an interval, without a guess."""

from __future__ import annotations

from dataclasses import replace

from hbbogie.branches.choice import chosen_methods, is_switched_linear
from hbbogie.critical.hopf_gradients import hopf_gradient
from hbbogie.critical.search import Search
from hbbogie.deadline import time_is_over, time_limit
from hbbogie.equilibria.census import Start
from hbbogie.equilibria.hopf import hopf_points
from hbbogie.errors import ModelError, door
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.methods.size import has_coupled_groups
from hbbogie.model.ranges import check_interval, widened
from hbbogie.model.system import System
from hbbogie.motion.energy import moving_groups
from hbbogie.progress import Progress, silent
from hbbogie.results.critical import Criticals

FOLLOWED, CORRECTED = 0.3, 0.5  # shares of the work after which branches are followed and folds are known
HARMONICS = 21  # highest harmonic of a fold by harmonic balance, where none is given


@door(system=System, parameter=str)
def critical_speeds(
    system: System,
    parameter: str = "V",
    interval: tuple[float, float] | None = None,
    *,
    method: str = "auto",
    harmonics: int | None = None,
    start: Start | None = None,
    limit: float | None = None,
    progress: Progress = silent,
    **values: float,
) -> Criticals:
    """Find the critical values of a parameter, without a guess: Hopf points and the folds of their branches.

    Each branch is followed from its Hopf point to where it leaves the interval or ends. In closed form, and by
    collocation, its folds are those of the cycles themselves. By harmonic balance it is followed with 9 harmonics, with
    more where these do not resolve its cycles or lose it. Each fold is then solved for with 21, and its value corrected
    for what these leave out (eq-fold-shift), unless the system is linear between switchings. The orbit at the fold
    keeps the value that its harmonics give.

    Where the coordinates belong to groups of bodies, motions in which one group moves below the first Hopf point, or
    all do, lead to further branches. Where groups have more than 64 states, as in a train, the branches from Hopf
    points have too many folds. Then motions in which one group, two neighbours or all move lead to cycles below the
    first Hopf point, whose branches are followed down to their folds; ``undecided`` says so.

    Parameters
    ----------
    system : System
    parameter : str
    interval : (float, float), optional, unit of the parameter
        Where to look; twice the parameter's value (at least 1) to either side, within its bounds, where left out. A
        fold below it counts as well where the branch from a Hopf point inside goes down to it: cycles then exist at
        the beginning of the interval already.
    method : {"auto", "exact", "mhb", "collocation"}
        "auto" follows a branch in closed form where the system is linear between switchings, else by multi-harmonic
        balance, and by collocation where the system is smooth and harmonics do not resolve the branch or a fold of it.
        The ``evidence`` and the status of each fold say by which it was.
    harmonics : int, optional
        Highest harmonic of the folds, whose values are then those of these harmonics, not corrected; where it is given,
        "auto" is "mhb".
    start : Orbit, Trajectory, mapping from name to value or sequence of float, optional
        A state: only Hopf points of the equilibrium near it, and their branches, are looked at.
    limit : float, optional, s
        Time after which the search ends with what was found, and says so in ``undecided``.
    progress : callable
        Called with (message, fraction done or None).
    **values : float
        Parameter values, by name.

    Returns
    -------
    Criticals : list of Critical
        In increasing order of the value. The error of a fold bounds what harmonics left out, or the mesh, change: the
        size of the correction where there is one, of which usually a few hundredths are left. The
        list carries ``evidence``: how far each branch was followed; ``undecided``: what was not followed to its end.
        Folds on branches that reach no Hopf point in the interval, or up to half of it beyond its ends, are not among
        them.

    Raises
    ------
    ModelError
        For wrong names or values, and for a method that does not apply to the system.
    """
    with time_limit(limit):
        system = system.with_parameters(**values)
        return criticals(system, parameter, interval, method, harmonics, start, progress=progress)


def criticals(
    system: System,
    parameter: str,
    interval: tuple[float, float] | None,
    method: str,
    harmonics: int | None,
    start: Start | None = None,
    *,
    lowest: bool = False,
    progress: Progress = silent,
) -> Criticals:
    """Return critical values as `critical_speeds`, or only the lowest ones in full.

    Parameters
    ----------
    system, parameter, interval, method, harmonics, start
        As of `critical_speeds`.
    lowest : bool
        Whether folds of harmonic balance that lie above others are only located along their branches.
    progress : callable
    """
    if harmonics == 0:
        raise ModelError("critical_speeds: harmonics=0; give a whole number from 1.")
    methods = chosen_methods("critical_speeds", system, method, harmonics, along=parameter)
    corrects, harmonics = harmonics is None, HARMONICS if harmonics is None else harmonics
    HarmonicBalance(harmonics).check(system)
    lo, hi = check_interval(system, parameter, interval)
    span = widened(system, parameter, (lo, hi))  # the branch of a fold inside may begin at a Hopf point beyond the end
    corrects = corrects and not is_switched_linear(system)
    search = Search(system, methods, harmonics, span, lo, corrects, lowest)
    progress("Hopf points", 0.0)
    points = hopf_points(system, parameter, span, start=start)
    search.undecided += points.undecided
    if not points:
        search.evidence += points.evidence
    coupled = methods != ("collocation",) and has_coupled_groups(system)
    for k, hopf in enumerate(points):
        progress(f"branches: that from {parameter} = {hopf.value:.5g}", FOLLOWED * k / len(points))
        if lo <= hopf.value <= hi:
            search.found.append(hopf_gradient(system, hopf))
        if not coupled:
            search.follow(hopf)
    if len(system.groups) > 1:
        progress("motions of groups of bodies", FOLLOWED)
    if coupled and points:
        search.follow_motions(parameter, [hopf.value for hopf in points], start)
    else:
        search.look_in_groups([hopf.value for hopf in points])
    if time_is_over() and not search.undecided:
        search.undecided.append("the time limit was reached before all was searched")
    progress("folds", CORRECTED)
    search.found = [c for c in search.found if c.value <= hi]
    found = [replace(c, moves=moving_groups(system, c.orbit)) for c in search.certified()]
    return Criticals(found, search.evidence, search.undecided, search.branches)
