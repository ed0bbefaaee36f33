"""Hopf points with their gradient in all parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hbbogie.equilibria.linearisation import Linearisation
from hbbogie.model.system import System
from hbbogie.results.branch import SpecialPoint
from hbbogie.results.critical import Critical


def hopf_gradient(system: System, hopf: SpecialPoint) -> Critical:
    """Return a Hopf point with the gradient of its value, by the exact derivative of the critical eigenvalue."""
    line = Linearisation(system.with_parameters(**{hopf.parameter: hopf.value}), hopf.parameter)
    p, rest = line.parameters(hopf.value), hopf.orbit.coefficients[0]
    x = np.concatenate([rest, np.zeros(system.n_states - system.n)])
    A = system.ode_jacobian(x, p).full()
    values, right = np.linalg.eig(A)
    k = int(np.argmin(np.abs(values - 1j * hopf.omega)))
    v = right[:, k]
    adjoint, left = np.linalg.eig(A.conj().T)
    w = left[:, int(np.argmin(np.abs(adjoint.conj() - values[k])))]
    f = system.once("eigenvalue slopes", lambda: _eigenvalue_slopes(system))
    growth = np.zeros(len(p), dtype=complex)
    for part, factor in ((v.real, 1.0), (v.imag, 1j)):
        d_p, d_x, K, r_p = (m.full() for m in f(x, p, part))
        moved = np.zeros((system.n_states, len(p)))
        if np.any(r_p):
            moved[: system.n] = -np.linalg.solve(K, r_p)  # the equilibrium moves with the parameters
        growth = growth + factor * (w.conj() @ (d_p + d_x @ moved))
    growth = growth / (w.conj() @ v)
    place = line.place
    slopes = -growth.real / growth.real[place]
    gradient = {n: float(s) for i, (n, s) in enumerate(zip(system.parameter_names, slopes, strict=True)) if i != place}
    residual = float(abs(values[k].real) / abs(values[k]))
    return Critical(
        kind="hopf",
        parameter=hopf.parameter,
        value=hopf.value,
        extremum="",
        omega=hopf.omega,
        gradient=gradient,
        orbit=hopf.orbit,
        residual=residual,
        curvature=float("nan"),
        status=hopf.status,
    )


def _eigenvalue_slopes(system: System) -> ca.Function:
    """Return (x, p, v) -> derivatives of A v in p and x, stiffness at rest, derivative of the residual in p."""
    x, p = ca.SX.sym("x", system.n_states), ca.SX.sym("p", len(system.parameters))
    v = ca.SX.sym("v", system.n_states)
    Av = ca.mtimes(system.ode_jacobian(x, p), v)
    r = system.residual(x[: system.n], 0, 0, p)
    out = [ca.jacobian(Av, p), ca.jacobian(Av, x), ca.jacobian(r, x[: system.n]), ca.jacobian(r, p)]
    return ca.Function("eigenvalue_slopes", [x, p, v], [ca.densify(m) for m in out])
