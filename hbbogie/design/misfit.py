"""The least-squares program of identification: the cycles of all rows, and parameters common to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError, unknown_name
from hbbogie.methods.equations import Equations
from hbbogie.results import Orbit
from hbbogie.results.failure import ConvergenceError

Array = NDArray[np.float64]
IGNORED = 1e-3  # smallest weight in a robust fit, a millionth in the squares, which keeps the row's cycle determined
POLISHING = 50  # Gauss-Newton steps after IPOPT
UNDETERMINED = 1e-11  # relative singular value below which parameters count as undetermined


@dataclass(frozen=True, eq=False)
class Parametrisation:
    """Parameters of a system as functions of fewer numbers.

    Attributes
    ----------
    start : dict of float
        Name and first value of each number to be identified.
    parameters : callable
        Takes these numbers by name, returns a dict from parameter name to expression.

    Examples
    --------
    >>> both = Parametrisation({"share": 1.0}, lambda share: {"K1": 3e6 * share, "K2": 10e6 * share})
    >>> both.parameters(share=0.5)
    {'K1': 1500000.0, 'K2': 5000000.0}
    """

    start: Mapping[str, float]
    parameters: Callable[..., Mapping[str, Any]]

    __repr__ = brief


class Measured:
    """The measured rows as an array, divided into quantities met exactly and quantities weighted."""

    def __init__(self, equations: Equations, rows: Sequence[Mapping[str, float | None]], sigma: Mapping[str, float]):
        system = equations.system
        self.names = tuple(dict.fromkeys(name for row in rows for name in row))
        if not rows or not self.names:
            raise ModelError("identify: no rows; give one mapping of measured quantities for each cycle.")
        for name in self.names:
            if name != "omega" and name not in (*system.coordinate_names, *system.parameter_names):
                allowed = ("omega", *system.coordinate_names, *system.parameter_names)
                raise ModelError(f"identify: {unknown_name('measured quantity', name, allowed)}")
        entries: list[list[Any]] = [[row.get(n) for n in self.names] for row in rows]
        self.measured = np.array(entries, dtype=float)  # None becomes NaN
        used = np.isfinite(self.measured)
        lacking = [n for n, any_ in zip(self.names, used.any(axis=0), strict=True) if any_ and n not in sigma]
        if lacking or any(not s >= 0 for s in sigma.values()):
            raise ModelError(
                f"identify: sigma={dict(sigma)}; give a standard deviation of at least 0 for each measured quantity"
                + (f", also for {', '.join(lacking)}." if lacking else ".")
            )
        self.sigma = np.array([float(sigma.get(n, 1.0)) for n in self.names])
        self.held = [k for k, s in enumerate(self.sigma) if s == 0]
        self.weighed = [k for k, s in enumerate(self.sigma) if s > 0]
        for k in self.held:
            if not used[:, k].all():
                raise ModelError(f"identify: {self.names[k]!r} has sigma 0 but is not measured in every row.")
        self.own = [system.parameter_names.index(n) for n in self.names if n in system.parameter_names]
        size = np.nanmax(np.abs(np.where(used, self.measured, 0.0)), axis=0)
        self.size = np.where(size > 0, size, 1.0)

    def only(self, places: Sequence[int]) -> Measured:
        """Return the table of some of the rows."""
        table = copy(self)
        table.measured = self.measured[list(places)]
        return table


class Misfit:
    """The program in x = (theta, unknowns of row 1, unknowns of row 2, ...), all of order 1.

    Parameters
    ----------
    equations : Equations
    given : Parametrisation
    table : Measured
    """

    def __init__(self, equations: Equations, given: Parametrisation, table: Measured):
        self.equations, self.given, self.table, self.status = equations, given, table, "not solved"
        self.outside: list[str] = []  # names of the numbers that left their bounds
        system, own = equations.system, table.own
        self.theta_scale = np.array([abs(float(v)) or 1.0 for v in given.start.values()])
        symbols = [ca.SX.sym(n) for n in given.start]
        expressions = dict(given.parameters(**dict(zip(given.start, symbols, strict=True))))
        self.places = [system.parameter_names.index(system.parameter(n).name) for n in expressions]
        both = [n for n in expressions if system.parameter_names.index(n) in own]
        if both:
            raise ModelError(f"identify: {', '.join(both)} has its own value in each row; it cannot be free as well.")
        values, theta = (ca.vertcat(ca.SX(0, 1), *v) for v in (expressions.values(), symbols))
        self._parameters = ca.Function("parameters", [theta], [values, ca.jacobian(values, theta)])
        self.row_scale = np.r_[equations.scale, table.size[[table.names.index(system.parameter_names[i]) for i in own]]]
        self._build(self._row())

    # --- building ---------------------------------------------------------------------------

    def _row(self) -> ca.Function:
        """Return (unknowns, theta, measured) -> (g, dg/dy, dg/dtheta, r, dr/dy, dr/dtheta, computed) of one row."""
        equations, table = self.equations, self.table
        system, m = equations.system, equations.size
        y, t = ca.MX.sym("y", len(self.row_scale)), ca.MX.sym("t", len(self.theta_scale))
        measured = ca.MX.sym("measured", len(table.names))
        z, own = (y * self.row_scale)[:m], (y * self.row_scale)[m:]
        values, slopes = self._parameters(t * self.theta_scale)
        p = ca.MX(system.vector())
        for k, i in enumerate(table.own):
            p[i] = own[k]
        for k, i in enumerate(self.places):
            p[i] = values[k]
        F, J = equations.derivatives((*table.own, *self.places))(z, p)
        rows = 1 / equations.residual_scale
        F_y = ca.diag(rows) @ J[:, : len(self.row_scale)] @ np.diag(self.row_scale)
        F_t = ca.diag(rows) @ J[:, len(self.row_scale) :] @ slopes @ np.diag(self.theta_scale)
        computed = ca.vertcat(*(self._quantity(n, z, p) for n in table.names))
        difference = measured - computed
        held = difference[table.held] / table.size[table.held] if table.held else ca.MX(0, 1)
        residual = difference[table.weighed] / table.sigma[table.weighed]
        outputs = [
            ca.vertcat(F * rows, held),
            ca.vertcat(F_y, ca.jacobian(held, y)),
            ca.vertcat(F_t, ca.jacobian(held, t)),
            residual,
            ca.jacobian(residual, y),
            ca.jacobian(residual, t),
            computed,
        ]
        return ca.Function("row", [y, t, measured], [ca.densify(o) for o in outputs])

    def _quantity(self, name: str, z: ca.MX, p: ca.MX) -> ca.MX:
        system = self.equations.system
        if name == "omega":
            return self.equations.frequency(z)
        if name in system.parameter_names:
            return p[system.parameter_names.index(name)]
        return ca.norm_2(self.equations.coefficients(z, p)[1:3, system.index(name)])

    def _build(self, row: ca.Function) -> None:
        """Assemble the rows, and build the solver."""
        table, n_t, n_y = self.table, len(self.theta_scale), len(self.row_scale)
        R, K = len(table.measured), len(table.weighed)
        measured = np.nan_to_num(table.measured).T
        x, w = ca.MX.sym("x", n_t + R * n_y), ca.MX.sym("w", K * R)
        Y = ca.reshape(x[n_t:], n_y, R)
        g, G_y, G_t, r, r_y, r_t, computed = row.map(R)(Y, ca.repmat(x[:n_t], 1, R), measured)
        whole = [
            ca.horzcat(*([ca.vertcat(*ca.horzsplit(c, n_t))] if n_t else []), ca.diagcat(*ca.horzsplit(b, n_y)))
            for b, c in ((G_y, G_t), (r_y, r_t))
        ]
        # scale the objective to order 1: residuals count in units of the largest size over sigma
        self.unit = float(np.max(table.size[table.weighed] / table.sigma[table.weighed], initial=1.0))
        r = ca.vec(r) * w / self.unit
        J = ca.diag(w) @ whole[1] / self.unit
        self.functions = ca.Function("misfit", [x, w], [ca.vec(g), whole[0], r, J])
        self._computed = ca.Function("computed", [x], [computed])
        f, lam_f, lam_g = 0.5 * ca.sumsqr(r), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        H = ca.triu(lam_f * (J.T @ J))
        options = {
            "print_time": False,
            "grad_f": ca.Function("grad_f", [x, w], [f, J.T @ r], ["x", "p"], ["f", "grad_f_x"]),
            "jac_g": ca.Function("jac_g", [x, w], [ca.vec(g), whole[0]], ["x", "p"], ["g", "jac_g_x"]),
            "hess_lag": ca.Function("hess_lag", [x, w, lam_f, lam_g], [H], ["x", "p", "lam_f", "lam_g"], ["h"]),
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 200, "tol": 1e-12, "mu_init": 1e-6,
                      "bound_push": 1e-8, "bound_frac": 1e-8, "nlp_scaling_method": "none"},
        }  # fmt: skip
        self.solver = ca.nlpsol("identify", "ipopt", {"x": x, "p": w, "f": f, "g": ca.vec(g)}, options)

    # --- solving ----------------------------------------------------------------------------

    def start(self, orbits: Sequence[Orbit]) -> Array:
        """Return x at the start values with the given cycles."""
        names = [self.equations.system.parameter_names[i] for i in self.table.own]
        rows = [np.r_[self.equations.encode(o), [o.parameters[n] for n in names]] / self.row_scale for o in orbits]
        return np.r_[np.array(list(self.given.start.values())) / self.theta_scale, *rows]

    def solve(self, x: Array, weights: Array) -> Array:
        """Return the minimum for the given weights, shape (rows, quantities), by IPOPT and then Gauss-Newton steps.

        Raises
        ------
        ConvergenceError
            When it does not converge.
        """
        w, (lower, upper) = weights[:, self.table.weighed].ravel(), self._bounds()
        result = self.solver(x0=np.clip(x, lower, upper), p=w, lbx=lower, ubx=upper, lbg=0, ubg=0)
        statistics = self.solver.stats()
        said = f"IPOPT says {statistics['return_status']!r} after {statistics['iter_count']} iterations"
        x = result["x"].full().ravel()
        polished = self.polish(x, weights)
        if polished is None:
            said += f"; {', '.join(self.outside)} would leave its bounds" if self.outside else ""
            raise ConvergenceError(
                f"identify: the least-squares program did not converge ({said}); start nearer, free fewer parameters, "
                "or leave out rows that the system cannot meet.",
                None,
                {"return_status": statistics["return_status"], "iterations": statistics["iter_count"]},
            )
        self.status = f"converged: {said}, then Gauss-Newton steps to round-off"
        return polished

    def polish(self, x: Array, weights: Array) -> Array | None:
        """Return the minimum near x by Gauss-Newton steps; None if they diverge or theta leaves its bounds."""
        n, (lower, upper) = len(self.theta_scale), self._bounds()
        w, before, self.outside = weights[:, self.table.weighed].ravel(), np.inf, []
        for _ in range(POLISHING):
            g, G, r, J = (m.full() for m in self.functions(x, w))
            if not (np.isfinite(G).all() and np.isfinite(J).all()):
                return None
            back, Z = _split(G)
            d = -back @ g.ravel()
            d = d + Z @ np.linalg.lstsq(J @ Z, -(r.ravel() + J @ d), rcond=1e-14)[0]
            x, size = x + d, float(np.abs(d).max())
            self.outside = [s for s, bad in zip(self.given.start, (x < lower) | (x > upper), strict=False) if bad]
            if self.outside or not np.abs(d[n:]).max() <= 1.0:
                return None
            if size <= 1e-12 or 0.3 * before < size <= 1e-7:  # to round-off, larger for weakly determined parameters
                return x
            before = size
        return None

    def _bounds(self) -> tuple[Array, Array]:
        system, own, R = self.equations.system, self.table.own, len(self.table.measured)
        known = set(system.parameter_names)
        parts = []
        for k, z in ((0, self.equations.lower), (1, self.equations.upper)):
            free = -np.inf if k == 0 else np.inf
            theta = [system.parameter(n).bounds[k] if n in known else free for n in self.given.start]
            row = np.r_[z, [system.parameters[i].bounds[k] for i in own]] / self.row_scale
            parts.append(np.r_[np.array(theta) / self.theta_scale, np.tile(row, R)])
        return parts[0], parts[1]

    # --- results ----------------------------------------------------------------------------

    def theta(self, x: Array) -> Array:
        """Return the identified numbers."""
        return np.asarray(x[: len(self.theta_scale)] * self.theta_scale)

    def parameters(self, x: Array) -> dict[str, float]:
        """Return the resulting values of the system's parameters."""
        names = [self.equations.system.parameter_names[i] for i in self.places]
        return dict(zip(names, map(float, self._parameters(self.theta(x))[0].full().ravel()), strict=True))

    def computed(self, x: Array) -> Array:
        """Return the computed quantities, shape (rows, quantities), in their units."""
        return np.asarray(self._computed(x).full().T)

    def misfit(self, x: Array) -> Array:
        """Return measured - computed, shape (rows, quantities), in their units; NaN where not measured."""
        return np.asarray(self.table.measured - self.computed(x))

    def covariance(self, x: Array, weights: Array) -> Array:
        """Return the covariance of the identified numbers for residuals of unit variance in units of sigma.

        Raises
        ------
        ModelError
            When the rows do not determine them.
        """
        _, G, _, J = (m.full() for m in self.functions(x, weights[:, self.table.weighed].ravel()))
        Z = _split(G)[1]
        _, s, Vt = np.linalg.svd(self.unit * J @ Z, full_matrices=True)
        s = np.r_[s, np.zeros(len(Vt) - len(s))]
        n = len(self.theta_scale)
        if s[-1] <= UNDETERMINED * s[0]:
            direction = np.abs(Z @ Vt[-1])[:n]
            guilty = [
                name for name, share in zip(self.given.start, direction, strict=True) if share > 0.1 * max(direction)
            ]
            raise ModelError(
                f"identify: the rows do not determine {', '.join(guilty)} (together); hold one of them, or give rows "
                "that tell them apart."
            )
        L = (Z @ Vt.T / s)[:n] * self.theta_scale[:, None]
        return np.asarray(L @ L.T)

    def orbits(self, x: Array) -> list[Orbit]:
        """Return the computed cycle of each row."""
        rows = x[len(self.theta_scale) :].reshape(-1, len(self.row_scale)) * self.row_scale
        system, m = self.equations.system, self.equations.size
        found = []
        for row in rows:
            p = system.vector()
            p[self.table.own], p[self.places] = row[m:], list(self.parameters(x).values())
            found.append(self.equations.decode(row[:m], p, "identified"))
        return found


def _split(G: Array) -> tuple[Array, Array]:
    """Return the pseudo-inverse of the constraints' Jacobian and a basis of its null space."""
    U, s, Vt = np.linalg.svd(G)
    rank = int((s > 1e-12 * s[0]).sum())
    return Vt[:rank].T / s[:rank] @ U[:, :rank].T, Vt[rank:].T
