"""The bogie seen from above, on its rails."""

from __future__ import annotations

import numpy as np

from hbbogie.results import Shape

ENLARGED = 15.0  # lateral displacements and yaw angles are drawn so many times as large


def sketch(q: dict[str, float], p: dict[str, float]) -> list[Shape]:
    """Seen from above, displacements and yaw 15 times enlarged; a flange that touches its rail is lit.

    Parameters
    ----------
    q : dict
        Coordinates [m, rad].
    p : dict
        Parameters.
    """
    a, b, half = p["a"], p["b"], p["d1"]
    ends = np.array([-2.0 * b, 2.0 * b])
    shapes = [Shape(ends, np.full(2, side * a), "ground") for side in (1, -1)]
    wheelsets = ((b, "q1", "q2"), (-b, "q3", "q4"))
    for x, y, _ in wheelsets:
        for side in (1, -1):
            section = np.array([x - 0.35, x + 0.35]), np.full(2, side * a)
            shapes.append(Shape(*section, "contact", bool(side * q[y] > p["y0"])))
    corners = np.array([[1.25 * b, half], [1.25 * b, -half], [-1.25 * b, -half], [-1.25 * b, half], [1.25 * b, half]])
    shapes.append(_placed(corners, 0.0, q["q5"], q["q6"], "body"))
    for x, y, yaw in wheelsets:
        shapes.append(_placed(np.array([[0.0, a], [0.0, -a]]), x, q[y], q[yaw], "body"))
        for side in (1, -1):
            wheel = np.array([[-0.6 * p["r0"], side * a], [0.6 * p["r0"], side * a]])
            shapes.append(_placed(wheel, x, q[y], q[yaw], "part"))
    return shapes


def _placed(corners: np.ndarray, x: float, y: float, yaw: float, kind: str) -> Shape:
    """Return a shape turned and shifted, both enlarged."""
    angle = ENLARGED * yaw
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = corners @ turn.T + [x, ENLARGED * y]
    return Shape(moved[:, 0], moved[:, 1], kind)
