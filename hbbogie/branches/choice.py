"""Which method computes cycles: one vocabulary for searches, branches, charts and the command line."""

from __future__ import annotations

from hbbogie.collocation.method import Collocation, CollocationEquations
from hbbogie.collocation.rates import Rates
from hbbogie.errors import ModelError, named
from hbbogie.exact.method import Exact, ExactEquations
from hbbogie.exact.model import switched_linear
from hbbogie.methods.equations import Equations
from hbbogie.methods.harmonic import HarmonicBalance
from hbbogie.model.system import System

METHODS = ("auto", "exact", "mhb", "collocation")


def chosen_methods(
    where: str, system: System, method: str, harmonics: object = None, *, along: str | None = None
) -> tuple[str, ...]:
    """Return the methods that a name stands for, those to be tried first at the beginning.

    Parameters
    ----------
    where : str
        The function that was asked, for the message.
    system : System
    method : {"auto", "exact", "mhb", "collocation"}
        "auto" is "exact" for a system that is linear between switchings. For any other it is "mhb", multi-harmonic
        balance, and then "collocation" where that applies.
    harmonics : int, optional
        Where they are given, "auto" is "mhb".
    along : str, optional
        The parameter along which branches are followed, if they are.

    Raises
    ------
    ModelError
        For another name, a method that does not apply to the system, or harmonics for a method that has none.
    """
    name = named(where, "method", method.strip().casefold() if isinstance(method, str) else method, METHODS)
    if harmonics is not None and name in ("exact", "collocation"):
        raise ModelError(
            f'{where}: harmonics={harmonics!r} with method="{name}", which has none; leave one of the two out, or take '
            'method="mhb".'
        )
    if name != "auto":
        if name != "mhb":
            equations_of(name, system)  # raises where it does not apply
        if name == "collocation" and along is not None:
            Rates(system, along)
        return (name,)
    if harmonics is not None:
        return ("mhb",)
    if is_switched_linear(system):
        return ("exact", "mhb")
    jumps = any(element.heights is not None for element in system.elements)
    kinked = any(element.ramps is not None for element in system.elements)
    # a branch past many contacts takes collocation minutes: there only where it is asked for
    return ("mhb",) if jumps or (kinked and along is not None) else ("mhb", "collocation")


def is_switched_linear(system: System) -> bool:
    """Tell whether a system is linear between the switchings of piecewise-linear laws."""
    try:
        switched_linear(system)
    except ModelError:
        return False
    return True


def equations_of(method: str, system: System, harmonics: int = 15) -> Equations | ExactEquations | CollocationEquations:
    """Return the equations of cycles by a method: "exact", "mhb" or "collocation"."""
    if method == "exact":
        return Exact().equations(system)
    return Collocation().equations(system) if method == "collocation" else HarmonicBalance(harmonics).equations(system)
