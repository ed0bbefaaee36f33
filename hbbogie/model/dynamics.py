"""The equations of motion as one value: residual, first-order form and linear matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError
from hbbogie.model.checks import check_equations, check_names, orders
from hbbogie.model.divisions import divisions
from hbbogie.model.elements import AttachedLaw, Element, attach
from hbbogie.model.outputs import Measure, Output, Outputs, attach_outputs
from hbbogie.model.symbols import Coordinate, Parameter
from hbbogie.model.turns import check_turns
from hbbogie.once import Once
from hbbogie.results.naming import Naming


@dataclass(frozen=True, eq=False, kw_only=True)
class Dynamics:
    """Equations of motion r(q, v, a, p) = 0, whatever the values of the parameters.

    Attributes
    ----------
    name, description : str
    coordinates : tuple of Coordinate
    parameters : tuple of Parameter
    elements : tuple of AttachedLaw
    residual_with_forces : casadi.Function, (q, v, a, f, p) -> r, shape (n,)
        The equations with the forces of the elements as arguments.
    second_order : tuple of bool
        Whether the second derivative of each coordinate occurs.
    outputs : Outputs or None
        None where the system names none.
    once : Once
        What is built for these equations, for all values of the parameters.
    """

    name: str
    description: str
    coordinates: tuple[Coordinate, ...]
    parameters: tuple[Parameter, ...]
    elements: tuple[AttachedLaw, ...]
    residual_with_forces: ca.Function
    second_order: tuple[bool, ...]
    outputs: Outputs | None = None
    once: Once = field(default_factory=Once, repr=False)

    __repr__ = brief

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    @property
    def n_states(self) -> int:
        """Number of states of the first-order form."""
        return self.n + sum(self.second_order)

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(p.name for p in self.parameters)

    @property
    def defaults(self) -> NDArray[np.float64]:
        """Default values of the parameters, shape (number of parameters,)."""
        return np.array([p.default for p in self.parameters])

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of the coordinates of each group of bodies."""
        names = dict.fromkeys(c.group for c in self.coordinates if c.group)
        return {name: tuple(c.name for c in self.coordinates if c.group == name) for name in names}

    @property
    def naming(self) -> Naming:
        """Units and descriptions of coordinates, parameters and outputs, and the measure of the outputs."""
        return self.once("naming", lambda: _naming(self))

    @property
    def residual(self) -> ca.Function:
        """Function (q, v, a, p) -> r, shape (n,): the equations with the elements' forces put in."""
        return self.once("residual", lambda: _residual(self))

    @property
    def ode(self) -> ca.Function:
        """Function (x, p) -> dx/dt of the state x = (all q, velocities of the second-order coordinates)."""
        return self.once("ode", lambda: _first_order_form(self))

    @property
    def ode_jacobian(self) -> ca.Function:
        """Function (x, p) -> A, shape (n_states, n_states): derivative of `ode` with respect to the state."""
        return self.once("A", lambda: _state_matrix(self))

    @property
    def measure(self) -> ca.Function:
        """Function (q, v, p) -> y, shape (number of outputs,): the outputs, with the accelerations of the motion."""
        return self.once("measure", lambda: _measure(self))

    def measure_of(self, place: int) -> ca.Function:
        """Return (q, v, p) -> one output, without what only the others need."""

        def build() -> ca.Function:
            sx = self.measure.sx_in()
            return ca.Function("measure_of", sx, [self.measure(*sx)[place]])

        found: ca.Function = self.once(("measure", place), build)
        return found

    @property
    def linear(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Mass, damping and stiffness matrices at rest, functions of the parameter vector."""
        return self.once("linear", lambda: linear_matrices(self.residual))

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Return fresh symbols q, v, a, shape (n,), and p, shape (number of parameters,)."""
        sizes = (self.n, self.n, self.n, len(self.parameters))
        return tuple(ca.SX.sym(s, k) for s, k in zip("qvap", sizes, strict=True))  # type: ignore[return-value]

    def backwards(self) -> Dynamics:
        """Return the equations of the same motions backwards in time: velocities change their sign."""
        q, v, p = (self.residual_with_forces.sx_in(i) for i in (0, 1, 4))
        return replace(
            self,
            residual_with_forces=_backwards(self.residual_with_forces),
            elements=tuple(
                replace(e, argument=ca.Function("argument", [q, v, p], [e.argument(q, -v, p)])) for e in self.elements
            ),
            outputs=self.outputs and replace(self.outputs, with_forces=_backwards(self.outputs.with_forces)),
            once=Once(),
        )


def equations_of_motion(
    name: str,
    coordinates: Sequence[Coordinate],
    parameters: Sequence[Parameter],
    equations: Sequence[Any],
    elements: Sequence[Element] = (),
    description: str = "",
    outputs: Sequence[Output] = (),
) -> Dynamics:
    """Return the equations of motion of a system as a value; parameters and errors as of `System`."""
    coordinates, parameters, elements, outputs = check_names(
        name, coordinates, parameters, elements, description, outputs
    )
    r = check_equations(equations, coordinates, parameters, elements)
    q, v, a = (ca.vertcat(*s) for s in zip(*((c, c.dot, c.ddot) for c in coordinates), strict=True))
    p = ca.vertcat(*parameters) if parameters else ca.SX(0, 1)
    f = ca.vertcat(*elements) if elements else ca.SX(0, 1)
    residual = ca.Function("residual", [q, v, a, f, p], [r], list("qvafp"), ["r"])
    found = Dynamics(
        name=name,
        description=description,
        coordinates=coordinates,
        parameters=parameters,
        elements=tuple(attach(e, q, v, p) for e in elements),
        residual_with_forces=residual,
        second_order=orders(residual, coordinates),
        outputs=attach_outputs(outputs, q, v, a, f, p, f"system {name!r}"),
    )
    _check_leading_matrix(found)
    check_turns(found)
    return found


def _naming(system: Dynamics) -> Naming:
    known = [(s.name, s.unit, s.description) for s in (*system.coordinates, *system.parameters)]
    own = system.outputs
    known += zip(own.names, own.units, own.descriptions, strict=True) if own else ()
    return Naming(
        {name: unit for name, unit, _ in known if unit},
        {name: meaning for name, _, meaning in known if meaning},
        own.names if own else (),
        Measure(system.measure) if own else None,
    )


def _backwards(function: ca.Function) -> ca.Function:
    """Return a function of (q, v, a, f, p) of the reversed velocities."""
    q, v, a, f, p = function.sx_in()
    return ca.Function(function.name(), [q, v, a, f, p], [function(q, -v, a, f, p)], list("qvafp"), ["r"])


def _measure(system: Dynamics) -> ca.Function:
    """Return (q, v, p) -> outputs: accelerations, and rates of first order, are those of the equations of motion."""
    q, v, a, p = system.symbols()
    rates = solved_rates(system, system.residual(q, v, a, p), v, a)
    v_of, solved = rates[: system.n], iter(range(system.n, system.n_states))
    a_of = ca.vertcat(*(rates[next(solved)] if second else 0 for second in system.second_order))
    f = ca.vertcat(*(e.force(e.argument(q, v_of, p), p) for e in system.elements))
    y = system.outputs.with_forces(q, v_of, a_of, f, p) if system.outputs else ca.SX(0, 1)
    return ca.Function("measure", [q, v, p], [ca.densify(y)], list("qvp"), ["y"])


def _check_leading_matrix(system: Dynamics) -> None:
    """Raise `ModelError` unless the equations can be solved for the highest derivatives."""
    q, v, a, p = system.symbols()
    top = ca.vertcat(*(a[i] if second else v[i] for i, second in enumerate(system.second_order)))
    E = ca.jacobian(system.residual(q, v, a, p), top)
    if ca.depends_on(E, top):
        raise ModelError(
            f"system {system.name!r}: a highest derivative enters nonlinearly; write the equations linear in the "
            "accelerations (or in the velocities of first-order coordinates)."
        )
    at_rest = ca.Function("E", [q, v, a, p], [E])(0, 0, 0, system.defaults).full()
    at_rest_r = system.residual(0, 0, 0, system.defaults).full()
    if not (np.isfinite(at_rest).all() and np.isfinite(at_rest_r).all()):
        raise ModelError(
            f"system {system.name!r}: the equations give {at_rest_r.ravel()} at rest with the default parameters; "
            f"they must be finite there. {_not_finite(system)}"
        )
    scale = np.abs(at_rest).max(axis=1, initial=0.0, keepdims=True)
    scaled = at_rest / np.where(scale > 0, scale, 1.0)
    if np.linalg.matrix_rank(scaled) < system.n:
        null = np.abs(np.linalg.svd(scaled)[2][-1])
        guilty = [c.name for c, w in zip(system.coordinates, null, strict=True) if w > 0.1 * null.max()]
        raise ModelError(
            f"system {system.name!r}: the mass matrix is singular at the default parameters (coordinates "
            f"{', '.join(guilty)}); give each coordinate a mass (second order) or a rate (first order)."
        )


def _not_finite(system: Dynamics) -> str:
    """Return a sentence on what makes the equations infinite or undefined at rest."""
    q, v, a = (ca.vertcat(*s) for s in zip(*((c, c.dot, c.ddot) for c in system.coordinates), strict=True))
    p = ca.vertcat(*system.parameters) if system.parameters else ca.SX(0, 1)
    r = system.residual(q, v, a, p)
    found = []
    for i in range(system.n):
        for what, expression in divisions(ca.Function("row", [q, v, a, p], [r[i]])(q, v, a, p)):
            value = float(ca.Function("value", [q, v, a, p], [expression])(0, 0, 0, system.defaults))
            if (value == 0 and "root" not in what) or (value < 0 and "divides" not in what):
                found.append(f"equation {i + 1} {what} {expression}, which is {value:g} there")
    if not found:
        return "Look for a number that is infinite or not a number (NaN)."
    return (
        f"But {'; '.join(found)}. Where a quotient has a limit, write hbbogie.model.quotient(numerator, denominator, "
        "limit), and hbbogie.model.magnitude(x, y) for the root of a sum of squares."
    )


def _residual(system: Dynamics) -> ca.Function:
    """Return (q, v, a, p) -> r with the elements' forces put in."""
    q, v, a, p = system.symbols()
    f = ca.vertcat(*(e.force(e.argument(q, v, p), p) for e in system.elements))
    return ca.Function("residual", [q, v, a, p], [system.residual_with_forces(q, v, a, f, p)], list("qvap"), ["r"])


def _state_matrix(system: Dynamics) -> ca.Function:
    """Return (x, p) -> A, the derivative of the first-order form with respect to the state."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    return ca.Function("A", [x, p], [ca.jacobian(system.ode(x, p), x)], ["x", "p"], ["A"])


def _first_order_form(system: Dynamics) -> ca.Function:
    """Return (x, p) -> dx/dt with x = (q, velocities of the second-order coordinates)."""
    q, v, a, p = system.symbols()
    dx = solved_rates(system, system.residual(q, v, a, p), v, a)
    return ca.Function("ode", [state_of(system, q, v), p], [ca.simplify(dx)], ["x", "p"], ["dx"])


def solved_rates(system: Dynamics, r: ca.SX, v: ca.SX, a: ca.SX) -> ca.SX:
    """Solve equations r = 0 for the rates of the state (q, v of the second-order coordinates), velocities first."""
    top = ca.vertcat(*(a[i] if s else v[i] for i, s in enumerate(system.second_order)))
    solved = ca.solve(ca.jacobian(r, top), -ca.substitute(r, top, ca.SX.zeros(system.n)))
    velocity = [v[i] if s else solved[i] for i, s in enumerate(system.second_order)]
    return state_of(system, ca.vertcat(*velocity), solved)


def state_of(system: Dynamics, q: ca.SX, v: ca.SX) -> ca.SX:
    """Return the entries q of all coordinates, then those of v of the second-order ones."""
    return ca.vertcat(q, *(v[i] for i, s in enumerate(system.second_order) if s))


def linear_matrices(residual: ca.Function) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return mass, damping and stiffness, functions of p: derivatives of the residual (q, v, a, p) at rest."""
    n, n_p = residual.size1_in(0), residual.size1_in(3)
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, n_p), strict=True))
    r = residual(q, v, a, p)
    qva, zero = ca.vertcat(q, v, a), ca.SX.zeros(3 * n)
    at_rest = [ca.substitute(ca.jacobian(r, s), qva, zero) for s in (a, v, q)]
    at_rest = [ca.sparsify(ca.simplify(m)) for m in at_rest]
    return tuple(ca.Function(name, [p], [m]) for name, m in zip(("M", "D", "K"), at_rest, strict=True))  # type: ignore[return-value]
