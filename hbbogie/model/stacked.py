"""CasADi functions at many points at once, in memory that NumPy and CasADi share: conversion would cost as much."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CHUNKS = (64, 8, 1)  # points of one call, the most of which there are as many


def at_each(once: Callable[[Any, Callable[[], Any]], Any], function: ca.Function, *given: Array) -> Array:
    """Return the values of a function at M points, shape (M, *its shape).

    Parameters
    ----------
    once : callable
        Where what is built is kept, as `System.once`.
    function : casadi.Function
        With one output.
    *given : ndarray, shape (M, rows of the argument)
    """
    M, (rows, columns) = len(given[0]), function.size_out(0)
    chunk = next((c for c in CHUNKS if c <= M), 1)
    # a key is that of this function for as long as it is kept
    _, evaluated = once(("at each", hash(function), chunk), lambda: (function, _full(function).map(chunk)))
    buffer, run = evaluated.buffer()
    short = -M % chunk
    full = [np.ascontiguousarray(np.concatenate([x, np.repeat(x[-1:], short, axis=0)]) if short else x) for x in given]
    out = np.empty((M + short, columns, rows))  # CasADi stores by columns
    for k in range(0, M, chunk):
        for i, x in enumerate(full):
            if x.size:
                buffer.set_arg(i, x[k : k + chunk].data)
        buffer.set_res(0, out[k : k + chunk].data)
        run()
    return out[:M].swapaxes(1, 2)


def _full(function: ca.Function) -> ca.Function:
    """Return a function with the entries that are always zero as well."""
    arguments = [ca.SX.sym("x", function.size1_in(i)) for i in range(function.n_in())]
    return ca.Function(function.name(), arguments, [ca.densify(function(*arguments))])
