"""Where curves of folds begin: folds on the branch from a Hopf point, by each method that follows such curves."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from hbbogie.branches.closed_form import exact_walk
from hbbogie.branches.continuation import trace
from hbbogie.critical.exact_fold_curve import ExactFoldCurve
from hbbogie.critical.fold_curve import FoldCurve
from hbbogie.exact.points import Point as ExactPoint
from hbbogie.methods.equations import Equations
from hbbogie.model.system import System
from hbbogie.results import SpecialPoint
from hbbogie.results.failure import ConvergenceError
from hbbogie.solving.curve import Point

Window = tuple[tuple[float, float], tuple[float, float]]
# a fold, and what gives its curve with the first point of it
Found = list[tuple[SpecialPoint | ExactPoint, Callable[[], tuple[Any, Point]]]]


def exact_folds(
    system: System, names: tuple[str, str], window: Window, most: int, hopf: SpecialPoint
) -> tuple[Found, str]:
    """Return the folds of a branch in closed form, and why there may be more of them; nothing where all are found.

    Parameters
    ----------
    system : System
    names : (str, str)
        Both parameters of the chart.
    window : ((float, float), (float, float)), units of the parameters
    most : int
        Largest number of points of the branch.
    hopf : SpecialPoint

    Raises
    ------
    ConvergenceError
        When the branch cannot be begun.
    """
    walk = exact_walk(system, hopf, window[0], most)
    why = "" if walk.end.complete else f" was not followed to its end: {walk.end}."
    if not why and (walk.marked("fold not located") or walk.marked("not located")):
        why = " changes the order of its contacts in a way that was not resolved."
    return [(point, partial(_exact_start, names, window, point)) for point in walk.marked("fold")], why


def _exact_start(names: tuple[str, str], window: Window, point: ExactPoint) -> tuple[ExactFoldCurve, Point]:
    curve = ExactFoldCurve(names, *window, point)
    if (first := curve.first()) is None:
        raise ConvergenceError("no curve of folds in closed form begins there.")
    return curve, first


def harmonic_folds(
    equations: Equations, names: tuple[str, str], window: Window, most: int, hopf: SpecialPoint
) -> tuple[Found, str]:
    """Return the folds of a branch by harmonic balance, and why there may be more of them; see `exact_folds`."""
    branch = trace(equations, hopf, names[0], window[0], families=False, stability=False, max_points=most)
    cut = branch.ends[1].kind == "points"
    why = f" was cut off after {most} points: folds farther along it are not found." if cut else ""
    return [(fold, partial(_harmonic_start, equations, names, window, fold)) for fold in branch.folds()], why


def _harmonic_start(
    equations: Equations, names: tuple[str, str], window: Window, fold: SpecialPoint
) -> tuple[FoldCurve, Point]:
    p = equations.system.vector(**{names[0]: fold.value})
    curve = FoldCurve(equations.phased(fold.orbit), names, *window, p)
    return curve, curve.first(fold.orbit)
