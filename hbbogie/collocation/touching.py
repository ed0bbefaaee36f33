"""Where contacts begin or cease to close along branches of collocated cycles: grazings."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie.collocation.adaption import Placed, located_between
from hbbogie.collocation.curve import OnMeshCurve
from hbbogie.collocation.special import Special, marked
from hbbogie.results.piecewise import PiecewisePolynomial
from hbbogie.solving.curve import Point
from hbbogie.stability.variation import contacts_of

Array = NDArray[np.float64]
TOUCHING = 1e-6  # depth of a contact, relative to its range, that counts as none
SAME = 1e-6  # length of arc within which contacts happen together, as both sides of a symmetric motion


def deepest(curve: OnMeshCurve, point: Point) -> tuple[Array, Array]:
    """Return how far each ramp is entered at most along a cycle, and over which range its depth varies."""
    e = curve.equations
    states = e.unpack(point.u)[0].reshape(-1, e.n)
    depths = e.rates.depths(states, e.parameters(point.u)).reshape(e.N, e.m + 1, -1)
    low, high = PiecewisePolynomial(np.zeros(depths.shape[-1], dtype=bool), e.mesh, depths).extremes
    return high, np.maximum(high - low, np.finfo(float).tiny)


def grazings(points: list[Placed]) -> list[Special]:
    """Locate where contacts begin or cease to close between successive points of a branch."""
    met = [deepest(*point) for point in points]
    sides = np.array([np.where(np.abs(depth) > TOUCHING * size, np.sign(depth), 0.0) for depth, size in met])
    found: list[tuple[Special, list[tuple[int, bool]]]] = []
    for ramp in range(sides.shape[1]):
        for i, j in pairwise(np.flatnonzero(sides[:, ramp])):
            if sides[i, ramp] == sides[j, ramp]:
                continue
            beyond = [met[k][0][ramp] > 0 for k in range(i, j + 1)]
            place = i + next(k for k, (x, y) in enumerate(pairwise(beyond)) if x != y)
            a, b = points[place : place + 2]
            at, error = located_between(a, b, partial(_depth, ramp))
            here = replace(marked("grazing", at, error, "", a, b), place=int(place))
            contact = int(ramp), bool(sides[j, ramp] > 0)
            together = (c for s, c in found if s.place == place and abs(s.along - here.along) <= SAME)
            if (contacts := next(together, None)) is None:
                found.append((here, [contact]))
            else:
                contacts.append(contact)
    return [replace(special, status=_status(special, contacts)) for special, contacts in found]


def _depth(ramp: int, curve: OnMeshCurve, point: Point) -> float:
    return float(deepest(curve, point)[0][ramp])


def _status(special: Special, contacts: list[tuple[int, bool]]) -> str:
    """Return which contacts begin or cease to close."""
    e, levels = special.curve.equations, dict[str, list[str]]()
    ramps = [(element, k) for element in contacts_of(e.rates.system) for k in range(len(element.directions))]
    for ramp, closes in contacts:
        element, k = ramps[ramp]
        gap = element.directions[k] * float(element.ramps(e.parameters(special.point.u))[3][k])
        what = "begins to touch" if closes else "touches for the last time"
        levels.setdefault(f"{element.name} {what}", []).append(f"{gap:g}")
    return "; ".join(f"{what} at {' and '.join(gaps)}" for what, gaps in levels.items())
