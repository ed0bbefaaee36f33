"""Cycles by collocation against periods known from independent integration, and the algebra against dense solves."""

from __future__ import annotations

import numpy as np
import pytest
from known_cycles import radial
from smooth_systems import brusselator, fitzhugh_nagumo, hodgkin_huxley, oregonator, roessler

import hbbogie as hb
from hbbogie import Collocation, ConvergenceError, ModelError, load_problem
from hbbogie.collocation import (
    CollocatedCycle,
    Rates,
    collocated,
    from_motion,
    from_orbit,
    in_logarithms,
    log_moduli,
    on_mesh,
    reduced,
)
from hbbogie.polynomials import evaluated, gauss, points_of

TOLERANCE = 1e-9


def van_der_pol(mu: float) -> hb.System:
    return load_problem("van_der_pol").van_der_pol(mu=mu)


CASES = {  # by DOP853 or Radau at a relative tolerance of 1e-11, half a unit of the last digit
    "van der Pol, mu = 1": (lambda: van_der_pol(1.0), [2.0, 0.0], 6.66328685932313, 1e-13),
    "van der Pol, mu = 10": (lambda: van_der_pol(10.0), [2.0, 0.0], 19.0783695669390, 1e-12),
    "van der Pol, mu = 50": (lambda: van_der_pol(50.0), [2.0, 0.0], 82.50833389, 5e-9),
    "van der Pol, mu = 100": (lambda: van_der_pol(100.0), [2.0, 0.0], 162.83707109, 5e-9),
    "van der Pol, mu = 1000": (lambda: van_der_pol(1000.0), [2.0, 0.0], 1614.401126, 5e-7),
    "Brusselator, a = 0.2": (lambda: brusselator(a=0.2), [1.0, 1.0], 403.05185634, 5e-9),
    "FitzHugh-Nagumo": (lambda: fitzhugh_nagumo(), [1.0, 1.0], 39.474415, 5e-7),
    "FitzHugh-Nagumo, eps = 0.01": (lambda: fitzhugh_nagumo(eps=0.01), [1.0, 1.0], 226.647987, 5e-7),
    "Oregonator": (oregonator, [0.1, 0.1], 4.810392990, 5e-10),
    "Hodgkin-Huxley": (hodgkin_huxley, [50.0, 0.1, 0.5, 0.4], 15.597767353, 5e-10),
}


@pytest.mark.parametrize("name", CASES)
def test_period(name):
    """PUBLISHED digits, or ten times the tolerance where there are more of them."""
    build, state, period, half_a_unit = CASES[name]
    system = build()
    cycle = collocated(system, from_motion(system, state), tolerance=TOLERANCE)
    assert cycle.period == pytest.approx(period, abs=max(half_a_unit, 10 * TOLERANCE * period))
    assert cycle.period_error <= TOLERANCE
    assert cycle.stability.verdict == "stable"


def test_tiny_multiplier_by_liouville():
    """Its logarithm at mu = 10 is -311.844219286."""
    system = van_der_pol(10.0)
    cycle = collocated(system, from_motion(system, [2.0, 0.0]), tolerance=1e-10)
    smallest = np.abs(cycle.stability.multipliers).min()
    assert np.log(smallest) == pytest.approx(-311.844219286, abs=5e-9)


def test_several_tiny_multipliers_by_factors():
    """y' = -10 y + x and z' = -25 z + x y, driven by van der Pol's oscillator, decay by exp(-10 T) and exp(-25 T)."""
    x, y, z, mu = *(hb.Coordinate(s) for s in "xyz"), hb.Parameter("mu", 1.0)
    equations = [x.ddot - mu * (1 - x**2) * x.dot + x, y.dot + 10 * y - x, z.dot + 25 * z - x * y]
    system = hb.System("driven", [x, y, z], [mu], equations)
    cycle = collocated(system, from_motion(system, [2.0, 0.0, 0.0, 0.0]), tolerance=1e-11)
    logarithms = np.log(np.abs(cycle.stability.multipliers[2:]))
    assert logarithms == pytest.approx([-10 * 6.66328685932313, -25 * 6.66328685932313], rel=1e-5)
    assert (cycle.stability.multipliers[2:].real > 0).all()
    branch = hb.trace(Collocation().equations(system), cycle.orbit(), "mu", (0.9, 2.0))
    for orbit in branch.orbits:  # also of a branch; the sum of all is the integral of the trace
        T, mu = orbit.period, orbit.parameters["mu"]
        logarithms = np.log(np.abs(orbit.stability.multipliers))
        assert logarithms[2:] == pytest.approx([-10 * T, -25 * T], rel=1e-5)
        assert logarithms.sum() == pytest.approx((mu * (1 - orbit.rms("x") ** 2) - 35) * T, rel=1e-7)


