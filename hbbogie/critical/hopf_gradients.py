"""Hopf points with their gradient in all parameters."""

from __future__ import annotations

from hbbogie.critical.curvature import HopfConditions
from hbbogie.model.system import System
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.critical import Critical


def hopf_gradient(system: System, hopf: SpecialPoint) -> Critical:
    """Return a Hopf point with the gradient of its value, by implicit differentiation of its conditions."""
    at = HopfConditions(system, hopf, system.vector(**{hopf.parameter: hopf.value}))
    slopes = dict(zip(system.parameter_names, map(float, at.multipliers @ at.by_parameters), strict=True))
    del slopes[hopf.parameter]
    eigenvalue = at.eigenvalue
    return Critical(
        kind="hopf",
        parameter=hopf.parameter,
        value=hopf.value,
        extremum="",
        omega=hopf.omega,
        gradient=slopes,
        orbit=hopf.orbit,
        residual=abs(eigenvalue.real) / abs(eigenvalue),
        curvature=float("nan"),
        status=hopf.status,
    )
