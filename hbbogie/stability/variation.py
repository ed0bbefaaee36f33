"""The variational equations along an orbit: the state matrix, the lines of the contacts, and when these change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError
from hbbogie.model.dynamics import solved_rates, state_of
from hbbogie.model.elements import AttachedLaw
from hbbogie.model.system import System
from hbbogie.results import Orbit
from hbbogie.solving.newton import Buffered
from hbbogie.stability.signals import Places, Signals, signals

Array = NDArray[np.float64]

ROUND_OFF = 1e-13  # rad; of a phase of 2 pi and of the series


@dataclass(frozen=True, eq=False)
class Model:
    """What the variational equations need from a system, built once.

    Attributes
    ----------
    varying : ndarray of int, shape (m,)
        The states on which the state matrix depends when every contact element stays on one line.
    matrix : casadi.Function, (x[varying], lines, p) -> A
        lines, shape (2 contacts,): slope and intercept of each.
    norm : casadi.Function, (x[varying], lines, p) -> norm of A
    laws : Buffered, p -> (du/dq, du/dv, u at rest, offset, stiffness; slope, threshold, height)
        The affine arguments u of the contacts and the straight lines of their laws, one row per contact; then the ramps
        of all laws, one row per ramp.
    owner : ndarray of int, shape (number of ramps,)
        The contact to which each ramp belongs.
    direction : ndarray, shape (number of ramps,)
        The direction of each ramp, +1 or -1.
    """

    varying: NDArray[np.int_]
    matrix: ca.Function
    norm: ca.Function
    laws: Buffered
    owner: NDArray[np.int_]
    direction: Array


def contacts_of(system: System) -> list[AttachedLaw]:
    """Return the elements with piecewise-linear laws."""
    return [e for e in system.elements if e.ramps is not None]


def on_lines(system: System) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, list[AttachedLaw]]:
    """Return the first-order form with every contact on one of its lines: (q, v, lines, p, velocity, rates, contacts).

    lines, shape (2 contacts,), contains the slope and intercept of each. The state is x = (q, v of the second-order
    coordinates), and dx/dt = rates, whose first n entries are the velocity.
    """
    n, contacts = system.n, contacts_of(system)
    q, v, a, p = (ca.SX.sym(s, k) for s, k in zip("qvap", (n, n, n, len(system.parameters)), strict=True))
    lines = ca.SX.sym("lines", 2 * len(contacts))
    forces = []
    for e in system.elements:
        u = e.argument(q, v, p)
        i = 2 * contacts.index(e) if e in contacts else None
        forces.append(e.force(u, p) if i is None else lines[i] * u + lines[i + 1])
    r = system.residual_with_forces(q, v, a, ca.vertcat(*forces), p)
    rates = solved_rates(system.dynamics, r, v, a)
    return q, v, lines, p, rates[:n], rates, contacts


def _model(system: System) -> Model:
    q, v, lines, p, velocity, rates, contacts = on_lines(system)
    x = state_of(system.dynamics, q, v)
    A = ca.jacobian(rates, x)
    varying = sorted(set(ca.Function("A", [x, lines, p], [A]).jac_sparsity(0, 0).get_col()))
    u = ca.vertcat(*(e.argument(q, v, p) for e in contacts)) if contacts else ca.SX(0, 1)
    jumping = [i for i, e in enumerate(contacts) if e.heights is not None]
    for i in jumping:
        if ca.depends_on(contacts[i].argument(q, velocity, p), ca.vertcat(*(lines[2 * k + 1] for k in jumping))):
            raise ModelError(
                f"element {contacts[i].name!r}: its argument contains a rate that itself jumps with an element; let it "
                "depend on states (coordinates, and velocities of coordinates with an acceleration)."
            )
    rest = ca.substitute(u, ca.vertcat(q, v), ca.SX.zeros(2 * system.n))
    inputs = [x[varying], lines, p]
    ramps = [e.ramps(p) for e in contacts]
    heights = [e.heights(p) if e.heights else ca.SX.zeros(len(e.directions)) for e in contacts]
    of_contacts = [ca.jacobian(u, q), ca.jacobian(u, v), rest, *(ca.vertcat(*(r[i] for r in ramps)) for i in (0, 1))]
    of_ramps = [*(ca.vertcat(*(r[i] for r in ramps)) for i in (2, 3)), ca.vertcat(*heights)]
    return Model(
        np.array(varying, dtype=int),
        ca.Function("matrix", inputs, [A]),
        ca.Function("norm", inputs, [ca.norm_fro(A)]),
        Buffered(ca.Function("laws", [p], [ca.densify(x) for x in of_contacts + of_ramps])),
        np.repeat(np.arange(len(contacts)), [len(e.directions) for e in contacts]),
        np.array([d for e in contacts for d in e.directions], dtype=float),
    )


def check_orbit(system: System, orbit: Orbit) -> None:
    """Raise `ModelError` unless the orbit belongs to the system and its frequency makes sense."""
    if orbit.coordinates != system.coordinate_names:
        raise ModelError(
            f"the orbit belongs to {orbit.system!r} with coordinates {', '.join(orbit.coordinates)}; the "
            f"system {system.name!r} has {', '.join(system.coordinate_names)}. Give an orbit of the system."
        )
    if orbit.H and not (np.isfinite(orbit.omega) and orbit.omega > 0):
        raise ModelError(f"the orbit's frequency is {orbit.omega!r} rad/s; it must be a finite number above 0.")


class Waveforms:
    """P orbits as the variational equations see them: varying states and contact lines over the phase.

    Phases come with the place of the orbit to which each belongs, ``of``: in increasing order, or one for all.

    Parameters
    ----------
    system : System
    orbits : sequence of Orbit
    p : ndarray, shape (P, number of parameters)
        The parameter values of each.
    """

    def __init__(self, system: System, orbits: Sequence[Orbit], p: Array):
        self.system, self.p = system, p
        self.omega, self.H = np.array([orbit.omega for orbit in orbits]), max(orbit.H for orbit in orbits)
        self.model = system.once("variational model", lambda: _model(system))
        P, n, second = len(orbits), system.n, [i for i, s in enumerate(system.second_order) if s]
        position, velocity = np.eye(n), np.eye(n)[second]
        states = [np.vstack([position, 0 * velocity]), np.vstack([0 * position, velocity])]
        of_q, of_v = (np.broadcast_to(x, (P, *x.shape)) for x in states)
        self.all_states = signals(orbits, of_q, of_v, np.zeros((P, system.n_states)))
        dq, dv, *columns = (np.stack(values) for values in zip(*map(self.model.laws, p), strict=True))
        rest, self.offset, self.stiffness, *ramps = (c.reshape(P, -1) for c in columns)
        self.slope, self.threshold, self.height = ramps
        self.u = signals(orbits, dq, dv, rest)  # arguments of the contacts

    def states(self, tau: Array, of: Places = 0) -> Array:
        """Return the varying states at the phases tau, shape (len(tau), m)."""
        return np.empty((len(tau), 0)) if self.straight else self.all_states.at(tau, of=of)[:, self.model.varying]

    @property
    def straight(self) -> bool:
        """Whether the variational equations have constant coefficients between the switchings."""
        return not len(self.model.varying)

    def depth(self, tau: ArrayLike, of: Places = 0) -> Array:
        """Return how far each ramp is entered at the phases tau, shape (len(tau), number of ramps)."""
        u = self.u.at(np.atleast_1d(tau), of=of)
        return np.asarray(u[:, self.model.owner] * self.model.direction - self.threshold[of])

    def lines_of(self, active: NDArray[np.bool_], of: Places = 0) -> Array:
        """Return slope and intercept of each contact, shape (N, 2 contacts), where the given ramps act."""
        own = self.model.owner[:, None] == np.arange(self.offset.shape[1])
        slope = self.slope[of]
        rise = self.model.direction * (self.height[of] - slope * self.threshold[of])
        lines = [self.stiffness[of] + (active * slope) @ own, self.offset[of] + (active * rise) @ own]
        return np.stack(lines, axis=-1).reshape(len(active), -1)

    def lines(self, tau: Array, of: Places = 0) -> Array:
        """Return slope and intercept of each contact at the phases tau, shape (len(tau), 2 contacts)."""
        if not self.offset.size:
            return np.empty((len(tau), 0))
        return self.lines_of(self.depth(tau, of) > 0, of)

    @property
    def levels(self) -> tuple[NDArray[np.int_], Array]:
        """Contacts, shape (K,), and values of their arguments, shape (P, K), at which they change their lines."""
        values = (self.model.direction * self.threshold).tolist()
        pairs = sorted(set(zip(self.model.owner.tolist(), *values, strict=True)))
        contacts = np.array([pair[0] for pair in pairs], dtype=int)
        return contacts, np.reshape([pair[1:] for pair in pairs], (len(pairs), len(values))).T

    def switchings(self, end: float = 2 * np.pi) -> tuple[Array, NDArray[np.int_]]:
        """Return the phases from 0 to end at which a contact changes its line, rad, and whose; both increasing."""
        if not self.offset.size:
            return np.empty(0), np.empty(0, dtype=int)
        grid, u, slope = self.u.on_grid(self.H, end)
        contact, level = self.levels
        turns = slope[:, :-1] * slope[:, 1:] < 0
        above = u[:, :, contact] >= level[:, None]
        # u is monotone in cells without a turning point; the others are divided there, so that no contact is missed
        of, k, which = np.nonzero((above[:, :-1] != above[:, 1:]) & ~turns[:, :, contact])
        column = contact[which]
        cells = [(of, which, grid[k], grid[k + 1], u[of, k, column], u[of, k + 1, column])]
        cells += self._beside_turns(grid, u, slope, turns)
        of, which = (np.concatenate([cell[i] for cell in cells]) for i in (0, 1))
        order = np.argsort(of, kind="stable")
        of, which, *ends = (
            of[order],
            which[order],
            *(np.concatenate(x)[order] for x in list(zip(*cells, strict=True))[2:]),
        )
        found = _roots(self.u, 0, of, contact[which], level[of, which], *ends)
        order = np.lexsort((found, of))
        found, of = found[order], of[order]
        once = np.append(True, (np.diff(found) != 0) | (np.diff(of) != 0))[: len(found)]
        return found[once], of[once]

    def _beside_turns(self, grid: Array, u: Array, slope: Array, turns: NDArray[np.bool_]) -> list[tuple[Any, ...]]:
        """Return the two sides of each turning point between which and the ends of its cell a level is crossed."""
        contact, level = self.levels
        of, k, column = np.nonzero(turns)
        # in a cell a signal differs from the chord by no more than its second derivative allows
        aside = np.diff(grid)[k] ** 2 / 8 * self.u.bend[of, column]
        before, after = u[of, k, column], u[of, k + 1, column]
        low, high = np.minimum(before, after) - aside, np.maximum(before, after) + aside
        within = (level[of] >= low[:, None]) & (level[of] <= high[:, None]) & (contact == column[:, None])
        if not (near := within.any(axis=1)).any():
            return []
        of, k, column, before, after = (x[near] for x in (of, k, column, before, after))
        sides = slope[of, k, column], slope[of, k + 1, column]
        top = _roots(self.u, 1, of, column, np.zeros(len(k)), grid[k], grid[k + 1], *sides)
        there, cells = self.u.with_slope(top, column, 0, of)[0], []
        for low, high, first, last in ((grid[k], top, before, there), (top, grid[k + 1], there, after)):
            crosses = (first[:, None] >= level[of]) != (last[:, None] >= level[of])
            i, which = np.nonzero(crosses & (contact == column[:, None]))
            cells.append((of[i], which, low[i], high[i], first[i], last[i]))
        return cells

    def phases(self, end: float) -> tuple[Array, NDArray[np.int_]]:
        """Return 0, the switchings between 0 and end, and end, rad, of one orbit after the other, and whose."""
        switchings, of = self.switchings(end)
        inside, every = switchings < end - 1e-12, np.arange(len(self.omega))
        ends = np.concatenate([0.0 * every, switchings[inside], end + 0.0 * every])
        of = np.concatenate([every, of[inside], every])
        order = np.lexsort((ends, of))
        ends, of = ends[order], of[order]
        kept = np.append(True, (np.diff(ends) > 1e-12) | (np.diff(of) != 0))
        return ends[kept], of[kept]


def _roots(
    u: Signals,
    order: int,
    of: NDArray[np.int_],
    column: NDArray[np.int_],
    level: Array,
    low: Array,
    high: Array,
    first: Array,
    last: Array,
) -> Array:
    """Return where signals, or their derivatives, meet their levels between low and high (safeguarded Newton).

    ``first`` and ``last`` are their values there.
    """
    if not len(of):
        return np.empty(0)
    falling = first > last
    share = np.divide(first - level, first - last, out=np.full_like(level, 0.5), where=first != last)
    tau = low + np.clip(share, 0.01, 0.99) * (high - low)
    for _ in range(60):
        value, slope = u.with_slope(tau, column, order, of)
        f = value - level
        before = (f > 0) == falling
        low, high = np.where(before, tau, low), np.where(before, high, tau)
        step = tau - np.divide(f, slope, out=np.full_like(f, np.inf), where=slope != 0)
        # a root that is reached becomes a bound, which the next step may leave by round-off
        new = np.where((step >= low - ROUND_OFF) & (step <= high + ROUND_OFF), step, 0.5 * (low + high))
        tau, moved = new, np.abs(new - tau)
        if moved.max(initial=0.0) < ROUND_OFF:
            break
    return tau
