"""Rigid contact geometry: where a wheelset touches its rails, over lateral shift, with the roll that it takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbbogie.errors import ModelError, positive
from hbbogie.railway.profiles import Profile
from hbbogie.results.contact_geometry import ContactGeometry

Array = NDArray[np.float64]
STEP = 0.1  # mm between the points of a wheel at which the gap is looked at first
LARGEST_ROLL = 0.05  # rad
ROUNDS = 80  # of the iteration for the roll
CLOSED = 1e-9  # mm: gaps on both sides that count as equal


def contact_geometry(
    wheel: Profile,
    rail: Profile,
    shift: ArrayLike,
    *,
    gauge: float = 1435.0,
    back_to_back: float = 1360.0,
    radius: float = 460.0,
    yaw: ArrayLike = 0.0,
    flange_to_rolling_circle: float = 70.0,
    gauge_height: float = 14.0,
    left_wheel: Profile | None = None,
    left_rail: Profile | None = None,
    left_radius: float | None = None,
) -> ContactGeometry:
    """Return where a rigid wheelset touches rigid rails.

    At each lateral shift the wheelset rolls until both wheels touch, each at the point where its gap to the rail is
    smallest. The left side is the mirror image of the right one unless it is given its own, as for measured profiles.

    Parameters
    ----------
    wheel, rail : Profile
        Of both sides, or of the right one.
    shift : array_like, shape (n,), mm
        Lateral position of the wheelset, positive to the right.
    gauge : float, mm
        Distance of the rails' gauge faces.
    back_to_back : float, mm
        Distance of the backs of the flanges.
    radius : float, mm
        Radius of the wheels at the rolling circle.
    yaw : float or array_like, shape (n,), rad
        Yaw angle of the wheelset. A yawed wheel touches before or behind its axle.
    flange_to_rolling_circle : float, mm
        Distance of the rolling circle from the back of the flange.
    gauge_height : float, mm
        How far below the top of the rail the gauge is measured.
    left_wheel, left_rail : Profile, optional
        Of the left side, written like those of the right one: flange and gauge face at y < 0.
    left_radius : float, optional, mm
        Radius of the left wheel at its rolling circle, where it differs.

    Raises
    ------
    ModelError
        When a profile ends before the contact is reached, the wheelset does not fit, or a length is not positive.

    Examples
    --------
    >>> from hbbogie.railway import contact_geometry, s1002, uic60
    >>> found = contact_geometry(s1002(), uic60(), [0.0, 2.0, 6.0])
    >>> found.radius_difference.round(2).tolist()
    [0.0, 0.8, 4.68]
    """
    lengths = {"gauge": gauge, "back_to_back": back_to_back, "radius": radius, "gauge_height": gauge_height}
    left_radius = radius if left_radius is None else left_radius
    for name, value in {**lengths, "left_radius": left_radius}.items():
        positive(name, value, "mm")
    y = np.atleast_1d(np.asarray(shift, dtype=float))
    if y.ndim != 1 or not np.isfinite(y).all():
        raise ModelError(f"shift: got an array of shape {y.shape}; give finite numbers in mm, in one list.")
    psi = np.broadcast_to(np.asarray(yaw, dtype=float), y.shape)
    half = back_to_back / 2 + flange_to_rolling_circle
    sides = [
        _Pair(w, r, half, gauge / 2 - _gauge_face(r, gauge_height), own, radius)
        for w, r, own in ((wheel, rail, radius), (left_wheel or wheel, left_rail or rail, left_radius))
    ]
    # the left wheel is a right wheel in the mirror
    both, yawed = np.concatenate([y, -y]), np.concatenate([psi, psi])
    pair = sides[0] if sides[0].same_as(sides[1]) else _Sides(*sides)
    roll, S = _equal_gaps(pair, both, yawed)
    n, p = len(y), np.concatenate([roll, -roll])
    Y, Z = pair.place(S, both, p, yawed)
    found, lowering = [], np.zeros(n)
    for side, at in zip(sides, (slice(n), slice(n, None)), strict=True):
        on_rail = Y[at] - side.offset
        lowering += (side.rail.height(on_rail) - Z[at] - side.rail.z.min()) / 2
        angle = np.arctan(-side.wheel.slope(S[at])) - p[at]
        found.append((side.radius + side.wheel.height(S[at]), angle, S[at], on_rail))
    names = ["/".join(dict.fromkeys(x.name for x in own)) for own in zip(*(s.profiles for s in sides), strict=True)]
    sides_of = [x for own in zip(*found, strict=True) for x in own]  # right and left radius, angle, ...
    return ContactGeometry(names[0], names[1], y, roll, lowering, *sides_of)


@dataclass(frozen=True, eq=False)
class _Pair:
    """A wheel above its rail, both on the right-hand side; lengths in mm.

    Attributes
    ----------
    wheel, rail : Profile
    half : float
        Distance of the rolling circle from the middle of the axle.
    offset : float
        Position of the rail's origin from the middle of the track.
    radius : float
    level : float
        Height of the axle above the rail tops from which the gap is measured, one for both sides.
    """

    wheel: Profile
    rail: Profile
    half: float
    offset: float
    radius: float
    level: float

    @property
    def profiles(self) -> tuple[Profile, Profile]:
        """Wheel and rail."""
        return self.wheel, self.rail

    def same_as(self, other: _Pair) -> bool:
        """Tell whether the other side has the same profiles and radius."""
        return self.profiles == other.profiles and self.radius == other.radius

    def place(self, S: Array, y: Array, p: Array, psi: Array) -> tuple[Array, Array]:
        """Return position and height of points of the wheel, at shifts y, rolls p and yaw angles psi."""
        across, down = self._turned(S, psi)
        return across * np.cos(p) - down * np.sin(p) + y, down * np.cos(p) + across * np.sin(p) - self.level

    def _turned(self, S: Array, psi: Array) -> tuple[Array, Array]:
        """Return where the lowest line of the yawed wheel passes its points, from the middle of the axle."""
        r = self.radius + self.wheel.height(S)
        lead = np.clip(-self.wheel.slope(S) * np.tan(psi), -1, 1)  # sine of the angle by which the contact leads
        return (self.half + S) * np.cos(psi) + r * lead * np.sin(psi), r * np.sqrt(1 - lead**2)

    def gap(self, S: Array, y: Array, p: Array, psi: Array) -> Array:
        """Return the height of the wheel's points above the rail; infinite beside it."""
        Y, Z = self.place(S, y, p, psi)
        return np.nan_to_num(self.rail.height(Y - self.offset) - Z, nan=np.inf)

    def gap_per_roll(self, S: Array, y: Array, p: Array, psi: Array) -> Array:
        """Return the derivative of the gap with respect to the roll at points of the wheel [mm/rad]."""
        across, down = self._turned(S, psi)
        Y = across * np.cos(p) - down * np.sin(p) + y
        dY, dZ = -across * np.sin(p) - down * np.cos(p), across * np.cos(p) - down * np.sin(p)
        return self.rail.slope(Y - self.offset) * dY - dZ

    def closest(self, y: Array, p: Array, psi: Array) -> Array:
        """Return the points of the wheel that are closest to the rail, one for each shift."""
        S = np.arange(self.wheel.y[0] + STEP, self.wheel.y[-1], STEP)
        gap = self.gap(S, y[:, None], p[:, None], psi[:, None])
        best = gap.argmin(axis=1)
        rows = np.arange(len(y))
        inside = (best > 0) & (best < len(S) - 1)
        near = np.clip(best, 1, len(S) - 2)
        inside &= np.isfinite(gap[rows, near - 1]) & np.isfinite(gap[rows, near + 1])
        if not inside.all():
            raise ModelError(
                f"at a lateral shift of {abs(y[~inside][0]):g} mm {self.wheel.name} touches {self.rail.name} where one "
                "of the profiles ends; give longer profiles, or smaller shifts."
            )
        return self._refined(S[best], y, p, psi)

    def _refined(self, S: Array, y: Array, p: Array, psi: Array) -> Array:
        """Return the minima of the gap within a step of points, by golden section."""
        golden = (np.sqrt(5) - 1) / 2
        low, high = S - STEP, S + STEP
        a, b = high - golden * (high - low), low + golden * (high - low)
        fa, fb = self.gap(a, y, p, psi), self.gap(b, y, p, psi)
        for _ in range(36):  # to about 1e-8 mm, where the gap no longer changes
            left = fa < fb
            low, high = np.where(left, low, a), np.where(left, b, high)
            new = np.where(left, high - golden * (high - low), low + golden * (high - low))
            a, b = np.where(left, new, b), np.where(left, a, new)
            f = self.gap(new, y, p, psi)
            fa, fb = np.where(left, f, fb), np.where(left, fa, f)
        return (low + high) / 2


