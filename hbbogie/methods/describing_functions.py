"""Describing functions: force laws as springs whose stiffness depends on the amplitude.

For the motion u = Y cos(tau) the force has harmonics f_n(Y). The first order keeps f_1 / Y. In the second order of
Krylov, Bogoliubov and Mitropolsky the other harmonics move the oscillator, u_n = f_n / (k (n^2 - 1)) with a reference
stiffness k, and this motion is fed back through f_n'(Y), the mean of F'(Y cos) cos cos n (twice that for n > 0).
Everything here is written for expressions. Numbers are inserted at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from inspect import signature
from itertools import pairwise
from math import comb
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad

from hbbogie.errors import ModelError, unknown_name
from hbbogie.model.elements import known
from hbbogie.model.laws import Backlash, Law
from hbbogie.model.ramps import Ramps, Scalar, contact_angle

Array = NDArray[np.float64]
HIGHEST = 201  # last harmonic of the second-order series of piecewise-linear laws, and of quadrature
POINTS, RESOLVED = 128, 31  # midpoints of the fixed rule over half a period, and the last harmonic computed from it
NODES = 256  # Gauss nodes between break points: enough for the highest harmonic
METHODS = ("auto", "closed", "quadrature")


def describing_function(
    law: Law | Backlash,
    amplitude: ArrayLike | ca.SX | ca.MX,
    *,
    order: int = 1,
    method: str = "auto",
    reference: Scalar = None,
) -> Any:
    """Return the equivalent stiffness of a force law at an amplitude of its argument.

    Parameters
    ----------
    law : Law or Backlash
    amplitude : float, array_like, or scalar CasADi expression; unit of the argument
        Y, positive.
    order : {1, 2}
        1: the first harmonic of the force divided by Y. 2: higher harmonics, and the mean of an asymmetric law, move an
        oscillator with the reference stiffness and are fed back. Order 2 is for conservative laws.
    method : {"auto", "closed", "quadrature"}
        "closed": in closed form (order 2 of a piecewise-linear law: a series). "quadrature": numerically, adaptive at
        order 1, with break points where the law has corners. "auto": closed form where it is known. For a law without
        closed form, an expression as amplitude uses a fixed rule of 256 points a period. Its error for `Friction` is
        1e-10 if the width is 1/20 of the amplitude, and 3e-5 if it is 1/150.
    reference : scalar, optional, unit of force per unit of the argument
        Reference stiffness of order 2; by default the law's own (`DeadBand`: that behind the gap; `Saturation`,
        `Cubic`, `Polynomial`: that at zero).

    Returns
    -------
    float, complex, ndarray or expression; unit of force per unit of the argument
        Shape of the amplitude. Complex for `Backlash`. An expression where amplitude or law contains symbols.

    Raises
    ------
    ModelError
        For an amplitude that is not positive, a closed form that is not known, quadrature of expressions, or
        order 2 of a law without reference stiffness.

    Notes
    -----
    The series of order 2 runs to n = 201. The remainder is at most K^2 / (pi^2 k (n^2 - 1)^2), with K the sum of the
    ramps' abs(k) and k the reference stiffness. For the dead band this is 2.5e-10 of its stiffness.

    References
    ----------
    N. M. Krylov, N. N. Bogoliubov, Introduction to Non-Linear Mechanics, Princeton University Press 1947.

    Examples
    --------
    For a cubic spring it is 3/4 of the coefficient times the amplitude squared.

    >>> from hbbogie.model import Cubic
    >>> float(describing_function(Cubic(4.0), 0.5))
    0.75
    """
    if order not in (1, 2):
        raise ModelError(f"describing_function: order={order!r}; allowed is 1 or 2.")
    if method not in METHODS:
        raise ModelError(f"describing_function: {unknown_name('method', method, METHODS)}")
    symbolic = isinstance(amplitude, ca.SX | ca.MX)
    if not symbolic and not (np.isfinite(np.asarray(amplitude)).all() and (np.asarray(amplitude) > 0).all()):
        raise ModelError(f"describing_function: amplitude={amplitude!r}; give positive numbers.")
    _check_inputs(law)
    memory = hasattr(law, "steady_force")
    if memory and (order == 2 or symbolic):
        what = "order 2 is for conservative laws" if order == 2 else "its describing function is complex"
        advice = "take order 1" if order == 2 else "law.describing(amplitude) gives real and imaginary part"
        raise ModelError(f"describing_function of a {type(law).__name__}, a law with memory: {what}; {advice}.")
    if order == 2:
        reference = reference_stiffness(law, reference)
    if method == "closed" and not has_closed_form(law, order):
        raise ModelError(f"describing_function: no closed form is known for {law!r} at order {order}; use quadrature.")
    if method == "closed" or (method == "auto" and (symbolic or has_closed_form(law, order))):
        return _by_expression(law, amplitude, order, reference)
    if symbolic:
        raise ModelError("describing_function: quadrature takes numbers for amplitudes, not expressions; use 'auto'.")
    values = [_by_quadrature(law, float(Y), order, reference) for Y in np.ravel(np.asarray(amplitude))]
    return values[0] if np.ndim(amplitude) == 0 else np.reshape(values, np.shape(amplitude))


def _check_inputs(law: Any) -> None:
    """Raise `ModelError` for a law of several inputs."""
    force = getattr(law, "force", None)
    names = [p.name for p in signature(force).parameters.values() if p.default is p.empty] if force else ["u"]
    if len(names) != 1:
        raise ModelError(
            f"describing_function of a {type(law).__name__}: its force depends on {', '.join(names)}, and here is one "
            "amplitude; hbbogie.methods.first_harmonics(law.force, ...) takes the amplitude of each."
        )


def has_closed_form(law: Law | Backlash, order: int) -> bool:
    """Tell whether an order's describing function of a law is known in closed form."""
    methods = ("describing",) if order == 1 else ("ramps", "polynomial")
    return any(hasattr(law, m) for m in methods)


