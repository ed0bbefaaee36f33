"""Elements: force laws applied to the coordinates and velocities of a system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError
from hbbogie.model.laws import Law
from hbbogie.model.ramps import Ramps, Scalar
from hbbogie.model.scalars import as_expression
from hbbogie.model.symbols import Expression


class Element(Expression):
    """A law at its place. In an equation of motion it stands for its force.

    Parameters
    ----------
    name : str
        Name of the element, shown in results.
    law : Law
        The force law.
    argument : scalar expression
        What the law depends on: an affine combination of coordinates and velocities.

    Raises
    ------
    ModelError
        When name, law or argument is of another kind, or the law has a memory.
    """

    def __init__(self, name: str, law: Law, argument: Scalar):
        if not isinstance(name, str) or not name:
            raise ModelError(f"name of an element: got {name!r}; give a text, such as 'stop'.")
        if hasattr(law, "steady_force"):
            raise ModelError(
                f"element {name!r}: a {type(law).__name__} has a memory, its force is no function of the argument; "
                "give a law without one, such as DeadBand(stiffness, gap), and keep this one for describing_function."
            )
        if isinstance(law, type) or not isinstance(law, Law):
            raise ModelError(
                f"element {name!r}: its law is {_kind(law)}, which has no method force(u); "
                "give a law such as DeadBand(stiffness, gap)."
            )
        super().__init__(ca.SX.sym(name))
        self.name, self.law, self.argument = name, law, as_expression(f"argument of element {name!r}", argument)


@dataclass(frozen=True, eq=False, kw_only=True)
class AttachedLaw:
    """What a system keeps of an element: its name, its law's name and its functions.

    Attributes
    ----------
    name, law : str
    argument : casadi.Function, (q, v, p) -> u
    force : casadi.Function, (u, p) -> force
    ramps : casadi.Function or None
        For piecewise-linear laws: p -> (offset, stiffness, k, threshold), the last two one per ramp.
    directions : tuple of int
        Direction of each ramp.
    heights : casadi.Function or None
        For laws that jump: p -> the jump where each ramp begins.
    describing : casadi.Function or None
        Where the law knows its describing function: (amplitude, p) -> force per unit of the argument.
    reference : casadi.Function or None
        Where the law knows it: p -> its reference stiffness.
    polynomial : casadi.Function or None
        For polynomial laws: p -> coefficients, the constant first.
    """

    name: str
    law: str
    argument: ca.Function
    force: ca.Function
    ramps: Any
    directions: tuple[int, ...] = ()
    heights: Any = None
    describing: Any = None
    reference: Any = None
    polynomial: Any = None

    __repr__ = brief

    def gaps(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where the ramps that act at these parameter values begin, those that do not act being infinite.

        Parameters
        ----------
        p : ndarray, shape (number of parameters,)

        Returns
        -------
        ndarray, shape (number of ramps,), unit of the argument
        """
        if self.ramps is None:
            return np.empty(0)
        k, threshold = (a.full().ravel() for a in self.ramps(p)[2:])
        heights = self.heights(p).full().ravel() if self.heights else np.zeros(len(k))
        return np.where((k != 0) | (heights != 0), threshold, np.inf)

    def at(self, p: ca.SX) -> LawAt:
        """Return the law at a parameter vector, shape (number of parameters,)."""
        return LawAt(self, p)


@dataclass(frozen=True, eq=False)
class LawAt:
    """An attached law at a parameter vector: a law again. What the law does not know is None.

    Attributes
    ----------
    attached : AttachedLaw
    p : casadi.SX, shape (number of parameters,)
    """

    attached: AttachedLaw
    p: ca.SX

    def force(self, u: Scalar) -> ca.SX:
        """Return the force at the argument u."""
        return self.attached.force(u, self.p)

    def ramps(self) -> Ramps | None:
        """Return the law as straight line plus ramps."""
        if self.attached.ramps is None:
            return None
        offset, stiffness, k, g = self.attached.ramps(self.p)
        terms = tuple((d, k[i], g[i]) for i, d in enumerate(self.attached.directions))
        heights = self.attached.heights
        return Ramps(terms, stiffness, offset, tuple(ca.vertsplit(heights(self.p))) if heights else ())

    def describing(self, amplitude: Scalar) -> ca.SX | None:
        """Return the describing function at an amplitude."""
        return self.attached.describing(amplitude, self.p) if self.attached.describing else None

    def reference_stiffness(self) -> ca.SX | None:
        """Return the reference stiffness."""
        return self.attached.reference(self.p) if self.attached.reference else None

    def polynomial(self) -> tuple[ca.SX, ...] | None:
        """Return the coefficients of a polynomial law, the constant first."""
        return tuple(ca.vertsplit(ca.densify(self.attached.polynomial(self.p)))) if self.attached.polynomial else None


def attach(element: Element, q: ca.SX, v: ca.SX, p: ca.SX) -> AttachedLaw:
    """Return the functions of an element; raise `ModelError` unless its argument is affine in q and v."""
    qv = ca.vertcat(q, v)
    if not ca.depends_on(element.argument, qv) or any(ca.which_depends(element.argument, qv, 2, False)):
        raise ModelError(
            f"element {element.name!r}: its argument {element.argument} is not a linear combination of coordinates "
            f"or velocities ({', '.join(s.name() for s in ca.symvar(q))}); write such a force as an expression in the "
            "equations instead."
        )
    u, law = Expression(ca.SX.sym("u")), element.law
    argument = ca.Function("argument", [q, v, p], [element.argument], list("qvp"), ["u"])
    force = ca.Function("force", [u, p], [force_of(element, u)], ["u", "p"], ["f"])
    ramps, directions, heights = known(law, "ramps"), (), None
    if ramps is not None:
        directions = tuple(d for d, _, _ in ramps.terms)
        k, g = (ca.vertcat(*(ca.SX(t[i]) for t in ramps.terms)) for i in (1, 2))
        if ramps.heights:
            heights = ca.Function("heights", [p], [ca.vertcat(*map(ca.SX, ramps.heights))])
        ramps = ca.Function("ramps", [p], [ca.SX(ramps.offset), ca.SX(ramps.stiffness), k, g])
    N, polynomial = known(law, "describing", u), known(law, "polynomial")
    reference = known(law, "reference_stiffness")
    return AttachedLaw(
        name=element.name,
        law=type(law).__name__,
        argument=argument,
        force=force,
        ramps=ramps,
        directions=directions,
        heights=heights,
        describing=None if N is None else ca.Function("describing", [u, p], [ca.SX(N)], ["Y", "p"], ["N"]),
        reference=None if reference is None else ca.Function("reference", [p], [ca.SX(reference)]),
        polynomial=None
        if polynomial is None
        else ca.Function("polynomial", [p], [ca.vertcat(*map(ca.SX, polynomial))]),
    )


def force_of(element: Element, u: ca.SX) -> ca.SX:
    """Return the force of an element's law at the argument u; raise `ModelError` unless it is an expression."""
    return as_expression(f"force of element {element.name!r}", element.law.force(Expression(u)))


def _kind(law: object) -> str:
    return f"the class {law.__name__} itself" if isinstance(law, type) else f"a {type(law).__name__}"


def known(law: Law | LawAt, name: str, *arguments: Scalar) -> Any:
    """Return what a law's optional method gives, None where the law has no such method."""
    method: Callable[..., Any] | None = getattr(law, name, None)
    return None if method is None else method(*arguments)
