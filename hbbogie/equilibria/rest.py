"""The equations of equilibria over a parameter, r(q, 0, 0, p) = 0, at many points at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.model.conserved import conserved_quantities, echelon, expression
from hbbogie.model.derivatives import beside
from hbbogie.model.system import System
from hbbogie.model.turns import turns_of
from hbbogie.solving.newton import Buffered

Array = NDArray[np.float64]
SAME_EQUATIONS, PART = 1e-12, 0.37  # relative change that is none, and the share of a turn that is no symmetry
CONSERVED = 1e-11  # share of the largest singular value of samples of the equations up to which one is zero
SINGULAR = 1e-11  # smallest singular value of a matrix, relative to the largest, that counts as zero
MANY = 100  # coordinates from which functions are called point by point


@dataclass(frozen=True, eq=False)
class Level:
    """What completes equations that leave a family of equilibria: r + directions mu = 0, rows (q - q0) = 0.

    Attributes
    ----------
    directions : ndarray, shape (n, k)
        The left null vectors of dr/dq.
    rows : ndarray, shape (k, n)
        The conserved quantities rows q.
    held : ndarray, shape (k,)
        Their values.
    zeros : int
        Number of eigenvalues of the state matrix that are zero for it.
    text : tuple of str
        A sentence for each.
    """

    directions: Array
    rows: Array
    held: Array
    zeros: int = 0
    text: tuple[str, ...] = ()

    @staticmethod
    def none(n: int) -> Level:
        """Return what holds nothing."""
        return Level(np.zeros((n, 0)), np.zeros((0, n)), np.zeros(0))

    @property
    def k(self) -> int:
        """Number of quantities held."""
        return len(self.held)


@dataclass(frozen=True, eq=False)
class Rest:
    """The equations F(u) = 0 of the equilibria of a system, u = (q, mu, parameter), m equations in m + 1 unknowns.

    Attributes
    ----------
    system : System
        Its values hold for all other parameters.
    parameter : str
    level : Level
        What is held where equilibria form families; mu has one entry for each.
    """

    system: System
    parameter: str
    level: Level
    p: Array = field(init=False)
    place: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "p", self.system.vector())
        object.__setattr__(self, "place", self.system.parameter_names.index(self.parameter))

    @property
    def m(self) -> int:
        """Number of equations."""
        return self.system.n + self.level.k

    @property
    def angles(self) -> NDArray[np.bool_]:
        """Which coordinates are angles: a whole turn changes no equation at rest, shape (n,)."""
        return self.turns > 0

    @property
    def turns(self) -> Array:
        """The whole turn of each angle, 0 of other coordinates, shape (n,)."""
        return self.system.once("angles", lambda: angles_of(self.system))

    @property
    def reach(self) -> Array:
        """Half a turn of each angle, also of those that turn only with others; 0 of other coordinates, shape (n,)."""
        return 0.5 * np.maximum(self.turns, turns_of(self.system.dynamics))

    def vector(self, value: float) -> Array:
        """Return the parameter vector at a value of the parameter."""
        p = self.p.copy()
        p[self.place] = value
        return p

    def state(self, u: Array) -> Array:
        """Return the state, shape (n_states,), of unknowns u."""
        return np.append(u[: self.system.n], np.zeros(self.system.n_states - self.system.n))

    def raw(self, u: Array) -> tuple[Array, Array]:
        """Return the residual at rest, shape (N, n), and its derivatives, as they are, shape (N, n, n + 1)."""
        first = self.system.once(("rest", self.place), lambda: _first(self.system, self.place))
        r, J = self._many("rest", first, u[:, : self.system.n], u[:, -1])
        return r[:, :, 0], J

    def evaluate(self, u: Array) -> tuple[Array, Array]:
        """Return the equations and their derivatives at many points, shapes (N, m) and (N, m, m + 1)."""
        n, k, level = self.system.n, self.level.k, self.level
        G, J = self.raw(u)
        J = beside(lambda q: self.raw(np.column_stack([q, u[:, -1]]))[1], u[:, :n], J)
        dG = J
        if k:
            dG = np.zeros((len(u), n + k, n + k + 1))
            dG[:, :n, :n], dG[:, :n, -1] = J[:, :, :n], J[:, :, n]
            dG[:, :n, n:-1], dG[:, n:, :n] = level.directions, level.rows
            G = np.concatenate([G + u[:, n:-1] @ level.directions.T, u[:, :n] @ level.rows.T - level.held], axis=1)
        return G, dG

    def pencil(self, u: Array) -> Array:
        """Return stiffness, damping and mass matrices at many points, shape (3, N, n, n)."""
        n = self.system.n
        f = self.system.once("rest pencil", lambda: _pencil(self.system))

        def at(q: Array) -> Array:
            (found,) = self._many("pencil", f, q, u[:, -1])
            return found

        flat = beside(at, u[:, :n], at(u[:, :n]))
        return flat.reshape(len(u), n, 3, n).transpose(2, 0, 1, 3)

    def pencil_slopes(self, u: Array, t: Array) -> Array:
        """Return the derivatives of the three matrices along directions t of u, shape (3, N, n, n)."""
        n = self.system.n
        f = self.system.once(("pencil slopes", self.place), lambda: _pencil_slopes(self.system, self.place))
        (flat,) = self._many("slopes", f, u[:, :n], u[:, -1], t[:, :n], t[:, -1:])
        return flat.reshape(len(u), n, 3, n).transpose(2, 0, 1, 3)

    def _many(self, key: str, function: ca.Function, q: Array, values: Array, *more: Array) -> list[Array]:
        """Return the outputs of a function at many points, by one call; each of shape (N, rows, columns)."""
        N = len(q)
        if q.shape[1] > MANY and N > 1:  # one by one: the call costs nothing then
            single = [
                self._many(key, function, q[i : i + 1], values[i : i + 1], *(m[i : i + 1] for m in more))
                for i in range(N)
            ]
            return [np.concatenate(parts) for parts in zip(*single, strict=True)]
        size = 1 << (N - 1).bit_length()  # few sizes, so that few functions are made
        mapped = self.system.once((key, self.place, size), lambda: Buffered(function.map(size)))
        fill = np.r_[np.arange(N), np.zeros(size - N, dtype=int)]
        p = np.tile(self.p, (size, 1))
        p[:, self.place] = values[fill]
        out = mapped(q[fill].ravel(), p.ravel(), *(m[fill].ravel() for m in more))
        return [o.T.reshape(size, -1, o.shape[0]).swapaxes(1, 2)[:N] for o in out]

    def singular(self, u: Array, tolerance: float = SINGULAR) -> NDArray[np.bool_]:
        """Tell at which points dF/d(q, mu) is singular, whatever the units of equations and unknowns."""
        J = self.evaluate(u)[1][:, :, :-1]
        J = np.where(np.isfinite(J).all(axis=(1, 2), keepdims=True), J, np.eye(self.m))
        for axis in (2, 1):
            size = np.abs(J).max(axis=axis, keepdims=True)
            J = J / np.where(size > 0, size, 1.0)
        sizes = np.linalg.svd(J, compute_uv=False)
        return np.asarray(sizes[:, -1] <= tolerance * sizes[:, 0])

    def rows(self, J: Array, scale: Array) -> Array:
        """Return the sizes of the equations, shape (..., m), in unknowns of a scale, shape (m + 1,) or (N, m + 1)."""
        n = self.system.n
        entries = np.abs(J) * scale[..., None, :]
        size = entries[..., :n].sum(axis=-1) + entries[..., -1]
        return np.where((size > 0) & np.isfinite(size), size, 1.0)


def conserved(system: System, parameter: str, values: tuple[float, float], start: Array) -> Level:
    """Return the linear quantities that the equations at rest conserve, held at the level of a start.

    Combinations of the equations at rest that are zero in every state, from the null space of samples of them.
    """
    n, place = system.n, system.parameter_names.index(parameter)
    rng = np.random.default_rng(1995)
    samples = 2 * n + 6
    size = np.array([_declared(b) for b in (c.bounds for c in system.coordinates)])
    nulls = []
    for value in values:
        p = system.vector()
        p[place] = value
        q = size[:, None] * rng.standard_normal((n, samples)) * 10.0 ** rng.uniform(-1, 1, (n, samples))
        q = np.array([_folded(row, c.bounds) for row, c in zip(q, system.coordinates, strict=True)])
        r = system.once(("residual", samples), lambda: system.residual.map(samples))(q, 0, 0, p).full()
        r = r[:, np.isfinite(r).all(axis=0)]
        if r.shape[1] <= n:
            return Level.none(n)
        rows = np.abs(r).max(axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        r = r / rows[:, None]
        columns = np.abs(r).max(axis=0)
        U, s, _ = np.linalg.svd(r / np.where(columns > 0, columns, 1.0), full_matrices=True)
        count = n - int((s > CONSERVED * max(s[0], 1e-300)).sum())
        nulls.append(U[:, n - count :] / rows[:, None] if count else np.zeros((n, 0)))
    directions = min(nulls, key=lambda N: N.shape[1])
    if not directions.shape[1]:
        return Level.none(n)
    directions = echelon(directions.T).T
    p = system.vector()
    p[place] = values[0]
    f = system.once("rest pencil", lambda: _pencil(system))
    flat = f(start, p).full().reshape(n, 3, n)
    first, second = (directions.T @ flat[:, i] for i in (1, 2))
    still = np.abs(first).max(axis=1) == 0
    rows = echelon(np.where(still[:, None], second, first))
    kept = conserved_quantities(system, p, np.append(size, np.ones(system.n_states - n)))[:, :n]
    text = tuple(
        f"{_what(expression(row, system.coordinate_names), bool(s), _in_span(row, kept))}: "
        f"held at {row @ start:.6g}, the level of the start"
        for row, s in zip(rows, still, strict=True)
    )
    return Level(directions / np.abs(directions).max(axis=0), rows, rows @ start, len(rows) + int(still.sum()), text)


def _what(quantity: str, average: bool, kept: bool) -> str:
    """Return what is said of a quantity that the equations at rest do not determine."""
    if average:
        return f"{quantity} is conserved on average"
    return f"{quantity} is conserved" if kept else f"the equations at rest do not determine {quantity}"


def _in_span(row: Array, rows: Array) -> bool:
    """Tell whether a row is a combination of others."""
    left = row - np.linalg.lstsq(rows.T, row, rcond=None)[0] @ rows if len(rows) else row
    return bool(np.abs(left).max() <= 1e-6 * np.abs(row).max())


def angles_of(system: System) -> Array:
    """Return the whole turn of each coordinate that is an angle, which changes no equation, 0 of others, shape (n,).

    It is the turn declared, and where none is 2 pi.
    """
    n, declared = system.n, turns_of(system.dynamics)
    turns = np.where(declared, declared, 2 * np.pi)
    q = np.random.default_rng(7).uniform(-1, 1, n)

    def away(share: float) -> Array:
        """Return by how much a share of the turn of each coordinate changes the equations at rest, shape (n,)."""
        at = [system.residual(q + share * turns * e, 0, 0, system.vector()).full() for e in (np.zeros(n), *np.eye(n))]
        return np.array([np.abs(r - at[0]).max() for r in at[1:]]) / (1 + np.abs(at[0]).max())

    turned = (away(1.0) <= SAME_EQUATIONS) & (away(PART) > SAME_EQUATIONS)
    return np.where(turned, turns, 0.0)


def _declared(bounds: tuple[float, float]) -> float:
    """Return the size of a coordinate from its bounds, 1 where nothing is said."""
    finite = [abs(b) for b in bounds if np.isfinite(b) and b]
    return max(finite, default=1.0)


def _folded(values: Array, bounds: tuple[float, float]) -> Array:
    """Return values moved into bounds."""
    low, high = bounds
    if np.isfinite(low) and np.isfinite(high):
        return low + (high - low) * (np.abs(values) % 1.0)
    if np.isfinite(low):
        return low + np.abs(values)
    return high - np.abs(values) if np.isfinite(high) else values


def _first(system: System, place: int) -> ca.Function:
    """Return (q, p) -> residual at rest, its derivative in (q, p[place])."""
    q, p = ca.SX.sym("q", system.n), ca.SX.sym("p", len(system.parameters))
    r = system.residual(q, 0, 0, p)
    J = ca.horzcat(ca.jacobian(r, q), ca.jacobian(r, p[place]))
    return ca.Function("rest", [q, p], [ca.densify(r), ca.densify(J)])


def _matrices(system: System) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return symbols q and p, and stiffness, damping and mass matrices at rest side by side."""
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (*[system.n] * 3, len(system.parameters)), strict=True))
    r = system.residual(q, v, a, p)
    J = ca.jacobian(r, ca.vertcat(q, v, a))
    return q, p, ca.substitute(J, ca.vertcat(v, a), ca.SX.zeros(2 * system.n))


def _pencil(system: System) -> ca.Function:
    q, p, J = _matrices(system)
    return ca.Function("pencil", [q, p], [ca.densify(J)])


def _pencil_slopes(system: System, place: int) -> ca.Function:
    q, p, J = _matrices(system)
    dq, dp = ca.SX.sym("dq", system.n), ca.SX.sym("dp")
    along = ca.vertcat(dq, *(dp if i == place else ca.SX(0) for i in range(len(system.parameters))))
    entries = ca.vertcat(*J.nonzeros()) if J.nnz() else ca.SX(0, 1)
    slopes = ca.SX(J.sparsity(), ca.jtimes(entries, ca.vertcat(q, p), along))
    return ca.Function("pencil_slopes", [q, p, dq, dp], [ca.densify(slopes)])