def reference_stiffness(law: Any, given: Scalar = None, name: str = "") -> ca.SX:
    """Return the reference stiffness of order 2; raise `ModelError` if there is none or it is not positive."""
    k = known(law, "reference_stiffness") if given is None else given
    where = f"element {name!r}" if name else f"{type(law).__name__}"
    if k is None:
        raise ModelError(
            f"{where}: order 2 needs a reference stiffness, which the law does not give; take order 1, or add a method "
            "reference_stiffness() to the law (describing_function also takes reference=...)."
        )
    if ca.SX(k).is_constant() and not float(ca.SX(k)) > 0:
        raise ModelError(f"{where}: its reference stiffness is {float(ca.SX(k)):g}; order 2 needs a positive one.")
    return ca.SX(k)


def _by_expression(law: Any, amplitude: Any, order: int, reference: Any) -> Any:
    Y = ca.SX.sym("Y")
    if order == 2:
        parts = [second_order(law, Y, reference)]
    elif hasattr(law, "steady_force"):
        parts = [ca.SX(part) for part in law.describing(Y)]
    else:
        parts = [first_order(law, Y)]
    strangers = [s for s in ca.symvar(ca.vertcat(*parts)) if not ca.is_equal(s, Y)]
    if strangers:  # a law that contains parameters has a describing function that contains them, too
        values = [ca.substitute(part, Y, ca.SX(amplitude)) for part in parts]
        return values[0] if len(parts) == 1 else tuple(values)
    N = ca.Function("N", [Y], parts)
    if isinstance(amplitude, ca.SX | ca.MX):
        return N(amplitude)
    flat = np.ravel(np.asarray(amplitude, dtype=float))
    found = N.map(len(flat))(flat.reshape(1, -1))
    numbers = np.asarray(found if len(parts) == 1 else found[0]).ravel()
    if len(parts) == 2:
        numbers = numbers + 1j * np.asarray(found[1]).ravel()
    return numbers[0].item() if np.ndim(amplitude) == 0 else numbers.reshape(np.shape(amplitude))


