"""Cycles in closed form as a method beside harmonic balance."""

from __future__ import annotations

from dataclasses import dataclass

from hbbogie.errors import of_kind
from hbbogie.exact.model import SwitchedLinear, switched_linear
from hbbogie.exact.points import Point
from hbbogie.exact.starting import exact_cycle, orbit_of
from hbbogie.exact.walk import follow
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError


@dataclass(frozen=True)
class Exact:
    """Cycles in closed form, for systems that are linear between the switchings of piecewise-linear laws.

    Examples
    --------
    >>> from hbbogie import find_cycles, load_problem, solve, trace
    >>> bogie = load_problem("yang1995").bogie()
    >>> exact = Exact().equations(bogie)
    >>> cycle = solve(exact, find_cycles(bogie, V=90.0)[-1], V=100.0)
    >>> round(cycle.omega, 9)
    30.98636308
    >>> round(trace(exact, cycle, "V", (60.0, 190.0)).folds()[0].value, 9)
    88.764113194
    """

    def equations(self, system: System) -> ExactEquations:
        """Return the equations of the system's cycles.

        Raises
        ------
        ModelError
            When the system is not linear between switchings.
        """
        of_kind("Exact().equations: system", system, System)
        return ExactEquations(system, switched_linear(system))


@dataclass(frozen=True, eq=False)
class ExactEquations:
    """The equations of exact cycles of a system, which `solve` and `trace` accept like those of harmonic balance.

    Attributes
    ----------
    system : System
        Its parameter values apply unless a solver is given others.
    model : SwitchedLinear
    """

    system: System
    model: SwitchedLinear

    def solve(self, guess: Orbit, **fixed: float) -> Orbit:
        """Return the cycle near a guess at given parameter values; see `hbbogie.solve`."""
        of_kind("Exact().equations(system).solve: guess", guess, Orbit)
        system = self.system.with_parameters(**fixed)
        changed = [name for name, value in system.values.items() if guess.parameters.get(name, value) != value]
        parameter = changed[0] if changed else system.parameter_names[0]
        try:
            return orbit_of(exact_cycle(system, guess.replace(parameters=dict(system.values)), parameter))
        except ConvergenceError:
            if len(changed) != 1:
                raise
        return orbit_of(self._followed(guess, parameter, system.values[parameter]))

    def _followed(self, guess: Orbit, parameter: str, value: float) -> Point:
        """Return the cycle at a value of the parameter on the branch of a guess at another one."""
        before = guess.parameters[parameter]
        start = exact_cycle(self.system, self.at(guess, parameter), parameter)
        towards = start if start.direction * (value - before) > 0 else start.turned()
        walk = follow(towards, (min(before, value), max(before, value)))
        if walk.points[-1].kind == "end" and abs(walk.points[-1].value - value) <= 1e-9 * abs(value - before):
            return walk.points[-1]
        raise ConvergenceError(
            f"system {self.system.name!r}: no exact cycle was found at {parameter} = {value:g} from the guess at "
            f"{before:g}: its branch turns back or ends before it ({walk.end}). Give a nearer guess, or use "
            "find_cycles."
        )

    def at(self, orbit: Orbit, parameter: str) -> Orbit:
        """Return an orbit with the system's parameter values, except for one, which keeps its own value."""
        own = orbit.parameters.get(parameter, self.system.values[parameter])
        return orbit.replace(parameters={**self.system.values, parameter: own})
