"""Systems that are linear between switchings: state matrices of every contact state, surfaces, derivatives.

The state is x = (all coordinates, velocities of those of second order), extended by 1, so that dx/dt = A x includes the
constant forces. On a surface, a piecewise-linear law changes from one line to another. The contact state, ``sides``,
says on which side of each surface the motion is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.errors import ModelError
from hbbogie.model.dynamics import state_of
from hbbogie.model.elements import AttachedLaw
from hbbogie.model.system import System
from hbbogie.stability.variation import contacts_of, on_lines

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

SAME = 1e-12  # relative difference up to which two surfaces count as one


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface at which laws change from one line to another.

    Attributes
    ----------
    name : str
        The element it belongs to.
    level : int
        Place of the ramp that defines it, among the ramps of all elements.
    jumps : bool
        Whether the vector field jumps there.
    """

    name: str
    level: int
    jumps: bool


@dataclass(frozen=True, eq=False)
class SwitchedLinear:
    """A system that is linear between the switchings of its K surfaces.

    Attributes
    ----------
    system : System
    surfaces : tuple of Surface, K of them
    mirror : ndarray of int, shape (K,), or None
        For odd systems, the surface that each becomes when the state changes its sign.
    flips : ndarray of bool, shape (K,), or None
        Whether this exchanges its sides.
    first : casadi.Function
        (sides, p) -> A and surfaces, both transposed.
    """

    system: System
    surfaces: tuple[Surface, ...]
    mirror: NDArray[np.int_] | None
    flips: Bools | None
    first: ca.Function

    __repr__ = brief

    @cached_property
    def N(self) -> int:
        """Number of states, the constant 1 included."""
        return self.system.n_states + 1

    @property
    def symmetric(self) -> bool:
        """Whether the system is odd, so that half a period is enough."""
        return self.mirror is not None

    def matrices(self, sides: Array, p: Array) -> tuple[Array, Array]:
        """Return state matrices and surfaces.

        Parameters
        ----------
        sides : ndarray, shape (M, K)
            1 on the positive side of a surface, 0 on the other.
        p : ndarray, shape (M, number of parameters)

        Returns
        -------
        A : ndarray, shape (M, N, N), 1/s
        rows : ndarray, shape (M, K, N)
            The positive side of surface k is where ``rows[k] @ x > 0`` [unit of the law's argument].
        """
        A, rows = self._called("first", self.first, sides, p)
        return A, rows

    def with_slopes(self, sides: Array, p: Array, place: int) -> tuple[Array, Array, Array, Array]:
        """Return state matrices and surfaces, and the derivatives of both in the parameter at that place."""
        function = self.system.once(("switched slopes", place), lambda: self._slopes(place))
        A, rows, dA, drows = self._called(("slopes", place), function, sides, p)
        return A, rows, dA, drows

    def pulled_back(self, sides: Array, p: Array, weights: Array, row_weights: Array) -> Array:
        """Return the derivative of ``sum(weights * A) + sum(row_weights * rows)`` in all parameters.

        Parameters
        ----------
        sides : ndarray, shape (M, K)
        p : ndarray, shape (M, number of parameters)
        weights : ndarray, shape (M, N, N)
        row_weights : ndarray, shape (M, K, N)

        Returns
        -------
        ndarray, shape (M, number of parameters)
        """
        function = self.system.once("switched pullback", self._pullback)
        (gradient,) = self._called("pullback", function, sides, p, weights, row_weights)
        return gradient[:, 0]

    def mirrored(self, sides: tuple[bool, ...]) -> tuple[bool, ...]:
        """Return the contact state of the motion with the opposite sign."""
        assert self.mirror is not None and self.flips is not None
        return tuple(bool(sides[j] != f) for j, f in zip(self.mirror, self.flips, strict=True))

    def _called(self, key: Any, function: ca.Function, *arguments: Array) -> list[Array]:
        """Return the outputs of a function for a stack of arguments, each of shape (M, ...)."""
        M = len(arguments[0])
        size = 1 << max(M - 1, 0).bit_length()  # only a few sizes, since each has its own function and memory
        call = self.system.once(("switched", key, size), lambda: _Mapped(function, size))
        return call(M, *arguments)

    def _slopes(self, place: int) -> ca.Function:
        sides, p = self._symbols()
        A, rows = self.first(sides, p)
        dA, drows = (ca.reshape(ca.jacobian(ca.vec(m), p[place]), *m.shape) for m in (A, rows))
        return ca.Function("slopes", [sides, p], [ca.densify(m) for m in (A, rows, dA, drows)])

    def _pullback(self) -> ca.Function:
        sides, p = self._symbols()
        A, rows = self.first(sides, p)
        weights, row_weights = ca.SX.sym("weights", *A.shape), ca.SX.sym("row_weights", *rows.shape)
        total = ca.dot(weights, A) + ca.dot(row_weights, rows)
        return ca.Function("pullback", [sides, p, weights, row_weights], [ca.densify(ca.gradient(total, p))])

    def _symbols(self) -> tuple[ca.SX, ca.SX]:
        return ca.SX.sym("sides", len(self.surfaces)), ca.SX.sym("p", len(self.system.parameters))