def first_order(law: Any, Y: ca.SX) -> ca.SX:
    """Return f_1 / Y, in closed form or, if that is not known, by the fixed rule."""
    N = known(law, "describing", Y)
    if N is not None:
        return ca.SX(N)
    f, _ = _fixed_rule(law, Y)
    return _project(f, 1) / Y


def second_order(law: Any, Y: ca.SX, reference: ca.SX) -> ca.SX:
    """Return the equivalent stiffness with the higher harmonics fed back (eq-describing-second).

    Parameters
    ----------
    law : Law
        Or an attached law at its parameters, `LawAt`.
    Y : scalar expression, unit of the argument
    reference : scalar expression, unit of force per unit of the argument
    """
    ramps, polynomial = known(law, "ramps"), known(law, "polynomial")
    if ramps is not None:
        harmonics = _of_ramps(ramps, Y)
    elif polynomial is not None:
        harmonics = _of_polynomial(polynomial, Y)
    else:
        f, df = _fixed_rule(law, Y)
        harmonics = ((n, _project(f, n), _project(df, n)) for n in (0, *range(2, RESOLVED + 1)))
    fed_back = ca.SX(0)
    for n, f_n, slope in harmonics:
        fed_back += _share(n) * f_n * slope
    return first_order(law, Y) + fed_back / (Y * reference)


def _share(n: int) -> float:
    """Return the response to a harmonic in units of force over k, times 2 for the mean (whose f_n' is half)."""
    return 1 / (n * n - 1) if n else -2.0


# --- harmonics f_n of a law and their slopes f_n'(Y), n = 0, 2, 3, ... ---------------------------


def _of_ramps(ramps: Ramps, Y: ca.SX) -> Iterator[tuple[int, ca.SX, ca.SX]]:
    """Yield the harmonics of a piecewise-linear law; the even ones only if they do not cancel."""
    odd = _is_paired(ramps)
    # direction, stiffness, jump, threshold, contact angle and its slope in Y
    kinds: list[tuple[int, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]] = []
    y = ca.SX.sym("y")
    for (d, k, g), height in zip(ramps.terms, ramps.heights or (0,) * len(ramps.terms), strict=True):
        if not (odd and d < 0):
            t, pair = contact_angle(g, y), 2 if odd else 1
            t, dt = ca.substitute([t, ca.jacobian(t, y)], [y], [Y])
            kinds.append((d, pair * ca.SX(k), pair * ca.SX(height), ca.SX(g), t, dt))
    if not odd:
        mean, slope = ca.SX(ramps.offset), ca.SX(0)
        for d, k, height, g, t, dt in kinds:
            mean += d * (k * (Y * ca.sin(t) - g * t) + height * t) / np.pi
            slope += d * (k * ca.sin(t) + height * dt) / np.pi
        yield 0, mean, slope
    for n in range(3, HIGHEST + 1, 2) if odd else range(2, HIGHEST + 1):
        f_n, slope = ca.SX(0), ca.SX(0)
        for d, k, height, _, t, dt in kinds:
            below, above = (ca.sin(i * t) / i for i in (n - 1, n + 1))
            f_n += d ** (n + 1) * (k * Y * (below - above) + 2 * height * ca.sin(n * t)) / (np.pi * n)
            slope += d ** (n + 1) * (k * (below + above) + 2 * height * ca.cos(n * t) * dt) / np.pi
        yield n, f_n, slope


def _is_paired(ramps: Ramps) -> bool:
    """Tell whether each ramp has its mirror image, so that the law is odd."""
    heights = ramps.heights or (0,) * len(ramps.terms)
    terms = [(t[0], ca.vertcat(t[1], t[2], h)) for t, h in zip(ramps.terms, heights, strict=True)]
    mirrored = all(any(d == -e and ca.is_equal(ca.SX(a), ca.SX(b), 4) for e, b in terms) for d, a in terms)
    return mirrored and ca.SX(ramps.offset).is_zero()


