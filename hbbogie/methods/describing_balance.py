"""Equivalent linearisation as equations: every element becomes a spring with an amplitude-dependent stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from hbbogie.errors import ModelError
from hbbogie.methods.assembly import Assembly
from hbbogie.methods.describing_functions import first_order, reference_stiffness, second_order
from hbbogie.methods.equations import Equations
from hbbogie.methods.layout import make_layout
from hbbogie.methods.scales import make_equations
from hbbogie.model.parts import Parts, split
from hbbogie.model.system import System

TINY = 1e-60  # square of an amplitude that counts as zero, which keeps the square root and its derivatives finite
ORDERS = {1: "first", 2: "second"}


@dataclass(frozen=True)
class DescribingFunction:
    """Balance of one harmonic, with the force of each element from the describing function of its law.

    At order 1 this is `HarmonicBalance` with one harmonic. A law without closed form is integrated by a fixed rule of
    256 points a period (see `describing_function`). So are nonlinear terms that are not elements, such as creep forces
    over two creepages: all that they depend on is sinusoidal, each with its own amplitude and phase, and their first
    harmonic is kept (see `first_harmonics`). This is the quasi-linearisation of practice.

    Parameters
    ----------
    order : {1, 2}
        Order 2 feeds back the higher harmonics of conservative laws (Krylov, Bogoliubov, Mitropolsky). It assumes that
        only the inertia and a spring of the law's reference stiffness respond to them. It need not be better than order
        1, and for a free mass between springs behind gaps it is worse.
    samples : int
        Samples per period for nonlinear terms that are no elements: exact for polynomials up to degree 254.
    condense : bool
        Eliminate the coordinates that enter linearly (eq-condensation).
    phase : str, optional
        Coordinate whose sine coefficient is zero; by default the first that enters nonlinearly.

    Examples
    --------
    By the first order the cycle of van der Pol's oscillator has amplitude 2 and frequency 1.

    >>> from hbbogie import find_cycles, load_problem, solve
    >>> system = load_problem("van_der_pol").van_der_pol(mu=0.1)
    >>> cycle = solve(DescribingFunction().equations(system), find_cycles(system)[0])
    >>> round(cycle.amplitude("x"), 6), round(cycle.omega, 6)
    (2.0, 1.0)
    """

    order: int = 1
    samples: int = 256
    condense: bool = True
    phase: str | None = None

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise ModelError(f"DescribingFunction: order={self.order!r}; allowed is 1 or 2.")
        if not isinstance(self.samples, int) or self.samples < 6 or self.samples % 2:
            raise ModelError(f"DescribingFunction: samples={self.samples!r}; give an even number from 6.")

    def equations(self, system: System) -> Equations:
        """Return the equations of the system's cycles.

        Raises
        ------
        ModelError
            When the system is not odd, an element is preloaded, or order 2 does not apply to the system.
        """
        if not system.odd:
            raise ModelError(
                f"DescribingFunction: {system.name!r} is not odd (r(-q) = -r(q)), so its cycles have a mean and "
                "even harmonics; take HarmonicBalance(harmonics) instead."
            )
        parts = system.once(("parts", "every law"), lambda: split(system.dynamics, contact=True, every_law=True))
        self._check(system, parts)
        layout = partial(make_layout, system, parts, (1,), H=1, samples=self.samples)
        force = partial(_equivalent_force, order=self.order)
        assembly = system.once(self, lambda: Assembly(layout(condense=self.condense, phase=self.phase), system, force))
        return make_equations(system, assembly, f"describing functions, {ORDERS[self.order]} order")

    def _check(self, system: System, parts: Parts) -> None:
        zero, v = ca.SX.zeros(system.n), ca.SX.sym("v", system.n)
        p = ca.SX.sym("p", len(system.parameters))
        for element in parts.contacts:
            if not ca.simplify(element.argument(zero, zero, p)).is_zero():
                raise ModelError(
                    f"DescribingFunction: element {element.name!r} is preloaded, its argument is not zero at rest; "
                    "take HarmonicBalance(harmonics) instead."
                )
            if self.order == 1:
                continue
            if ca.depends_on(element.argument(zero, v, p), v):
                raise ModelError(
                    f"DescribingFunction: element {element.name!r} depends on velocities; order 2 is for conservative "
                    "laws, take order=1 or HarmonicBalance(harmonics)."
                )
            k = ca.Function("k", [p], [reference_stiffness(element.at(p), name=element.name)])
            reference_stiffness(element.at(p), float(k(system.vector())), element.name)
        if self.order == 2 and parts.remainder_rows:
            names = ", ".join(system.coordinate_names[i] for i in parts.remainder_rows)
            raise ModelError(
                f"DescribingFunction: the equations of {names} contain nonlinear terms that are not elements; order 2 "
                "needs laws: write them with Element, take order=1 or HarmonicBalance(harmonics)."
            )


def _equivalent_force(element: Any, u: ca.SX, p: ca.SX, order: int) -> ca.SX:
    """Return the coefficients of an element's force from those of its argument, both of harmonic 1."""
    law, Y = element.at(p), ca.sqrt(ca.fmax(ca.sumsqr(u), TINY))
    N = first_order(law, Y) if order == 1 else second_order(law, Y, law.reference_stiffness())
    return N * u
