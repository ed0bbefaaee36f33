"""Systems in the logarithms of coordinates that are positive, such as concentrations that fall to almost nothing."""

from __future__ import annotations

import casadi as ca

from hbbogie.errors import ModelError, door, named
from hbbogie.model.symbols import Coordinate
from hbbogie.model.system import System


def positive_coordinates(system: System) -> tuple[str, ...]:
    """Return the names of the coordinates whose bounds say that they are not negative."""
    return tuple(c.name for c in system.coordinates if c.bounds[0] >= 0)


@door(system=System)
def in_logarithms(system: System, *names: str) -> System:
    """Return the same system with the logarithms of some coordinates in their place.

    Where such a coordinate falls to a tiny share of its largest value, as near a homoclinic orbit or along a canard,
    its logarithm still tells where the motion is. Outputs are left out.

    Parameters
    ----------
    system : System
        Without elements.
    *names : str
        Coordinates that are positive; where left out all whose ``bounds`` say so, such as
        ``Coordinate("x", bounds=(0, inf))``. The logarithm of x has the name ln_x.

    Raises
    ------
    ModelError
        For a system with elements or an unknown coordinate, or when no coordinate is declared positive.

    Examples
    --------
    >>> import numpy as np
    >>> from hbbogie import Coordinate, Parameter, System
    >>> x, k = Coordinate("x", bounds=(0, np.inf)), Parameter("k", 2.0)
    >>> decay = in_logarithms(System("decay", [x], [k], [x.dot + k * x]))
    >>> decay.coordinate_names, float(decay.ode([0.0], [2.0]))
    (('ln_x',), -2.0)
    """
    chosen = names or positive_coordinates(system)
    if system.elements:
        raise ModelError(f"in_logarithms: system {system.name!r} has elements; write their forces into the equations.")
    if not chosen:
        raise ModelError(
            f"in_logarithms: no coordinate of system {system.name!r} is declared positive; give their names, or "
            'declare them with bounds, such as Coordinate("x", bounds=(0, float("inf"))).'
        )
    known = system.coordinate_names
    places = {known.index(named("in_logarithms", "coordinate", name, known)) for name in chosen}
    new, q, v = [], [], []
    for place, c in enumerate(system.coordinates):
        in_log = place in places
        y = Coordinate(f"ln_{c.name}", "1", f"logarithm of {c.name}") if in_log else c
        new.append(y)
        q.append(ca.exp(y) if in_log else y)
        v += [q[-1] * y.dot if in_log else y.dot] if system.second_order[place] else []
    f = system.ode(ca.vertcat(*q, *v), ca.vertcat(*system.parameters))
    equations, k = [], system.n
    for place, (y, second) in enumerate(zip(new, system.second_order, strict=True)):
        rate = f[k] if second else f[place]
        k += second
        rate = rate / q[place] if place in places else rate
        if second:
            equations.append(y.ddot - (rate - y.dot**2 if place in places else rate))
        else:
            equations.append(y.dot - rate)
    return System(f"{system.name} in logarithms", new, system.parameters, equations).with_parameters(**system.values)
