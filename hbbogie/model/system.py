"""Systems: equations of motion written symbolically, with named coordinates and parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.brief import lines
from hbbogie.errors import ModelError, named
from hbbogie.model.checks import checked_value
from hbbogie.model.derivatives import state_matrix_at
from hbbogie.model.dynamics import Dynamics, equations_of_motion
from hbbogie.model.elements import AttachedLaw, Element
from hbbogie.model.laws import Law
from hbbogie.model.outputs import Output
from hbbogie.model.parts import Parts, is_odd, split
from hbbogie.model.ramps import Scalar
from hbbogie.model.symbols import Coordinate, Parameter
from hbbogie.model.values import Values
from hbbogie.results.naming import Naming
from hbbogie.results.pictures import page

Array = NDArray[np.float64]
T = TypeVar("T")
SHOWN = 8  # names shown at most


class System:
    """Equations of motion ``r(q, q', q'', p) = 0`` of n coordinates, first or second order, or mixed.

    Parameters
    ----------
    name : str
    coordinates : sequence of Coordinate
    parameters : sequence of Parameter
    equations : sequence of expressions
        One for each coordinate, each equal to zero.
    elements : sequence of Element
        The elements used in the equations.
    description : str
    outputs : sequence of Output
        Quantities of a motion that tables, figures, limits and studies then call by their names.

    Raises
    ------
    ModelError
        When the equations do not determine the motion; the message says which and why.

    Notes
    -----
    A system is a value: it never changes, copies, pickles, and `with_parameters` gives a new one, which shares the
    equations of motion, `dynamics`, and the functions built of them. Its `values` are read-only.
    Attributes found by symbolic analysis: `mass`, `damping`, `stiffness`, `nonlinear_coordinates`,
    `odd`, `inactive_parameters`.

    Examples
    --------
    >>> x, mu = Coordinate("x"), Parameter("mu", 1.0)
    >>> System("van der Pol", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x]).odd
    True
    """

    def __init__(
        self,
        name: str,
        coordinates: Sequence[Coordinate],
        parameters: Sequence[Parameter],
        equations: Sequence[Scalar],
        elements: Sequence[Element] = (),
        description: str = "",
        outputs: Sequence[Output] = (),
    ):
        self._dynamics = equations_of_motion(name, coordinates, parameters, equations, elements, description, outputs)
        self._values: Mapping[str, float] = Values({p.name: checked_value(p, p.default) for p in self.parameters})

    @classmethod
    def _of(cls, dynamics: Dynamics, values: Mapping[str, float]) -> System:
        """Return the system of equations that are analysed already, at values that are checked already."""
        system = cls.__new__(cls)
        system._dynamics, system._values = dynamics, Values(values)
        return system

    def __reduce__(self) -> tuple[Any, ...]:
        return System._of, (self._dynamics, dict(self._values))

    @property
    def dynamics(self) -> Dynamics:
        """The equations of motion, whatever the values of the parameters."""
        return self._dynamics

    @property
    def values(self) -> Mapping[str, float]:
        """Values of the parameters by name, read-only."""
        return self._values

    def once(self, key: Any, build: Callable[[], T]) -> T:
        """Return what ``build()`` made for this key: functions are built once, for all parameter values."""
        return self._dynamics.once(key, build)

    @classmethod
    def from_matrices(
        cls,
        name: str,
        mass: ArrayLike | ca.SX,
        damping: ArrayLike | ca.SX,
        stiffness: ArrayLike | ca.SX,
        elements: Mapping[str, tuple[Law, ArrayLike]] | None = None,
        parameters: Sequence[Parameter] = (),
        coordinates: Sequence[str] | None = None,
        description: str = "",
    ) -> System:
        """Build a system ``M q'' + D q' + K q + sum_e w_e law_e(w_e . q) = 0`` from matrices.

        Parameters
        ----------
        name : str
        mass, damping, stiffness : array_like or expression of the parameters, shape (n, n)
        elements : mapping from name to (law, w)
            Each law acts along the direction w, shape (n,).
        parameters : sequence of Parameter
            The parameters that the matrices and laws contain.
        coordinates : sequence of str
            Names; q1, q2, ... where left out.
        description : str

        Raises
        ------
        ModelError
            When a shape does not fit.
        """
        M, D, K = (ca.SX(_as_matrix(m)) for m in (mass, damping, stiffness))
        n = M.shape[0]
        for label, matrix in (("mass", M), ("damping", D), ("stiffness", K)):
            if matrix.shape != (n, n):
                raise ModelError(
                    f"system {name!r}: the {label} matrix has shape {matrix.shape}; "
                    f"all three must be square and of the size of the mass matrix, ({n}, {n})."
                )
        names = list(coordinates) if coordinates is not None else [f"q{i + 1}" for i in range(n)]
        if len(names) != n:
            raise ModelError(f"system {name!r}: got {len(names)} coordinate names for {n} coordinates.")
        cs = [Coordinate(c) for c in names]
        q, v, a = ca.vertcat(*cs), ca.vertcat(*(c.dot for c in cs)), ca.vertcat(*(c.ddot for c in cs))
        r = M @ a + D @ v + K @ q
        attached = []
        for label, (law, direction) in (elements or {}).items():
            w = np.asarray(direction, dtype=float)
            if w.shape != (n,):
                raise ModelError(f"element {label!r}: its direction has shape {w.shape}; it must be ({n},).")
            attached.append(Element(label, law, ca.dot(w, q)))
            r = r + ca.DM(w) * attached[-1]
        return cls(name, cs, parameters, ca.vertsplit(r), attached, description)

    # --- values of the parameters -------------------------------------------------------------

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name."""
        own = named(f"system {self.name!r}", "parameter", name, self.parameter_names)
        return self.parameters[self.parameter_names.index(own)]

    def index(self, coordinate: str) -> int:
        """Return the place of a coordinate, by its name."""
        name = named(f"system {self.name!r}", "coordinate", coordinate, self.coordinate_names)
        return self.coordinate_names.index(name)

    def with_parameters(self, /, **values: float) -> System:
        """Return the same system with other parameter values.

        Raises
        ------
        ModelError
            For an unknown name, a value that is not finite or outside the parameter's bounds.
        """
        own = self._values
        new = {name: value for name, value in values.items() if not (type(value) is float and value == own.get(name))}
        checked = {name: checked_value(self.parameter(name), value) for name, value in new.items()}
        return System._of(self._dynamics, {**self._values, **checked})

    def backwards(self) -> System:
        """Return the system whose motions are those of this one backwards in time."""
        return System._of(self._dynamics.backwards(), self._values)

    def vector(self, /, **values: float) -> Array:
        """Return all parameter values as a vector, shape (number of parameters,), with overrides."""
        merged = self.with_parameters(**values).values if values else self.values
        return np.array([merged[name] for name in self.parameter_names])

    # --- the equations of motion --------------------------------------------------------------

    @property
    def name(self) -> str:
        """Name of the system."""
        return self._dynamics.name

    @property
    def description(self) -> str:
        """What the system is."""
        return self._dynamics.description

    @property
    def coordinates(self) -> tuple[Coordinate, ...]:
        """The coordinates, in order."""
        return self._dynamics.coordinates

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, in order."""
        return self._dynamics.parameters

    @property
    def elements(self) -> tuple[AttachedLaw, ...]:
        """The elements, each with the functions of its law."""
        return self._dynamics.elements

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return self._dynamics.parameter_names

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, in order."""
        return tuple(c.name for c in self.coordinates)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in order."""
        return self.naming.outputs

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of the coordinates of each group of bodies."""
        return self._dynamics.groups

    @property
    def naming(self) -> Naming:
        """Units and descriptions of coordinates, parameters and outputs."""
        return self._dynamics.naming

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self._dynamics.n

    def state_matrix(self, x: Array, p: Array) -> Array:
        """Return `ode_jacobian` at a state, or the one beside it; raise `ConvergenceError` where there is none."""
        return state_matrix_at(self.name, self.ode_jacobian, x, p)

    @property
    def n_states(self) -> int:
        """Number of states of the first-order form."""
        return self._dynamics.n_states

    @property
    def second_order(self) -> tuple[bool, ...]:
        """Whether the second derivative of each coordinate occurs; else its first does."""
        return self._dynamics.second_order

    @property
    def residual(self) -> ca.Function:
        """Function (q, v, a, p) -> r, shape (n,): the equations of motion."""
        return self._dynamics.residual

    @property
    def residual_with_forces(self) -> ca.Function:
        """Function (q, v, a, f, p) -> r, shape (n,): the equations with the elements' forces f as arguments."""
        return self._dynamics.residual_with_forces

    @property
    def ode(self) -> ca.Function:
        """Function (x, p) -> dx/dt of the state x = (all q, velocities of the second-order coordinates)."""
        return self._dynamics.ode

    @property
    def ode_jacobian(self) -> ca.Function:
        """Function (x, p) -> A, shape (n_states, n_states): derivative of `ode` with respect to the state."""
        return self._dynamics.ode_jacobian

    @property
    def linear(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Mass, damping and stiffness matrices at rest, functions of the parameter vector."""
        return self._dynamics.linear

    # --- what symbolic analysis finds ---------------------------------------------------------

    def _matrix(self, which: int, values: Mapping[str, float]) -> Array:
        return np.asarray(self.linear[which](self.vector(**values)).full())

    def mass(self, /, **values: float) -> Array:
        """Return the mass matrix d r/d q'' at rest, shape (n, n)."""
        return self._matrix(0, values)

    def damping(self, /, **values: float) -> Array:
        """Return the damping matrix d r/d q' at rest, shape (n, n)."""
        return self._matrix(1, values)

    def stiffness(self, /, **values: float) -> Array:
        """Return the stiffness matrix d r/d q at rest, shape (n, n)."""
        return self._matrix(2, values)

    def parts(self, contact: bool, running: tuple[int, ...] = ()) -> Parts:
        """Return the system taken apart into linear matrices, remainder and contact elements, see `split`."""
        return self.once(("parts", contact, running), lambda: split(self._dynamics, contact, running=running))

    @property
    def nonlinear_coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates that enter the equations nonlinearly."""
        parts = self.parts(contact=True)
        return tuple(self.coordinate_names[i] for i in parts.nonlinear)

    @property
    def odd(self) -> bool:
        """Whether ``r(-q, -v, -a) = -r(q, v, a)`` for all states and parameters.

        Decided by evaluating the identity at random states of many magnitudes and random parameter
        values: it holds to round-off at all of them or the system is not called odd.
        """
        return self.once("odd", lambda: is_odd(self._dynamics, self._dynamics.defaults, spread=0.4))

    @property
    def inactive_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that enter neither an equation nor an output."""
        used = set(self.residual.jac_sparsity(0, 3).get_col())
        if self.output_names:
            used |= set(self._dynamics.measure.jac_sparsity(0, 2).get_col())
        return tuple(name for i, name in enumerate(self.parameter_names) if i not in used)

    def __repr__(self) -> str:
        orders = f"{sum(self.second_order)} of second order" if any(self.second_order) else "of first order"
        names = ", ".join(self.coordinate_names[:SHOWN]) + (" ..." if self.n > SHOWN else "")
        attached = ", ".join(f"{e.name} ({e.law})" for e in self.elements[:SHOWN])
        return lines(
            f"System {self.name!r}" + (f": {self.description}" if self.description else ""),
            f"{self.n} coordinates, {orders}: {names}",
            f"{len(self.parameters)} parameters: {self.naming.values(self.values, SHOWN)}" if self.parameters else "",
            f"{len(self.elements)} elements: {attached}" if self.elements else "",
        )

    def _repr_html_(self) -> str:
        named = [(c.name, c.description, "", c.unit) for c in self.coordinates]
        named += [(p.name, p.description, f"{self.values[p.name]:.6g}", p.unit) for p in self.parameters]
        return page(repr(self), [("name", "what it is", "value", "unit"), *named])


def _as_matrix(m: Any) -> Any:
    return m if isinstance(m, ca.SX) else np.atleast_2d(np.asarray(m, dtype=float))
