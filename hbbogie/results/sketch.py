"""What a system looks like at one instant: shapes that a figure can draw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

KINDS = ("ground", "body", "part", "contact")


@dataclass(frozen=True)
class Shape:
    """A line, closed or not, of a drawing.

    Attributes
    ----------
    x, y : sequence of float
        Its corners, in any unit that all shapes of a drawing share. All drawings of a motion have the same shapes.
    kind : {"ground", "body", "part", "contact"}
        What does not move, a body, a part of one, and where forces of contact act.
    lit : bool
        Whether the contact is closed.
    """

    x: Sequence[float]
    y: Sequence[float]
    kind: str = "body"
    lit: bool = False


Sketch = Callable[[dict[str, float], dict[str, float]], Sequence[Shape]]
"""Returns the shapes from the values of the coordinates and of the parameters, both by name."""
