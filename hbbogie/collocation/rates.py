"""Rates of the first-order form with their derivatives, at many states at once."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, of_kind
from hbbogie.model.dynamics import state_of
from hbbogie.model.system import System
from hbbogie.stability.variation import contacts_of, on_lines

Array = NDArray[np.float64]


class Rates:
    """dx/dt = f(x, p) of a system and its derivatives in the state and in one parameter.

    Parameters
    ----------
    system : System
    parameter : str, optional
        Whose derivative is wanted; where left out it is zero.

    Raises
    ------
    ModelError
        When an element jumps.
    """

    def __init__(self, system: System, parameter: str | None = None):
        of_kind("Rates: system", system, System)
        jumping = [e.name for e in system.elements if e.heights is not None]
        if jumping:
            raise ModelError(
                f"system {system.name!r}: collocation needs continuous equations, and element {jumping[0]!r} jumps; "
                'take the method "exact" (hbbogie.exact) where the rest is linear, else HarmonicBalance.'
            )
        self.kinked = any(e.ramps is not None for e in system.elements)
        self.system, self.parameter = system, parameter
        self.place = None if parameter is None else system.parameter_names.index(system.parameter(parameter).name)

    def __call__(self, x: Array, p: Array, sides: Array | None = None) -> tuple[Array, Array, Array]:
        """Return f, its derivative in the state, and that in the parameter.

        Parameters
        ----------
        x : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        sides : ndarray, shape (K, number of ramps), optional
            1 where a ramp of a piecewise-linear law acts, else 0, see `sides`; by the states where left out.

        Returns
        -------
        ndarray, shape (K, n_states), (K, n_states, n_states) and (K, n_states)
        """
        K, n = x.shape
        given = sides is not None and self.kinked
        key = ("rates", self.place, K, given)
        function = self.system.once(key, lambda: _mapped(self.system, self.place, K, given))
        f, A, slope = np.empty((K, n)), np.empty((K, n, n)), np.empty((K, n))
        _evaluate(function, [x, p, *([sides] if sides is not None and given else [])], [f, A, slope])
        return f, A.swapaxes(1, 2), slope

    def of_one(self, p: Array) -> Callable[[Array], tuple[Array, Array]]:
        """Return f and its derivative in the state as a function of one state, for an integrator that calls it often.

        Parameters
        ----------
        p : ndarray, shape (number of parameters,)
        """
        n = self.system.n_states
        function = self.system.once(("rates", self.place, 1), lambda: _mapped(self.system, self.place, 1, False))
        buffer, evaluate = function.buffer()
        arguments, results = (np.empty(n), np.array(p, dtype=float)), (np.empty(n), np.empty((n, n)), np.empty(n))
        for i, values in enumerate(arguments):
            buffer.set_arg(i, values.data)
        for i, values in enumerate(results):
            buffer.set_res(i, values.data)

        def rates(x: Array, kept: object = buffer) -> tuple[Array, Array]:  # which ``evaluate`` does not keep itself
            arguments[0][:] = x
            evaluate()
            return results[0].copy(), results[1].T.copy()

        return rates

    def sides(self, x: Array, p: Array) -> Array | None:
        """Return where the ramps of piecewise-linear laws act, shape (K, number of ramps); None where there are none.

        Parameters
        ----------
        x : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        """
        return np.asarray(self.depths(x, p) > 0, dtype=float) if self.kinked else None

    def depths(self, x: Array, p: Array) -> Array:
        """Return how far each ramp of piecewise-linear laws is entered, shape (K, number of ramps).

        Parameters
        ----------
        x : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        """
        K, ramps = len(x), self.system.once("depths", lambda: _depths(self.system))
        function = self.system.once(("depths", K), lambda: ramps.map("depths", "serial", K, [1], []))
        depths = np.empty((K, ramps.size1_out(0)))
        _evaluate(function, [x, p], [depths])
        return depths

    def sensitivity(self, x: Array, p: Array, weights: Array, sides: Array | None = None) -> Array:
        """Return the sum over the states of weights . df/dp, shape (number of parameters,).

        Parameters
        ----------
        x, weights : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        sides : ndarray, shape (K, number of ramps), optional
            As of a call.
        """
        given = sides is not None and self.kinked
        key = ("rates in all parameters", len(x), given)
        function = self.system.once(key, lambda: _sensitivity(self.system, len(x), given))
        arguments = (x.T, p, weights.T, sides.T) if sides is not None and given else (x.T, p, weights.T)
        return np.asarray(function(*arguments).full().sum(axis=1))

    def bent(self, x: Array, p: Array, weights: Array, along: Array, sides: Array | None = None) -> Array:
        """Return the derivative of the weighted rates along a direction, and its own derivatives.

        Parameters
        ----------
        x, weights : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        along : ndarray, shape (K, n_states + 2)
            Change of the states, of the parameter, and of the logarithm of a factor of the rates.
        sides : ndarray, shape (K, number of ramps), optional
            As of a call.

        Returns
        -------
        ndarray, shape (K, n_states + 2)
            Derivatives in the states and in the parameter, and what they are of.
        """
        given = sides is not None and self.kinked
        key = ("second derivatives of the rates", self.place, len(x), given)
        function = self.system.once(key, lambda: _bent(self.system, self.place, len(x), given))
        arguments = (x.T, p, weights.T, along.T, *([sides.T] if sides is not None and given else []))
        return np.asarray(function(*arguments).full().T)

    def kinks(self, x: Array, p: Array, weights: Array, changes: Array, sides: Array) -> tuple[Array, Array]:
        """Return the derivative of weighted rates beyond a contact less that before it, and its rate along the motion.

        Parameters
        ----------
        x, weights : ndarray, shape (K, n_states)
            At contacts, where the rates themselves are the same on both sides.
        p : ndarray, shape (number of parameters,)
        changes, sides : ndarray, shape (K, number of ramps)
            1 or -1 where a ramp begins or ceases to act, else 0; where they act before it.

        Returns
        -------
        ndarray, shape (K, n_states + 1)
            In the states and the parameter.
        ndarray, shape (K,)
            Its first entries times the rates; its sign does not depend on whether a ramp begins or ceases to act.
        """
        function = self.system.once(("kinks", self.place), lambda: _kinks(self.system, self.place))
        jump, rate = function(x.T, p, weights.T, changes.T, sides.T)
        return jump.full().T, rate.full().ravel()


def _evaluate(function: ca.Function, arguments: list[Array], results: list[Array]) -> None:
    """Evaluate a function in place, without copies to and from CasADi's matrices."""
    buffer, evaluate = function.buffer()
    arguments = [np.ascontiguousarray(values, dtype=float) for values in arguments]
    for i, values in enumerate(arguments):
        buffer.set_arg(i, values.data)
    for i, values in enumerate(results):
        buffer.set_res(i, values.data)
    evaluate()


