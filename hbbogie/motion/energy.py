"""Which groups of bodies move in a cycle: their shares of the kinetic energy, averaged over a period."""

from __future__ import annotations

from collections.abc import Iterator

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
    """Yield states in which one group of bodies moves and all others rest, and then states in which all groups move.

    A motion from the latter need not come to a cycle of any branch from a Hopf point.

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
    yield from _together(system, cycles)


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
    starts = []
    for name, names in system.groups.items():
        orbit = max(cycles, key=lambda o: _energies(system, o)[_places(o, names)].sum())
        own = _places(orbit, names)
        others = [c for group, names in system.groups.items() if group != name for c in names]
        largest = own[int(np.argmax(_energies(system, orbit)[own]))]
        crest = float(np.arctan2(*orbit.coefficients[[2, 1], largest])) / orbit.omega
        q, v = orbit.q(crest)[0], orbit.v(crest)[0]
        for x in (q, v):
            x[_places(orbit, others)] = 0.0
        starts.append((f"a state in which only the {name} moves", np.append(q, v[list(system.second_order)])))
    return starts


def _together(system: System, cycles: list[Orbit]) -> list[tuple[str, Array]]:
    """Return states in which all groups move, each as in `alone`: in phase, and of two also in opposite phase."""
    states = np.array([x for _, x in alone(system, cycles)])
    if not len(states):
        return []
    share = np.where((states != 0).sum(axis=0) > 1, 1 / len(states), 1.0)  # of what belongs to no group
    starts = [("a state in which all groups move", share * states.sum(axis=0))]
    if len(states) == 2:
        starts.append(("a state in which both groups move in opposite ways", share * (states[0] - states[1])))
    return starts


def _places(orbit: Orbit, names: tuple[str, ...] | list[str]) -> list[int]:
    return [orbit.index(name) for name in names]


def _energies(system: System, orbit: Orbit) -> Array:
    """Return the mean of v_i (M v)_i / 2 over the period for each coordinate, shape (n,)."""
    M = system.dynamics.linear[0](system.vector(**orbit.parameters)).full()
    v = orbit.omega * fourier.derivative(orbit.coefficients)[1:]
    return np.asarray((v * (v @ M.T)).sum(axis=0) / 4)
