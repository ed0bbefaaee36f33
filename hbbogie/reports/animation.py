"""The job of showing how a system moves: on a cycle, or as it comes to rest."""

from __future__ import annotations

from types import ModuleType

from hbbogie.branches.cycles import find_cycles
from hbbogie.errors import ModelError
from hbbogie.model.system import System
from hbbogie.motion.integration import simulate
from hbbogie.progress import Progress, silent
from hbbogie.reports.motion import default_start
from hbbogie.results import Orbit, Trajectory
from hbbogie.results.failure import ConvergenceError

DURATION = 3.0  # s of a motion where there is no cycle


def motion_to_show(
    module: ModuleType, system: System, progress: Progress = silent, *, cycle: int | None = None
) -> tuple[Orbit | Trajectory, str]:
    """Return the motion that an animation of a problem shows, and a sentence on it.

    Parameters
    ----------
    module : module
        Of the problem; where it has ``PUSHED``, a motion that dies out begins there.
    system : System
    progress : callable
        Called with (message, fraction done or None).
    cycle : int, optional
        Which of the cycles, from 1, by growing amplitude; the largest stable one where left out. Where there is no
        cycle, the motion after a push is shown.

    Raises
    ------
    ModelError
        When there are not so many cycles.
    """
    parameter = getattr(module, "PARAMETER", None)
    progress("looking for cycles", None)
    try:
        found = find_cycles(system, parameter=parameter)
    except (ConvergenceError, ModelError):  # undecided, or a family
        found = None
    if cycle is not None and not 1 <= cycle <= len(found or ()):
        raise ModelError(f"animate: cycle {cycle} is asked for, and there are {len(found or ())}; give another number.")
    if found:
        stable = [o for o in found if o.stability is not None and o.stability.verdict == "stable"]
        chosen = found[cycle - 1] if cycle is not None else (stable or found)[-1]
        verdict = chosen.stability.verdict if chosen.stability else "not judged"
        return chosen, f"one period of the cycle of {chosen.period:.4g} s ({verdict})"
    start = getattr(module, "PUSHED", None) or default_start(system)
    progress("integrating", None)
    pushed = ", ".join(f"{name} = {value:g}" for name, value in start.items())
    return simulate(system, start, DURATION), f"no cycle was found: the motion after a push, {pushed}"
