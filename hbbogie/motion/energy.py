"""Which groups of bodies move in a cycle: their shares of the kinetic energy, averaged over a period."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hbbogie import fourier
from hbbogie.errors import door
from hbbogie.model.system import System
from hbbogie.results import Orbit

Array = NDArray[np.float64]
MOVES = 0.1  # least energy of a group that moves, relative to that of the group with most
NAMED = 3  # groups named at most


@door(system=System, orbit=Orbit)
def energy_shares(system: System, orbit: Orbit) -> dict[str, float]:
    """Return the share of each group of bodies in the kinetic energy of a cycle, averaged over its period.

    The groups are those of the coordinates, `Coordinate(..., group=...)`. The mass matrix is that at rest.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle of the system.

    Returns
    -------
    dict of float, 1
        By the name of the group; what belongs to no group is left out. Empty for an equilibrium.
    """
    energy = _energies(system, orbit)
    if not energy.sum() > 0:
        return {}
    return {name: float(energy[_places(orbit, names)].sum() / energy.sum()) for name, names in system.groups.items()}


def moving_groups(system: System, orbit: Orbit) -> str:
    """Return which groups of bodies move in a cycle, such as "front bogie" or "both".

    A group moves that has at least a tenth of the kinetic energy of the group that has most, see `energy_shares`.

    Parameters
    ----------
    system : System
    orbit : Orbit
        A cycle of the system.

    Returns
    -------
    str
        The names of the groups that move; "both" or "all" where all of two or more do; "" where there are no groups.
    """
    shares = energy_shares(system, orbit)
    if not shares:
        return ""
    moving = [name for name, share in shares.items() if share >= MOVES * max(shares.values())]
    if len(moving) == len(shares) > 1:
        return "both" if len(moving) == 2 else "all"
    return " + ".join(moving) if len(moving) <= NAMED else f"{len(moving)} of {len(shares)} groups"


def group_states(system: System, cycles: list[Orbit]) -> Iterator[tuple[str, Array]]:
    """Yield states in which one group of bodies moves and all others rest, and then those of `together`.

    Parameters
    ----------
    system : System
    cycles : list of Orbit
        Each group moves as in the one where it moves most. Those that are added meanwhile count for the later states.

    Yields
    ------
    (str, ndarray of shape (n_states,))
        For people, and the state. Nothing with fewer than two groups.
    """
    yield from alone(system, cycles)
    yield from together(system, cycles)


def alone(system: System, cycles: list[Orbit]) -> list[tuple[str, Array]]:
    """Return states in which one group moves and all others rest, as in the cycle where that group moves most.

    The coordinate of the group that has most energy is at its crest.

    Parameters
    ----------
    system : System
    cycles : list of Orbit

    Returns
    -------
    list of (str, ndarray of shape (n_states,))
        For people, and the state. Empty with fewer than two groups.
    """
    if len(system.groups) < 2 or not cycles:
        return []
    return [(f"a state in which only the {name} moves", _state(system, cycles, name)) for name in system.groups]


def together(system: System, cycles: list[Orbit]) -> Iterator[tuple[str, Array]]:
    """Yield states in which several groups move, each as in `alone`: all of them, and of many also each two neighbours.

    A motion from such a state need not come to a cycle of any branch from a Hopf point. The states are one more than
    there are groups, and two: not one for each set of groups that may move.

    Parameters
    ----------
    system : System
    cycles : list of Orbit
        Those that are added meanwhile count for the later states.

    Yields
    ------
    (str, ndarray of shape (n_states,))
        For people, and the state.
    """
    names = list(system.groups)
    if len(names) > 2:
        for pair in pairwise(names):
            if states := [_state(system, cycles, name) for name in pair if cycles]:
                yield f"a state in which the {' and the '.join(pair)} move", _sum(states)
        if lags := _lags(system, cycles):
            states = [_state(system, cycles, name, lag) for name, lag in zip(names, lags, strict=True)]
            yield "a state in which all groups move, each after the one before as in their common cycle", _sum(states)
    if states := [x for _, x in alone(system, cycles)]:
        yield "a state in which all groups move", _sum(states)
        signs = (-1.0) ** np.arange(len(states))
        which = "both groups move" if len(states) == 2 else "all groups move, neighbours"
        yield (
            f"a state in which {which} in opposite ways",
            _sum([sign * x for sign, x in zip(signs, states, strict=True)]),
        )


def sets_looked_at(system: System) -> str:
    """Return of which sets of many groups `alone` and `together` have all move, for people."""
    k = len(system.groups)
    return f"of the {2**k - 1} sets of groups that may move at once {2 * k}: each alone, each two neighbours and all"


def _sum(states: list[Array]) -> Array:
    """Return the sum of states, and of what belongs to no group the mean."""
    return np.sum(states, axis=0) * np.where((np.array(states) != 0).sum(axis=0) > 1, 1 / len(states), 1.0)


def _state(system: System, cycles: list[Orbit], name: str, lag: float = 0.0) -> Array:
    """Return the state of a group so much before its crest [rad], in the cycle where it moves most; others rest."""
    orbit = max(cycles, key=lambda o: _energies(system, o)[_places(o, system.groups[name])].sum())
    others = [c for group, names in system.groups.items() if group != name for c in names]
    time = (_crest(system, orbit, name) - lag) / orbit.omega
    q, v = orbit.q(time)[0], orbit.v(time)[0]
    for x in (q, v):
        x[_places(orbit, others)] = 0.0
    return np.append(q, v[list(system.second_order)])


def _crest(system: System, orbit: Orbit, name: str) -> float:
    """Return the phase [rad] at which the coordinate of a group that has most energy is at its crest."""
    own = _places(orbit, system.groups[name])
    largest = own[int(np.argmax(_energies(system, orbit)[own]))]
    return float(np.arctan2(*orbit.coefficients[[2, 1], largest]))


def _lags(system: System, cycles: list[Orbit]) -> list[float]:
    """Return after the first group's crest [rad] those of all groups, as in cycles of neighbours; empty without them.

    Of each two neighbours that cycle counts in which they move most and others least.
    """
    names, lags = list(system.groups), [0.0]
    shares = [energy_shares(system, orbit) for orbit in cycles]
    for first, second in pairwise(names):
        both = [min(share.get(first, 0.0), share.get(second, 0.0)) for share in shares]
        k = int(np.argmax(both)) if both else -1
        if k < 0 or not both[k] >= MOVES * max(shares[k].values(), default=np.inf):
            return []
        lags.append(lags[-1] + _crest(system, cycles[k], second) - _crest(system, cycles[k], first))
    return lags


def _places(orbit: Orbit, names: tuple[str, ...] | list[str]) -> list[int]:
    return [orbit.index(name) for name in names]


def _energies(system: System, orbit: Orbit) -> Array:
    """Return the mean of v_i (M v)_i / 2 over the period for each coordinate, shape (n,)."""
    M = system.dynamics.linear[0](system.vector(**orbit.parameters)).full()
    v = orbit.omega * fourier.derivative(orbit.coefficients)[1:]
    return np.asarray((v * (v @ M.T)).sum(axis=0) / 4)