def test_factors_of_a_matrix_with_a_complex_pair():
    """IDENTITY: multipliers 2, 1e-30 exp(+-i) and -1e-40, in factors that mix them."""
    rng = np.random.default_rng(0)
    bases = [*rng.normal(size=(20, 4, 4))]
    diagonal = np.zeros((4, 4))
    share = 1e-30 ** (1 / 20)
    diagonal[0, 0], diagonal[3, 3] = 2.0 ** (1 / 20), 1e-40 ** (1 / 20)
    diagonal[1:3, 1:3] = share * np.array([[np.cos(0.05), -np.sin(0.05)], [np.sin(0.05), np.cos(0.05)]])
    factors = [bases[(k + 1) % 20] @ diagonal @ np.linalg.inv(bases[k]) for k in range(20)]
    factors[0] = bases[1] @ diagonal @ np.diag([1.0, 1.0, 1.0, -1.0]) @ np.linalg.inv(bases[0])
    logarithms, signs = log_moduli(np.array(factors))
    assert logarithms == pytest.approx(np.log([2.0, 1e-30, 1e-30, 1e-40]), rel=1e-8)
    assert signs[0] == 1 and signs[3] == -1


@pytest.mark.parametrize("turns", [(1.0, 1.0), (-1.0, 0.6), (1.0, -0.997)])
def test_factors_of_a_matrix_with_multipliers_that_are_nearly_the_same(turns):
    """IDENTITY: multipliers 3, 1e-25 times two factors, 1e-27 times the same, in factors that mix them."""
    rng = np.random.default_rng(1)
    bases = [np.linalg.qr(a)[0] + 0.1 * rng.normal(size=(5, 5)) for a in rng.normal(size=(20, 5, 5))]
    known = np.array([3.0, *(1e-25 * np.array(turns)), *(1e-27 * np.array(turns))])
    D, flips = np.diag(np.abs(known) ** (1 / 20)), np.diag(np.sign(known))
    factors = [bases[(k + 1) % 20] @ (D @ flips if k == 7 else D) @ np.linalg.inv(bases[k]) for k in range(20)]
    logarithms, signs = log_moduli(np.array(factors))
    assert logarithms == pytest.approx(np.log(np.abs(known)), abs=1e-10)
    assert np.abs(turns[0]) == np.abs(turns[1]) or (signs == np.sign(known)).all()


def test_logarithms_of_positive_coordinates():
    """The same periods; where a branch is lost, as that of the Oregonator in its canards, they are offered."""
    x, z = (hb.Coordinate(s, bounds=(0, np.inf)) for s in "xz")
    f, q = hb.Parameter("f", 1.0), 0.002
    system = hb.System("s", [x, z], [f], [0.04 * x.dot - (x * (1 - x) - f * z * (x - q) / (x + q)), z.dot - (x - z)])
    inner = in_logarithms(system)
    cycle = collocated(inner, from_motion(inner, np.log([0.1, 0.1])))
    assert cycle.period == pytest.approx(4.810392990, abs=5e-9)
    (hopf, _) = hb.hopf_points(system, "f", (0.3, 3.0))
    branch = hb.trace(Collocation().equations(system), hopf, "f", (0.3, 3.0), stability=False, max_points=60)
    assert "x, z are positive" in branch.ends[1].advice
    a, b = hb.Coordinate("a"), hb.Coordinate("b", bounds=(0, np.inf))
    mixed = hb.System("mixed", [a, b], [f], [a.ddot + a - b, b.ddot + f * b.dot + b * a])
    same = in_logarithms(mixed)
    rates, there = mixed.ode([0.3, 2.0, 0.1, 0.6], [1.0]), same.ode([0.3, np.log(2.0), 0.1, 0.3], [1.0])
    assert float(there[3]) == pytest.approx(float(rates[3]) / 2.0 - 0.3**2, rel=1e-14)
    assert float(there[2]) == pytest.approx(float(rates[2]), rel=1e-14)
    with pytest.raises(ModelError, match=r"no coordinate .* is declared positive"):
        in_logarithms(van_der_pol(1.0))
    with pytest.raises(ModelError, match="unknown coordinate 'y'"):
        in_logarithms(mixed, "y")