def _rates(system: System, given: bool) -> tuple[ca.SX, ca.SX, list[ca.SX], ca.SX]:
    """Return state, parameters, where ramps act if that is given, and the rates."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    if not given:
        return x, p, [], system.ode(x, p)
    q, v, lines, p, _, rates, contacts = on_lines(system)
    sides, straight, k = ca.SX.sym("sides", sum(len(e.directions) for e in contacts)), [], 0
    for e in contacts:
        offset, stiffness, rise, threshold = e.ramps(p)
        own = sides[k : k + len(e.directions)]
        straight += [stiffness + ca.dot(own, rise), offset - ca.dot(own * ca.DM(e.directions), rise * threshold)]
        k += len(e.directions)
    return state_of(system.dynamics, q, v), p, [sides], ca.substitute(rates, lines, ca.vertcat(*straight))


def _depths(system: System) -> ca.Function:
    x, p, _, f = _rates(system, False)
    q, v = x[: system.n], f[: system.n]
    depths = []
    for e in contacts_of(system):
        depths.append(ca.DM(e.directions) * e.argument(q, v, p) - e.ramps(p)[3])
    return ca.Function("depths", [x, p], [ca.densify(ca.vertcat(*depths))])


def _mapped(system: System, place: int | None, K: int, given: bool) -> ca.Function:
    one = system.once(("rates of one", place, given), lambda: _of_one(system, place, given))
    return one.map("rates", "serial", K, [1], [])


def _of_one(system: System, place: int | None, given: bool) -> ca.Function:
    x, p, sides, f = _rates(system, given)
    slope = ca.SX.zeros(system.n_states) if place is None else ca.jacobian(f, p[place])
    outputs = [ca.densify(f), ca.vec(ca.densify(ca.jacobian(f, x))), ca.densify(slope)]
    return ca.Function("rates", [x, p, *sides], outputs)


def _sensitivity(system: System, K: int, given: bool) -> ca.Function:
    x, p, sides, f = _rates(system, given)
    w = ca.SX.sym("w", system.n_states)
    one = ca.Function("sensitivity", [x, p, w, *sides], [ca.densify(ca.jtimes(f, p, w, True))])
    return one.map("sensitivity", "serial", K, [1], [])


def _bent(system: System, place: int | None, K: int, given: bool) -> ca.Function:
    x, p, sides, f = _rates(system, given)
    n = system.n_states
    w, along = ca.SX.sym("w", n), ca.SX.sym("along", n + 2)
    free = x if place is None else ca.vertcat(x, p[place])
    change = ca.dot(w, ca.jtimes(f, free, along[: free.numel()]) + along[n + 1] * f)
    slopes = ca.gradient(change, free)
    one = ca.Function("bent", [x, p, w, along, *sides], [ca.densify(ca.vertcat(slopes[: n + 1], change))])
    return one.map("bent", "serial", K, [1], [])


def _kinks(system: System, place: int | None) -> ca.Function:
    x, p, (sides,), f = _rates(system, True)
    w, changes = ca.SX.sym("w", system.n_states), ca.SX.sym("changes", sides.numel())
    free = x if place is None else ca.vertcat(x, p[place])
    jump = ca.gradient(ca.dot(w, ca.jtimes(f, sides, changes)), free)
    rate = ca.dot(jump[: system.n_states], f)
    return ca.Function("kinks", [x, p, w, changes, sides], [ca.densify(jump), ca.densify(rate)])
