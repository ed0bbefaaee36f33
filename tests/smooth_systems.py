"""Smooth systems whose periods and folds are known from independent integration."""

from __future__ import annotations

import casadi as ca

from hbbogie import Coordinate, Parameter, System


def brusselator(**values: float) -> System:
    """In the scaling x' = a + x^2 y / 2 - 5 x, y' = 4 x - x^2 y / 2."""
    x, y, a = Coordinate("x"), Coordinate("y"), Parameter("a", 0.5)
    equations = [x.dot - (a + x**2 * y / 2 - 5 * x), y.dot - (4 * x - x**2 * y / 2)]
    return System("Brusselator", [x, y], [a], equations).with_parameters(**values)


def fitzhugh_nagumo(**values: float) -> System:
    v, w, current, eps = Coordinate("v"), Coordinate("w"), Parameter("I", 0.5), Parameter("eps", 0.08)
    equations = [v.dot - (v - v**3 / 3 - w + current), w.dot - eps * (v + 0.7 - 0.8 * w)]
    return System("FitzHugh-Nagumo", [v, w], [current, eps], equations).with_parameters(**values)


def oregonator() -> System:
    x, z, f = Coordinate("x"), Coordinate("z"), Parameter("f", 1.0)
    q = 0.002
    return System(
        "Oregonator", [x, z], [f], [0.04 * x.dot - (x * (1 - x) - f * z * (x - q) / (x + q)), z.dot - (x - z)]
    )


def hodgkin_huxley(**values: float) -> System:
    v, m, h, n, current = *(Coordinate(s) for s in "vmhn"), Parameter("I", 8.5)
    a_m, b_m = 0.1 * (25 - v) / (ca.exp((25 - v) / 10) - 1), 4 * ca.exp(-v / 18)
    a_h, b_h = 0.07 * ca.exp(-v / 20), 1 / (ca.exp((30 - v) / 10) + 1)
    a_n, b_n = 0.01 * (10 - v) / (ca.exp((10 - v) / 10) - 1), 0.125 * ca.exp(-v / 80)
    flow = 120 * m**3 * h * (v - 115) + 36 * n**4 * (v + 12) + 0.3 * (v - 10.599)
    equations = [
        v.dot - (current - flow),
        m.dot - (a_m * (1 - m) - b_m * m),
        h.dot - (a_h * (1 - h) - b_h * h),
        n.dot - (a_n * (1 - n) - b_n * n),
    ]
    return System("Hodgkin-Huxley", [v, m, h, n], [current], equations).with_parameters(**values)


def morris_lecar(*, g_ca: float, v3: float, v4: float, phi: float, current: float) -> System:
    v, w = Coordinate("v"), Coordinate("w")
    i, rate = Parameter("I", current), Parameter("phi", phi)
    m, still = (1 + ca.tanh((v + 1.2) / 18)) / 2, (1 + ca.tanh((v - v3) / v4)) / 2
    flow = 2 * (v + 60) + 8 * w * (v + 84) + g_ca * m * (v - 120)
    equations = [20 * v.dot - (i - flow), w.dot - rate * (still - w) * ca.cosh((v - v3) / (2 * v4))]
    return System("Morris-Lecar", [v, w], [i, rate], equations)


def lorenz(**values: float) -> System:
    x, y, z, r = *(Coordinate(s) for s in "xyz"), Parameter("r", 22.0)
    equations = [x.dot - 10 * (y - x), y.dot - (r * x - y - x * z), z.dot - (x * y - 8 / 3 * z)]
    return System("Lorenz", [x, y, z], [r], equations).with_parameters(**values)


def roessler(**values: float) -> System:
    x, y, z, c = *(Coordinate(s) for s in "xyz"), Parameter("c", 2.5)
    equations = [x.dot + y + z, y.dot - x - 0.2 * y, z.dot - 0.2 - z * (x - c)]
    return System("Roessler", [x, y, z], [c], equations).with_parameters(**values)