class _Mapped:
    """A function over a stack of arguments, on memory shared with CasADi.

    CasADi stores matrices by columns, so an array stacked row by row here is the transpose there.
    """

    def __init__(self, function: ca.Function, size: int):
        mapped = function.map(size)
        self.buffer, self.run = mapped.buffer()
        self.arguments = [np.zeros((size, function.numel_in(i))) for i in range(function.n_in())]
        self.results = [np.zeros((size, *function.size_out(i)[::-1])) for i in range(function.n_out())]
        for i, a in enumerate(self.arguments):
            self.buffer.set_arg(i, a.data)
        for i, r in enumerate(self.results):
            self.buffer.set_res(i, r.data)

    def __call__(self, M: int, *arguments: Array) -> list[Array]:
        for memory, given in zip(self.arguments, arguments, strict=True):
            memory[:M] = given.reshape(M, memory.shape[1])
            memory[M:] = memory[:1]
        self.run()
        return [r[:M].copy() for r in self.results]


def switched_linear(system: System) -> SwitchedLinear:
    """Return a system as one that is linear between switchings.

    Raises
    ------
    ModelError
        When anything else than piecewise-linear elements is nonlinear, or there is no such element.
    """
    return system.once("switched linear", lambda: _build(system))


def _build(system: System) -> SwitchedLinear:
    contacts = contacts_of(system)
    if not contacts:
        raise ModelError(
            f"system {system.name!r}: no element has a piecewise-linear law, so there is nothing that switches and "
            "no cycle in closed form; use HarmonicBalance (method 'mhb'), or Collocation where it is smooth."
        )
    bent = [e.name for e in system.elements if e.ramps is None]
    if bent:
        raise ModelError(
            f"system {system.name!r}: the law of {', '.join(bent)} is not piecewise linear, so the motion has no "
            "closed form; give a law of straight lines, such as Tabulated, or use HarmonicBalance (method 'mhb')."
        )
    q, v, lines, p, velocity, rates, _ = on_lines(system)
    x, ramps = state_of(system.dynamics, q, v), _ramps(contacts, p)
    u = [e.argument(q, velocity, p) for e in contacts]
    # the depth at a ramp is direction u - threshold; this gives one surface per ramp, before equal ones are merged
    depths = ca.vertcat(*(d * u[i] - g for i, d, _, g, _ in ramps))
    owner = np.array([i for i, *_ in ramps])
    sides = ca.SX.sym("sides", len(ramps))
    given = ca.vertcat(*_lines(contacts, ramps, sides, p))
    rates, depths = (ca.substitute(e, lines, given) for e in (rates, depths))
    if any(ca.which_depends(ca.vertcat(rates, depths), x, 2, False)):
        raise ModelError(
            f"system {system.name!r}: between the switchings of {', '.join(e.name for e in contacts)} the equations "
            "are not linear in the coordinates, so there is no closed form; use HarmonicBalance (method 'mhb')."
        )
    matrix, rows = (_extended(e, x) for e in (rates, depths))
    matrix = ca.vertcat(matrix, ca.SX.zeros(1, matrix.shape[1]))
    every = ca.Function("switched", [sides, p], [ca.densify(matrix.T), ca.densify(rows.T)])
    jumps = np.array([height is not None for *_, height in ramps])
    return _merged(system, every, [contacts[i].name for i in owner], jumps)


