"""What the names of coordinates, parameters and outputs stand for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hbbogie.brief import brief
from hbbogie.units import behind, label

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Naming:
    """Units and descriptions of coordinates, parameters and outputs, by their names; what is not known is left out.

    Attributes
    ----------
    units : dict of str
    descriptions : dict of str
        What each is, such as "front wheelset, lateral".
    outputs : tuple of str
        Names of the outputs of the system.
    measure : callable or None
        What the outputs stand for: (q, v, p) -> their values, shapes (N, n), (N, n), (number of parameters,) and (N,
        number of outputs). None in results read from files, which hold the values.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    descriptions: Mapping[str, str] = field(default_factory=dict)
    outputs: tuple[str, ...] = ()
    measure: Callable[[Array, Array, Array], Array] | None = field(default=None, repr=False, compare=False)

    __repr__ = brief

    def is_output(self, name: Any) -> bool:
        """Tell whether a name is that of an output."""
        return isinstance(name, str) and name in self.outputs

    def plain(self, name: str) -> str:
        """Return a name behind its description, such as "speed V"; that of an output is plain already."""
        if name in self.outputs:
            return name
        return f"{self.descriptions.get(name, '')} {name}".strip()

    def label(self, name: str) -> str:
        """Return the label of an axis, such as "speed V [m/s]"; no unit where it is not known."""
        return label(self.plain(name), self.units[name]) if name in self.units else self.plain(name)

    def value(self, name: str, number: float, digits: int = 6) -> str:
        """Return a value in words, such as "V = 90 m/s"."""
        unit = self.units.get(name, "")
        return f"{name} = {number:.{digits}g}{behind(unit)}"

    def values(self, numbers: Mapping[str, float], first: int = 3) -> str:
        """Return values in words, those beyond the first counted only."""
        shown = [self.value(n, v) for n, v in list(numbers.items())[:first]]
        more = len(numbers) - len(shown)
        return ", ".join(shown) + (f" and {more} more" if more else "")


NAMELESS = Naming()