@dataclass(frozen=True, eq=False)
class _Sides:
    """A wheelset whose sides differ: what `_Pair` answers, the first half of the rows for the right side."""

    right: _Pair
    left: _Pair

    def _both(self, ask: str, *rows: Array) -> list[Any]:
        k = len(rows[0]) // 2
        return [
            getattr(p, ask)(*(r[at] for r in rows)) for p, at in ((self.right, slice(k)), (self.left, slice(k, None)))
        ]

    def place(self, S: Array, y: Array, p: Array, psi: Array) -> tuple[Array, Array]:
        """Return position and height of points of the wheels, see `_Pair`."""
        right, left = self._both("place", S, y, p, psi)
        return np.concatenate([right[0], left[0]]), np.concatenate([right[1], left[1]])

    def gap(self, S: Array, y: Array, p: Array, psi: Array) -> Array:
        """Return the height of the wheels' points above the rails, see `_Pair`."""
        return np.concatenate(self._both("gap", S, y, p, psi))

    def gap_per_roll(self, S: Array, y: Array, p: Array, psi: Array) -> Array:
        """Return the derivative of the gap with respect to the roll, see `_Pair`."""
        return np.concatenate(self._both("gap_per_roll", S, y, p, psi))

    def closest(self, y: Array, p: Array, psi: Array) -> Array:
        """Return the points of the wheels that are closest to the rails, see `_Pair`."""
        return np.concatenate(self._both("closest", y, p, psi))