def test_multiplier_known_in_closed_form():
    """The radial normal form: omega 1, multiplier exp(-4 pi rho)."""
    system, orbit = radial(0.3)
    cycle = collocated(system, from_orbit(system, orbit), tolerance=1e-11)
    assert cycle.omega == pytest.approx(1.0, abs=1e-10)
    assert np.abs(cycle.stability.multipliers).min() == pytest.approx(np.exp(-4 * np.pi * 0.3), rel=1e-9)


def test_order_of_the_period():
    """ORDER: Gauss points of degree 3 have the order 6 where intervals meet; the error is estimated within 15 %."""
    system = van_der_pol(1.0)
    guess = collocated(system, from_motion(system, [2.0, 0.0]), tolerance=1e-12)
    errors = []
    for N in (40, 80):
        cycle = collocated(system, guess, degree=3, intervals=N)
        errors.append(abs(cycle.period / 6.66328685932313019 - 1))
        assert cycle.period_error == pytest.approx(errors[-1], rel=0.15)
    assert np.log2(errors[0] / errors[1]) > 5.5


def test_values_of_the_waveform():
    """The peak of van der Pol's cycle at mu = 1 is 2.00861986087; odd motions have no mean."""
    system = van_der_pol(1.0)
    cycle = collocated(system, from_motion(system, [2.0, 0.0]), tolerance=1e-12)
    orbit = cycle.orbit()
    low, high = orbit.extremes
    assert high[0] == pytest.approx(2.00861986087484314, abs=1e-8)
    assert low[0] == pytest.approx(-high[0], abs=1e-8)
    assert cycle.amplitude("x") == pytest.approx(high[0], abs=1e-8)
    assert orbit.mean("x") == pytest.approx(0.0, abs=1e-9)
    t = np.linspace(0, cycle.period, 57)
    assert np.hstack([orbit.q(t), orbit.v(t)]) == pytest.approx(cycle.states(t), abs=1e-12)
    power = orbit.coefficients[0] ** 2 + 0.5 * (orbit.coefficients[1:] ** 2).sum(axis=0)
    assert orbit.rms("x") ** 2 == pytest.approx(power[0], rel=1e-8)
    residual = system.residual(orbit.q(t).T, orbit.v(t).T, orbit.a(t).T, system.vector()).full()
    assert np.abs(residual).max() < 1e-4  # of the second derivative of polynomials
    assert isinstance(cycle, CollocatedCycle)


def test_orbit_of_a_relaxation_oscillation_keeps_its_polynomials():
    """PUBLISHED: the period; the peak by its series for large mu, see `test_forms`."""
    system = van_der_pol(100.0)
    orbit = collocated(system, from_motion(system, [2.0, 0.0])).orbit()
    assert orbit.errors["waveform"] < 1e-6 and orbit.tail == 0.0
    assert orbit.period == pytest.approx(162.83707109, abs=1e-6)
    series = 2 + 0.77937 * 100 ** (-4 / 3) - (16 / 27 * np.log(100) + 0.8762) / 100**2
    assert orbit.amplitude("x") == pytest.approx(series, abs=100 ** (-8 / 3))


def test_a_motion_that_closes_after_two_turns_is_the_cycle_passed_twice():
    """Roessler's cycle at c = 2.5 attracts with a negative multiplier, so that motions close better after two turns."""
    system = roessler(c=2.5)
    cycle = collocated(system, from_motion(system, [1.0, 1.0, 0.0]))
    assert cycle.period < 6
    assert cycle.stability.critical.real < 0


def test_method_in_solve():
    system = van_der_pol(2.0)
    equations = Collocation().equations(system)
    guess = hb.find_cycles(system, mu=1.0)[0]
    orbit = hb.solve(equations, guess, mu=1.0)
    assert orbit.period == pytest.approx(6.66328685932313019, rel=1e-8)
    assert orbit.parameters["mu"] == 1.0
    with pytest.raises(ModelError, match="at given parameter values only"):
        hb.solve(equations, guess, free="mu", amplitude={"x": 2.0})


def test_what_is_refused():
    with pytest.raises(ModelError, match="degree"):
        Collocation(degree=1)
    with pytest.raises(ModelError, match="intervals"):
        Collocation(intervals="many")
    with pytest.raises(ModelError, match="of shape"):
        from_motion(van_der_pol(1.0), [1.0])
    x, y, w, b = *(hb.Coordinate(s) for s in "xyw"), hb.Parameter("b", 2.5)
    f, g = 1 - (b + 1) * x + x**2 * y, b * x - x**2 * y
    kept = hb.System("kept", [x, y, w], [b], [x.dot - f, y.dot - g, w.dot + f + g])
    motion = from_motion(kept, [1.0, 1.0, 0.0])
    with pytest.raises(ModelError, match="conserved"):
        collocated(kept, motion)


