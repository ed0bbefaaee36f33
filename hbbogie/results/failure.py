"""The result of a solve that failed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hbbogie.errors import ModelError
from hbbogie.results.orbit import Orbit

FAILURES = (ModelError, RuntimeError, np.linalg.LinAlgError)  # ConvergenceError and CasADi's among the second


class ConvergenceError(RuntimeError):
    """A solve did not converge.

    Attributes
    ----------
    orbit : Orbit or None
        The last iterate.
    statistics : dict
        What the solver counted: iterations, residual norm, return status, active bounds,
        worst equation.
    """

    def __init__(self, message: str, orbit: Orbit | None = None, statistics: Mapping[str, Any] | None = None):
        super().__init__(message)
        self.orbit = orbit
        self.statistics = dict(statistics or {})