def _ramps(contacts: list[AttachedLaw], p: ca.SX) -> list[tuple[int, int, ca.SX, ca.SX, ca.SX | None]]:
    """Return owner, direction, stiffness, threshold and height (None if it does not jump) of every ramp."""
    found: list[tuple[int, int, ca.SX, ca.SX, ca.SX | None]] = []
    for i, e in enumerate(contacts):
        _, _, k, g = e.ramps(p)
        heights = e.heights(p) if e.heights else None
        found += [(i, d, k[j], g[j], None if heights is None else heights[j]) for j, d in enumerate(e.directions)]
    return found


def _lines(contacts: list[AttachedLaw], ramps: list[Any], sides: ca.SX, p: ca.SX) -> list[ca.SX]:
    """Return slope and intercept of each element in a contact state."""
    lines: list[ca.SX] = []
    for i, e in enumerate(contacts):
        offset, slope, _, _ = e.ramps(p)
        for r, (owner, d, k, g, height) in enumerate(ramps):
            if owner == i:
                slope = slope + sides[r] * k
                offset = offset + sides[r] * d * ((0 if height is None else height) - k * g)
        lines += [slope, offset]
    return lines


def _extended(e: ca.SX, x: ca.SX) -> ca.SX:
    """Return the matrix of an affine expression, for the state extended by 1."""
    zero = ca.SX.zeros(x.shape[0])
    return ca.horzcat(*(ca.substitute(part, x, zero) for part in (ca.jacobian(e, x), e)))


def _merged(system: System, every: ca.Function, names: list[str], jumps: Bools) -> SwitchedLinear:
    """Merge the ramps that begin at the same place for all parameters into one surface, and find mirror images."""
    R = len(names)
    # a second parameter vector distinguishes surfaces that are equal only by chance from those that are the same
    samples = [system.vector(), _other(system)]
    rows = np.hstack([every(np.zeros(R), p)[1].full().T for p in samples])
    place, sign, kept = np.zeros(R, dtype=int), np.ones(R), list[int]()
    for r in range(R):
        k, s = next(
            ((k, s) for k, other in enumerate(kept) for s in (1, -1) if _same(rows[r], s * rows[other])), (-1, 1)
        )
        if k < 0:
            kept.append(r)
            k = len(kept) - 1
        place[r], sign[r] = k, s
    surfaces = tuple(Surface(names[r], r, bool(jumps[place == k].any())) for k, r in enumerate(kept))
    sides, p = ca.SX.sym("sides", len(kept)), ca.SX.sym("p", len(system.parameters))
    full = ca.vertcat(*(sides[int(k)] if s > 0 else 1 - sides[int(k)] for k, s in zip(place, sign, strict=True)))
    A, depths = every(full, p)
    first = ca.Function("switched", [sides, p], [A, depths[:, kept]])
    mirror, flips = _mirror(rows[kept], system.n_states + 1) if system.odd else (None, None)
    return SwitchedLinear(system, surfaces, mirror, flips, first)


def _other(system: System) -> Array:
    """Return other parameter values, within the bounds."""
    p, rng = system.vector(), np.random.default_rng(0)
    low, high = (np.array([q.bounds[k] for q in system.parameters]) for k in (0, 1))
    return np.clip(np.where(p == 0, 1.0, p) * rng.uniform(0.9, 1.1, len(p)), low, high)


def _same(a: Array, b: Array) -> bool:
    return bool(np.abs(a - b).max() <= SAME * np.abs(a).max())


def _mirror(rows: Array, N: int) -> tuple[NDArray[np.int_] | None, Bools | None]:
    """Return the mirror image of each surface and whether its sides are exchanged; None if a surface has none."""
    signs = np.tile(np.append(-np.ones(N - 1), 1.0), rows.shape[1] // N)
    mirror, flips = [], []
    for row in rows * signs:
        found = [(j, s) for j, other in enumerate(rows) for s in (1, -1) if _same(row, s * other)]
        if not found:
            return None, None
        mirror.append(found[0][0])
        flips.append(found[0][1] < 0)
    return np.array(mirror), np.array(flips)