def test_motions_without_a_cycle():
    system = van_der_pol(-1.0)
    with pytest.raises(ConvergenceError, match="comes to rest"):
        from_motion(system, [0.1, 0.0])
    with pytest.raises(ConvergenceError, match="no cycle was found"):
        from_motion(system, [3.0, 0.0])


@pytest.mark.parametrize("N", [1, 2, 7, 16, 23])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_elimination_is_a_dense_solve(N, n):
    """IDENTITY: solution, adjoint and sign of the determinant, of states that grow little, much, and by turns."""
    rng = np.random.default_rng(N + 100 * n)
    signs = []
    for growth in (0.1, 10.0, 0.01 ** rng.uniform(-1, 1, (N, 1, 1))):
        W, H = growth * rng.standard_normal((N, n, n)), rng.standard_normal((N, n, 3))
        border, corner = rng.standard_normal((N, 2, n)), rng.standard_normal((2, 3))
        dense, right = np.zeros((N * n + 2, N * n + 2)), np.zeros(N * n + 2)
        for i in range(N):
            rows, here, there = (slice(k * n, (k + 1) * n) for k in (i, i, (i + 1) % N))
            dense[rows, here] -= W[i]
            dense[rows, there] += np.eye(n)
            dense[rows, N * n :], right[rows] = H[i, :, :2], H[i, :, 2]
        dense[N * n :] = np.hstack([border.swapaxes(0, 1).reshape(2, -1), corner[:, :2]])
        right[N * n :] = corner[:, 2]
        found = reduced(W, H, border, corner)
        x, rest = found.solve()
        size = np.linalg.cond(dense)
        exact = np.linalg.solve(dense, right)
        assert np.append(x, rest) == pytest.approx(exact, rel=1e-12 * size, abs=1e-13 * size * np.abs(exact).max())
        states, two = found.adjoint()
        exact = np.linalg.solve(dense.T, np.append(np.zeros(N * n + 1), 1.0))
        assert np.append(states, two) == pytest.approx(exact, rel=1e-12 * size, abs=1e-13 * size * np.abs(exact).max())
        signs.append(found.sign * np.linalg.slogdet(dense)[0])
    assert signs[0] == signs[1] == signs[2]  # one factor for all systems of this size


def test_gauss_points():
    """IDENTITY: the end of a polynomial of degree m from its beginning and its stages; integrals of degree 2 m - 1."""
    for m in (2, 3, 4, 7):
        g = gauss(m)
        p = np.polynomial.Polynomial(np.arange(1.0, m + 2))
        assert g.begin * p(0) + g.d @ p(g.c) == pytest.approx(p(1), rel=1e-12)
        assert g.a @ p.deriv()(g.c) == pytest.approx(p(g.c) - p(0), rel=1e-12)
        assert g.b @ g.c ** (2 * m - 1) == pytest.approx(1 / (2 * m), rel=1e-12)
        mesh = np.array([0.0, 0.3, 1.0])
        values = p(points_of(mesh, m))[..., None]
        s = np.linspace(0, 1, 11)
        assert evaluated(mesh, values, s)[:, 0] == pytest.approx(p(s), rel=1e-12)
        assert evaluated(mesh, values, s, 1)[:, 0] == pytest.approx(p.deriv()(s), rel=1e-10)


def test_linearisation_against_differences():
    """The bordered solve inverts the derivative: a step along its solution changes the residual by the right side."""
    system = hodgkin_huxley()
    guess = from_motion(system, [50.0, 0.1, 0.5, 0.4]).on(12, 3)
    equations, u = on_mesh(Rates(system, "I"), guess)
    rng = np.random.default_rng(0)
    plane, right = rng.standard_normal(len(u)), rng.standard_normal(len(u))
    step, _ = equations.linearise(u).solve(plane, right)
    h = 1e-6
    ahead, behind = (equations.linearise(u + s * h * equations.scale * step).residual for s in (1, -1))
    assert plane @ step == pytest.approx(right[-1], rel=1e-8)
    size = np.abs(right).max() + np.abs(step).max()
    assert (ahead - behind) / (2 * h) == pytest.approx(right[:-1], abs=1e-6 * size)