def _equal_gaps(pair: _Pair | _Sides, y: Array, psi: Array) -> tuple[Array, Array]:
    """Return the rolls at which both gaps are equal, and the contact points on right and left wheels.

    Newton's method on the difference of the gaps, which falls with the roll, kept inside a shrinking interval.
    """
    n = len(y) // 2
    p, low, high = np.zeros(n), np.full(n, -LARGEST_ROLL), np.full(n, LARGEST_ROLL)
    S = np.zeros(2 * n)
    open_ = np.arange(n)
    for _ in range(ROUNDS):
        rows = np.concatenate([open_, n + open_])
        at = y[rows], np.concatenate([p[open_], -p[open_]]), psi[rows]
        S[rows] = pair.closest(*at)
        gap, change = pair.gap(S[rows], *at), pair.gap_per_roll(S[rows], *at)
        k = len(open_)
        difference, rate = gap[:k] - gap[k:], change[:k] + change[k:]
        now = p[open_]
        low[open_] = np.where(difference > 0, now, low[open_])
        high[open_] = np.where(difference > 0, high[open_], now)
        new = now - difference / np.where(rate < 0, rate, -1.0)
        outside = (new <= low[open_]) | (new >= high[open_]) | (rate >= 0)
        going = (np.abs(difference) > CLOSED) & (high[open_] - low[open_] > 1e-14)
        p[open_[going]] = np.where(outside, (low[open_] + high[open_]) / 2, new)[going]
        open_ = open_[going]
        if not len(open_):
            break
    stuck = np.abs(np.abs(p) - LARGEST_ROLL) < 1e-6
    if stuck.any() or len(open_):
        at_shift = y[:n][stuck][0] if stuck.any() else y[open_[0]]
        raise ModelError(
            f"at a lateral shift of {at_shift:g} mm no roll below {LARGEST_ROLL:g} rad brings both wheels onto their "
            "rails; check gauge and back_to_back, or give smaller shifts."
        )
    return p, S


def _gauge_face(rail: Profile, gauge_height: float) -> float:
    """Return the position of the gauge face in the rail's profile [mm]."""
    top = int(rail.z.argmin())
    below = rail.z[: top + 1] - rail.z[top] - gauge_height
    if not below[0] > 0:
        raise ModelError(
            f"rail {rail.name!r}: its gauge side, y < 0, reaches {rail.z[0] - rail.z[top]:g} mm below the top, and the "
            f"gauge is measured {gauge_height:g} mm below; give a longer profile, or mirror the rail."
        )
    i = int(np.flatnonzero(below > 0)[-1])
    roots = rail.spline.solve(rail.z[top] + gauge_height, extrapolate=False)
    return float(roots[np.argmin(np.abs(roots - rail.y[i]))])
