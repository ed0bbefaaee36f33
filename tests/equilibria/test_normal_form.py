"""The first Lyapunov coefficient against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie.equilibria import first_lyapunov


def planar(f, g, name="planar"):
    """x' = mu x - w y + f, y' = w x + mu y + g with a Hopf point at mu = 0."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    mu, w = hb.Parameter("mu", 0.0), hb.Parameter("w", 1.7)
    equations = [x.dot - mu * x + w * y - f(x, y), y.dot - mu * y - w * x - g(x, y)]
    return hb.System(name, [x, y], [mu, w], equations)


def only_hopf(system, parameter="mu", interval=(-0.3, 0.4)):
    (hopf,) = hb.hopf_points(system, parameter, interval)
    return hopf


def test_van_der_pol():
    """IDENTITY: x'' - (mu - x^2) x' + x = 0 has r' = mu r / 2 - r^3 / 8, so l1 = -1 / 4: supercritical."""
    x, mu = hb.Coordinate("x"), hb.Parameter("mu", 0.1)
    system = hb.System("van der Pol", [x], [mu], [x.ddot - (mu - x**2) * x.dot + x])
    assert first_lyapunov(system, only_hopf(system)) == pytest.approx(-0.25, rel=1e-9)


@pytest.mark.parametrize("a", [-0.7, 0.0, 1.3])
def test_bautin(a):
    """IDENTITY: r' = r (mu + a r^2 - r^4), so l1 = 2 a / w0: its sign is that of a."""
    system = hb.load_problem("bautin").bautin(a=a, w0=2.0)
    assert first_lyapunov(system, only_hopf(system)) == pytest.approx(a, abs=1e-12)


def test_brusselator():
    """IDENTITY: the equilibrium moves with the parameters, and quadratic terms count.

    With the second entry of the eigenvector of length 1 it is -(2 + A^2) / (2 A (1 + A^2)); the eigenvector of length 1
    has it multiplied by (1 + A^2) / (1 + 2 A^2). (Kuznetsov, Elements of Applied Bifurcation Theory, chapter 3.)
    """
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    b, A = hb.Parameter("b", 2.0), hb.Parameter("A", 1.2)
    system = hb.System("Brusselator", [x, y], [b, A], [x.dot - A + (b + 1) * x - x**2 * y, y.dot - b * x + x**2 * y])
    expected = -(2 + 1.2**2) / (2 * 1.2 * (1 + 2 * 1.2**2))
    assert first_lyapunov(system, only_hopf(system, "b", (1.5, 4.0))) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_planar_fields_with_quadratic_and_cubic_terms(seed):
    """IDENTITY: the classical formula of planar systems, with r = sqrt(2) abs(w): l1 = 2 a / w.

    J. Guckenheimer, P. Holmes, Nonlinear Oscillations, Dynamical Systems, and Bifurcations of Vector Fields,
    equation (3.4.11).
    """
    c, d = np.random.default_rng(seed).standard_normal((2, 7))

    def polynomial(k):
        return lambda x, y: (
            k[0] * x**2 + k[1] * x * y + k[2] * y**2 + k[3] * x**3 + k[4] * x**2 * y + k[5] * x * y**2 + k[6] * y**3
        )

    system = planar(polynomial(c), polynomial(d))
    fxx, fxy, fyy, gxx, gxy, gyy = 2 * c[0], c[1], 2 * c[2], 2 * d[0], d[1], 2 * d[2]
    cubic = 6 * c[3] + 2 * c[5] + 2 * d[4] + 6 * d[6]
    quadratic = fxy * (fxx + fyy) - gxy * (gxx + gyy) - fxx * gxx + fyy * gyy
    a = (cubic + quadratic / 1.7) / 16
    assert first_lyapunov(system, only_hopf(system)) == pytest.approx(2 * a / 1.7, rel=1e-8)


def test_it_gives_the_slope_of_the_branch():
    """ORDER: mu = -Re(c1) r^2 / 2 + O(r^4) along the branch of planar cycles, by harmonic balance."""
    system = planar(lambda x, y: 0.8 * x**2 + 0.3 * x**3, lambda x, y: -0.5 * x * y - 0.2 * y**3)
    hopf = only_hopf(system)
    branch = hb.trace(hb.HarmonicBalance(7).equations(system), hopf, "mu", (-0.3, 0.4), longest=0.02, max_points=12)
    r2 = branch.first_harmonic("x") ** 2
    slope = branch.values / r2
    limit = slope[0] - r2[0] * (slope[4] - slope[0]) / (r2[4] - r2[0])
    assert limit == pytest.approx(-first_lyapunov(system, hopf) * 1.7 / 2, rel=2e-3)


def test_linear_below_a_gap(bogie):
    assert first_lyapunov(bogie, only_hopf(bogie, "V", (60.0, 190.0))) == 0.0


def test_a_kink_at_rest_has_no_coefficient():
    """Damping by abs(x) x': the radius grows like mu, not like its root."""
    x, mu = hb.Coordinate("x"), hb.Parameter("mu", 0.1)
    system = hb.System("kinked", [x], [mu], [x.ddot - (mu - ca.fabs(x)) * x.dot + x])
    assert np.isnan(first_lyapunov(system, only_hopf(system)))


def test_wrong_input(bogie, branch):
    with pytest.raises(hb.ModelError, match="kind 'fold'"):
        first_lyapunov(bogie, branch.folds()[0])
