"""Collocation as a method: what turns a system into equations that `solve`, `trace` and `fold` take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hbbogie.brief import brief
from hbbogie.collocation.cycle import CollocatedCycle
from hbbogie.collocation.rates import Rates
from hbbogie.collocation.solving import collocated
from hbbogie.collocation.starting import Sampled, from_orbit
from hbbogie.errors import ModelError, of_kind, positive
from hbbogie.model.system import System
from hbbogie.results.orbit import Orbit
from hbbogie.stability.variation import check_orbit


@dataclass(frozen=True)
class Collocation:
    """Orthogonal collocation at Gauss points on a mesh that adapts to the motion.

    Parameters
    ----------
    intervals : int or "auto"
        Number of intervals; "auto" takes as many as the tolerance asks for.
    degree : int
        Degree of the polynomials, and number of Gauss points in an interval.
    tolerance : float
        Estimated error of the period and of the states where intervals begin, both relative.

    Examples
    --------
    The relaxation oscillation of van der Pol's equation at mu = 100 has the period 162.83707.

    >>> import hbbogie as hb
    >>> from hbbogie.collocation import Collocation, from_motion
    >>> system = hb.load_problem("van_der_pol").van_der_pol(mu=100.0)
    >>> guess = from_motion(system, [2.0, 0.0])
    >>> cycle = Collocation().equations(system).cycle(guess)
    >>> round(cycle.period, 5), cycle.stability.verdict
    (162.83707, 'stable')
    """

    intervals: int | str = "auto"
    degree: int = 4
    tolerance: float = 1e-9

    def __post_init__(self) -> None:
        if self.intervals != "auto" and not (isinstance(self.intervals, int | np.integer) and self.intervals >= 4):
            raise ModelError(
                f"Collocation: intervals={self.intervals!r}; give a whole number from 4, or 'auto' for as many as the "
                "tolerance takes."
            )
        if not (isinstance(self.degree, int | np.integer) and 2 <= self.degree <= 12):
            raise ModelError(f"Collocation: degree={self.degree!r}; give a whole number from 2 to 12.")
        positive("tolerance", self.tolerance, "1")

    def equations(self, system: System) -> CollocationEquations:
        """Return the equations of the system's cycles.

        Raises
        ------
        ModelError
            When an element jumps.
        """
        of_kind("Collocation().equations: system", system, System)
        Rates(system)
        return CollocationEquations(system, self)


@dataclass(frozen=True, eq=False)
class CollocationEquations:
    """The cycles of a system by collocation: their mesh, and so the number of unknowns, follows the motion.

    Where elements are piecewise linear, their contact times are points of the mesh, also along branches.

    Attributes
    ----------
    system : System
        Whose parameter values hold wherever a solver is not told otherwise.
    collocation : Collocation
    """

    system: System
    collocation: Collocation

    __repr__ = brief

    @property
    def method(self) -> str:
        """What made them, for people."""
        n = self.collocation.intervals
        many = "an adaptive mesh" if n == "auto" else f"{n} intervals"
        return f"collocation of degree {self.collocation.degree} on {many}"

    def cycle(self, guess: Orbit | Sampled | CollocatedCycle, **values: float) -> CollocatedCycle:
        """Return the cycle near a guess.

        Parameters
        ----------
        guess : Orbit, CollocatedCycle, or a guess from `from_motion` or `from_orbit`
            Its parameter values are not used.
        **values : float
            Parameter values; those not named are the system's.

        Raises
        ------
        ConvergenceError
            When there is none.
        ModelError
            For wrong names or values, an orbit of another system, or a guess of another kind.
        """
        of_kind("Collocation().equations(system): guess", guess, (Orbit, Sampled, CollocatedCycle))
        system, chosen = self.system.with_parameters(**values), self.collocation
        if isinstance(guess, Orbit):
            check_orbit(system, guess)
            if not guess.H:
                raise ModelError("the guess is an equilibrium; give a cycle.")
            guess = from_orbit(system, guess)
        intervals = None if chosen.intervals == "auto" else int(chosen.intervals)
        return collocated(
            system,
            replace(guess, parameters=dict(system.values)),
            degree=chosen.degree,
            intervals=intervals,
            tolerance=chosen.tolerance,
        )

    def solve(self, guess: Orbit, **values: float) -> Orbit:
        """Return the cycle near an orbit as its Fourier series; parameters and errors as of `cycle`."""
        return self.cycle(guess, **values).orbit()
