"""Whether a branch passes through a cycle that was found in another way."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import numpy as np

from hbbogie.branches.crossing import crossings
from hbbogie.branches.same import once_each
from hbbogie.errors import ModelError
from hbbogie.methods.equations import Equations
from hbbogie.results import Branch, Orbit
from hbbogie.results.failure import FAILURES
from hbbogie.solving.solvers import solve

BESIDE = 0.01  # distance from a branch, relative to its largest values, up to which a cycle is on it


def passes(equations: Equations, branch: Branch, cycle: Orbit) -> bool:
    """Tell whether a branch passes through a cycle, which another method or other harmonics may have found."""
    try:
        on_branch = crossings(equations, branch, cycle.parameters[branch.parameter])
    except ModelError:
        return True  # a family: it holds cycles of every amplitude
    with suppress(*FAILURES):
        cycle = solve(equations, cycle)
    return len(once_each([*on_branch, cycle])) == len(on_branch)


def is_near(branch: Branch, cycle: Orbit) -> bool:
    """Tell whether a branch passes a cycle: at its value in frequency and peaks, on straight lines between points."""
    value = cycle.parameters[branch.parameter]
    rows = np.column_stack([branch.omega, *(branch.amplitude(c) for c in cycle.coordinates)])
    mark = np.array([cycle.omega, *(cycle.amplitude(c) for c in cycle.coordinates)])
    size = np.maximum(np.abs(rows).max(axis=0), np.finfo(float).tiny)
    for (a, b), (x, y) in zip(pairwise(branch.values), pairwise(rows), strict=True):
        if min(a, b) <= value <= max(a, b):
            share = (value - a) / (b - a) if b != a else 0.0
            if (np.abs(x + share * (y - x) - mark) <= BESIDE * size + 0.5 * np.abs(y - x)).all():
                return True
    return False
