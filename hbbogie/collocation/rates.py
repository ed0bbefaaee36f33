"""Rates of the first-order form with their derivatives, at many states at once."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.errors import ModelError, of_kind
from hbbogie.model.system import System

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
        When an element jumps, or is piecewise linear and a parameter is given.
    """

    def __init__(self, system: System, parameter: str | None = None):
        of_kind("Rates: system", system, System)
        kinked = [e.name for e in system.elements if e.ramps is not None]
        jumping = [e.name for e in system.elements if e.heights is not None]
        if kinked and (parameter is not None or jumping):
            what = "jumps" if jumping else "is piecewise linear"
            raise ModelError(
                f"system {system.name!r}: collocation needs smooth equations{'' if jumping else ' for a branch'}, and "
                f'element {(jumping or kinked)[0]!r} {what}; take the method "exact" (hbbogie.exact) where the rest '
                "is linear, else HarmonicBalance."
            )
        self.kinked = bool(kinked)
        self.system, self.parameter = system, parameter
        self.place = None if parameter is None else system.parameter_names.index(system.parameter(parameter).name)

    def __call__(self, x: Array, p: Array) -> tuple[Array, Array, Array]:
        """Return f, its derivative in the state, and that in the parameter.

        Parameters
        ----------
        x : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)

        Returns
        -------
        ndarray, shape (K, n_states), (K, n_states, n_states) and (K, n_states)
        """
        K, n = x.shape
        function = self.system.once(("rates", self.place, K), lambda: _mapped(self.system, self.place, K))
        buffer, evaluate = function.buffer()  # without copies to and from CasADi's matrices
        arguments = np.ascontiguousarray(x), np.ascontiguousarray(p)
        f, A, slope = np.empty((K, n)), np.empty((K, n, n)), np.empty((K, n))
        for i, values in enumerate(arguments):
            buffer.set_arg(i, values.data)
        for i, values in enumerate((f, A, slope)):
            buffer.set_res(i, values.data)
        evaluate()
        return f, A.swapaxes(1, 2), slope

    def sensitivity(self, x: Array, p: Array, weights: Array) -> Array:
        """Return the sum over the states of weights . df/dp, shape (number of parameters,).

        Parameters
        ----------
        x, weights : ndarray, shape (K, n_states)
        p : ndarray, shape (number of parameters,)
        """
        function = self.system.once(("rates in all parameters", len(x)), lambda: _sensitivity(self.system, len(x)))
        return np.asarray(function(x.T, p, weights.T).full().sum(axis=1))


def _mapped(system: System, place: int | None, K: int) -> ca.Function:
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    f = system.ode(x, p)
    slope = ca.SX.zeros(system.n_states) if place is None else ca.jacobian(f, p[place])
    outputs = [ca.densify(f), ca.vec(ca.densify(ca.jacobian(f, x))), ca.densify(slope)]
    one = ca.Function("rates", [x, p], outputs)
    return one.map("rates", "serial", K, [1], [])


def _sensitivity(system: System, K: int) -> ca.Function:
    x, p, w = (
        ca.SX.sym(s, k) for s, k in (("x", system.n_states), ("p", len(system.parameters)), ("w", system.n_states))
    )
    one = ca.Function("sensitivity", [x, p, w], [ca.densify(ca.jtimes(system.ode(x, p), p, w, True))])
    return one.map("sensitivity", "serial", K, [1], [])