def _of_polynomial(coefficients: tuple[Scalar, ...], Y: ca.SX) -> Iterator[tuple[int, ca.SX, ca.SX]]:
    """Yield the harmonics of a polynomial law: those of the powers of the cosine."""
    for n in (0, *range(2, len(coefficients))):
        f_n, slope = ca.SX(0), ca.SX(0)
        for m in range(max(n, 1), len(coefficients)):
            if (m - n) % 2 == 0:
                share = comb(m, (m - n) // 2) / 2 ** (m - bool(n))
                f_n += share * coefficients[m] * Y**m
                slope += share * m * coefficients[m] * Y ** (m - 1)
        yield n, f_n + (coefficients[0] if n == 0 else 0), slope


def _fixed_rule(law: Any, Y: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Return the force, and its slope in Y, at the midpoints of half a period."""
    u = ca.SX.sym("u")
    force = ca.SX(law.force(u))
    others = [s for s in ca.symvar(force) if not ca.is_equal(s, u)]
    both = ca.Function("both", [u, *others], [force, ca.jacobian(force, u)])
    cosines = np.cos(_midpoints())
    values = [both(Y * c, *others) for c in cosines]
    return [f for f, _ in values], [df * c for (_, df), c in zip(values, cosines, strict=True)]


def _midpoints() -> Array:
    return np.pi * (np.arange(POINTS) + 0.5) / POINTS


def _project(values: list[ca.SX], n: int) -> ca.SX:
    weights = np.cos(n * _midpoints()) * ((2 if n else 1) / POINTS)
    return ca.dot(ca.DM(weights), ca.vertcat(*values))


# --- numerical quadrature ------------------------------------------------------------------------


def _by_quadrature(law: Any, Y: float, order: int, reference: Any) -> Any:
    """Return the describing function at one amplitude, with its integrals split at the corners of the law."""
    if hasattr(law, "steady_force"):
        turn = np.arccos(np.clip(1 - 2 * float(law.gap) / Y, -1, 1))
        turns = np.unique([0, turn, np.pi, np.pi + turn, 2 * np.pi])
        parts = [_adaptive(lambda t, w=w: law.steady_force(t, Y) * w(t), turns) for w in (np.cos, np.sin)]
        return complex(parts[0], -parts[1]) / (np.pi * Y)
    u = ca.SX.sym("u")
    force = ca.SX(law.force(u))
    if any(not ca.is_equal(s, u) for s in ca.symvar(force)):
        raise ModelError("describing_function: quadrature needs numbers, but the law contains parameters; give values.")
    F = ca.Function("F", [u], [force])
    ramps = known(law, "ramps")
    corners = [d * float(g) / Y for d, _, g in ramps.terms] if ramps is not None else []
    angles = np.unique([0, np.pi / 2, np.pi, *np.arccos(np.clip(corners, -1, 1))])
    first = 2 * _adaptive(lambda t: float(F(Y * np.cos(t))) * np.cos(t), angles) / (np.pi * Y)
    if order == 1:
        return first
    if ramps is not None and ramps.heights:
        raise ModelError(
            f"describing_function: quadrature at order 2 does not see how the jumps of a {type(law).__name__} move "
            "with the amplitude; take the closed form, method 'auto'."
        )
    x, w = np.polynomial.legendre.leggauss(NODES)
    t = np.concatenate([(a + b) / 2 + (b - a) / 2 * x for a, b in pairwise(angles)])
    w = np.concatenate([(b - a) / 2 * w for a, b in pairwise(angles)])
    slope = ca.Function("dF", [u], [ca.jacobian(force, u)])
    f, df = (np.asarray(ca.densify(g.map(len(t))(Y * np.cos(t)[None, :]))).ravel() for g in (F, slope))
    fed_back = 0.0
    for n in (0, *range(2, HIGHEST + 1)):
        wave = np.cos(n * t) * w * ((2 if n else 1) / np.pi)
        fed_back += _share(n) * float(f @ wave) * float((df * np.cos(t)) @ wave)
    return first + fed_back / (Y * float(reference))


def _adaptive(f: Any, corners: Any) -> float:
    """Return the integral over all pieces between the corners, to 1e-12 of the largest piece."""
    total = 0.0
    for a, b in pairwise(corners):
        total += quad(f, a, b, epsabs=1e-14 * abs(total), epsrel=1e-12, limit=200, full_output=1)[0]
    return float(total)
