"""Multi-harmonic balance: exact derivatives, variants that agree, convergence."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipk

import hbbogie as hb
from hbbogie.errors import ModelError


def _problems():
    duffing = hb.load_problem("duffing").duffing()
    first_order = hb.load_problem("van_der_pol").van_der_pol_first_order()
    x, v0 = hb.Coordinate("x"), hb.Parameter("v0", 0.3)
    k, g = hb.Parameter("k", 4.0), hb.Parameter("g", 0.5)
    stop = hb.Element("stop", hb.model.Tabulated((-1.0, 0.4, 1.0), (0.0, 0.0, 3.0)), x + 0.2 * x.dot - 0.1)
    band = hb.Element("band", hb.model.DeadBand(k, g), x - 0.05)
    lopsided = hb.System(
        "lopsided",
        [x],
        [v0, k, g],
        [x.ddot - v0 * (1 - x**2) * x.dot + x + x**2 / 5 + stop + band],
        [stop, band],
    )
    bogie = hb.load_problem("yang1995").bogie()
    return {"duffing": duffing, "first order": first_order, "lopsided": lopsided, "bogie": bogie}


PROBLEMS = _problems()
VARIANTS = {
    "default": {},
    "uncondensed": {"condense": False},
    "all harmonics": {"odd": False},
    "sampled": {"contact": False},
}


def _point(equations, seed=0):
    """A state of unit size, with contacts, in physical units."""
    rng = np.random.default_rng(seed)
    z = 0.05 * rng.standard_normal(equations.size) * equations.scale
    z[0] = 1.5 * equations.scale[0]
    z[-1] = 1.1 * equations.scale[-1]
    return z, equations.system.vector()


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", PROBLEMS)
def test_jacobian_and_hessian_are_the_derivatives(name, variant):
    """ORDER: central differences of the residual and of the Jacobian, error far below their size."""
    system = PROBLEMS[name]
    equations = hb.HarmonicBalance(5, **VARIANTS[variant]).equations(system)
    free = tuple(range(min(3, len(system.parameters))))
    first, second = equations.derivatives(free), equations.hessian(free)
    z, p = _point(equations)
    m = equations.size
    scale = np.concatenate([equations.scale, np.abs(p[list(free)]) + 0.1])
    rows = equations.residual_scale
    lam = np.random.default_rng(1).standard_normal(m) / rows

    def evaluate(y):
        q = p.copy()
        q[list(free)] = y[m:]
        F, J = first(y[:m], q)
        return F.full().ravel(), J.full()

    y = np.concatenate([z, p[list(free)]])
    F, J = evaluate(y)
    np.testing.assert_allclose(F, equations.residual(z, p).full().ravel(), atol=1e-12 * rows.max())
    h, J_num, H_num = 1e-6, [], []
    for i in range(len(y)):
        step = np.zeros(len(y))
        step[i] = h * scale[i]
        (Fp, Jp), (Fm, Jm) = evaluate(y + step), evaluate(y - step)
        J_num.append((Fp - Fm) / (2 * h))
        H_num.append(lam @ (Jp - Jm) / (2 * h))
    J_scaled = J * scale
    np.testing.assert_allclose(J_scaled / rows[:, None], np.array(J_num).T / rows[:, None], atol=1e-6)
    if variant == "sampled":
        return  # where a sample passes the kink, second differences are not the second derivative
    d = np.random.default_rng(2).standard_normal(len(y))
    product = equations.hessian_times(free)(z, p, lam, scale * d).full().ravel() * scale
    H = second(z, p, lam).full() * np.outer(scale, scale)
    np.testing.assert_allclose(product, H @ d, atol=1e-11 * max(np.abs(H).max(), 1.0))
    np.testing.assert_allclose(H, np.array(H_num) * scale, atol=1e-5 * max(np.abs(H).max(), 1.0))


def test_residual_agrees_with_automatic_differentiation_for_every_parameter(bogie, balance):
    """Two ways to one derivative: the staged Jacobian and CasADi's on the whole residual."""
    z, p = _point(balance)
    free = tuple(range(len(p)))
    staged = balance.derivatives(free)(z, p)[1].full()
    zs, ps = ca.MX.sym("z", len(z)), ca.MX.sym("p", len(p))
    whole = ca.Function("J", [zs, ps], [ca.jacobian(balance.residual(zs, ps), ca.vertcat(zs, ps))])(z, p).full()
    np.testing.assert_allclose(staged, whole, rtol=1e-9, atol=1e-9 * np.abs(whole).max())


@pytest.fixture(scope="module")
def reference(balance, branch):
    return hb.solve(balance, branch.orbits[-5], V=127.81)


class TestVariantsAgree:
    """Class SOLVER: the same cycle whatever is condensed out or kept."""

    @pytest.mark.parametrize("variant", ["uncondensed", "all harmonics"])
    def test_on_the_bogie(self, bogie, reference, variant):
        equations = hb.HarmonicBalance(15, **VARIANTS[variant]).equations(bogie)
        other = hb.solve(equations, reference, V=127.81)
        np.testing.assert_allclose(other.coefficients, reference.coefficients, atol=1e-9 * 0.0153)
        assert other.omega == pytest.approx(reference.omega, rel=1e-9)

    def test_another_phase_is_the_same_cycle(self, bogie, reference):
        other = hb.solve(hb.HarmonicBalance(15, phase="q3").equations(bogie), reference, V=127.81)
        assert other.omega == pytest.approx(reference.omega, rel=1e-10)
        assert other.amplitude("q1") == pytest.approx(reference.amplitude("q1"), rel=1e-9)

    def test_first_and_second_order_van_der_pol(self):
        problem = hb.load_problem("van_der_pol")
        a, b = (
            hb.find_cycles(f(mu=1.0), harmonics=21, stability=False)[0]
            for f in (problem.van_der_pol, problem.van_der_pol_first_order)
        )
        assert a.omega == pytest.approx(b.omega, rel=1e-10)
        np.testing.assert_allclose(a.coefficients[:, 0], b.coefficients[:, 0], atol=1e-9)


def test_sampled_dead_band_converges_to_the_exact_integral(bogie, balance, branch):
    """ORDER: the sampling error falls like N^-2 on the whole."""
    exact = hb.solve(balance, branch.orbits[-5], V=127.81)
    errors = []
    for N in (128, 512, 2048):
        sampled = hb.HarmonicBalance(15, samples=N, contact=False).equations(bogie)
        errors.append(abs(hb.solve(sampled, exact, V=127.81).omega - exact.omega) / exact.omega)
    slope = np.polyfit(np.log([128, 512, 2048]), np.log(errors), 1)[0]
    assert -3.0 < slope < -1.5


def test_halving_the_samples_changes_nothing():
    """Documented of the default number of samples: half of it still resolves the products."""
    system = hb.load_problem("van_der_pol").van_der_pol(mu=1.0)
    cycle = hb.find_cycles(system, harmonics=21, stability=False)[0]
    method = hb.HarmonicBalance(21)
    half = hb.HarmonicBalance(21, samples=method.default_samples // 2).equations(system)
    assert hb.solve(half, cycle).omega == pytest.approx(cycle.omega, rel=1e-12)


def test_smooth_systems_converge_spectrally():
    """ORDER: the error falls by a constant factor per harmonic, as exp(-c H), down to round-off."""
    system, exact = hb.load_problem("van_der_pol").van_der_pol(mu=1.0), 2 * np.pi / 6.66328685932313019
    cycle = hb.find_cycles(system, harmonics=31, stability=False)[0]
    H = np.array([3, 7, 11, 15, 19])
    errors = [abs(hb.solve(hb.HarmonicBalance(int(h)).equations(system), cycle).omega / exact - 1) for h in H]
    ratios = np.log(errors[:-1]) - np.log(errors[1:])
    assert errors[-1] < 1e-7
    assert (ratios > 2.0).all()  # a power law would slow down; these stay above a factor 7 per 4 harmonics
    assert abs(cycle.omega / exact - 1) < 1e-10


def test_response_to_the_dead_band_decays_like_the_fourth_power(bogie, branch):
    """ORDER: continuous force with a kink: h^-2 in the force's slope, h^-4 in the response, on the envelope."""
    equations = hb.HarmonicBalance(61).equations(bogie)
    orbit = hb.solve(equations, branch.orbits[-5], V=127.81)
    h = np.arange(15, 62, 2)
    spectrum = orbit.spectrum("q1")[h]
    envelope = np.array([spectrum[i:].max() for i in range(len(h) - 6)])
    slope = np.polyfit(np.log(h[: len(envelope)]), np.log(envelope), 1)[0]
    assert -4.6 < slope < -3.4


def test_duffing_backbone_in_closed_form():
    """SOLVER: the frequency of x'' + x + x^3 = 0 by the complete elliptic integral; the damping comes out as 0."""
    problem = hb.load_problem("duffing")
    equations = hb.HarmonicBalance(31).equations(problem.duffing())
    hopf = hb.hopf_points(problem.duffing(), "d", (-0.5, 0.5))[0]
    family = hb.trace(equations, hopf, "d", (-0.5, 0.5), max_points=40)
    for orbit in family.orbits[5::12]:
        A = orbit.amplitude("x")
        exact = np.pi * np.sqrt(1 + A**2) / (2 * ellipk(A**2 / (2 * (1 + A**2))))
        assert orbit.omega == pytest.approx(exact, rel=1e-9)
        assert abs(orbit.parameters["d"]) < 1e-9


def test_gap_oscillator_period_in_closed_form():
    """The free mass between dead-band springs: T = 2 pi + 4 delta / (A - delta) at k = m = 1."""
    problem = hb.load_problem("gap_oscillator")
    system = problem.gap_oscillator()
    delta = system.values["delta"]
    motion = hb.simulate(system, {"x": 3 * delta}, 60.0, step=1e-3)
    guess = hb.motion.last_orbit(system, motion, 15)
    errors = []
    for H in (5, 15, 61):
        orbit = hb.solve(
            hb.HarmonicBalance(H).equations(system),
            guess,
            amplitude={"x": guess.first_harmonic("x")},
            free="d",
        )
        errors.append(abs(orbit.period / problem.period(orbit.amplitude("x")) - 1))
        assert abs(orbit.parameters["d"]) < 1e-9
    assert errors[-1] < 1e-6
    slope = np.polyfit(np.log([5, 15, 61]), np.log(errors), 1)[0]
    assert slope < -2.5


def test_equilibria_are_harmonic_zero():
    """x'' + x' + x + x^2 = 0.11: rest at 0.1, as 0.1 + 0.01 = 0.11."""
    x = hb.Coordinate("x")
    f = hb.Parameter("f", 0.11)
    system = hb.System("offset", [x], [f], [x.ddot + x.dot + x + x**2 - f])
    equations = hb.HarmonicBalance(0).equations(system)
    rest = hb.Orbit("offset", ("x",), ("",), np.zeros((1, 1)), 0.0, {})
    found = hb.solve(equations, rest)
    assert found.coefficients[0, 0] == pytest.approx(0.1, abs=1e-11)
    assert found.H == 0


def test_a_preloaded_asymmetric_system_has_a_mean_and_even_harmonics():
    """Two methods, one truth: harmonic balance against simulation."""
    system = PROBLEMS["lopsided"]
    assert not system.odd
    settled = hb.motion.settle(system, {"x": 1.0})
    guess = hb.motion.last_orbit(system, settled.trajectory, 20)
    orbit = hb.solve(hb.HarmonicBalance(40).equations(system), guess)
    assert orbit.omega == pytest.approx(settled.omega, rel=1e-5)
    assert orbit.amplitude("x") == pytest.approx(settled.amplitudes["x"], rel=1e-4)
    assert abs(orbit.coefficients[0, 0]) > 1e-3 and orbit.spectrum("x")[2] > 1e-3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"harmonics": -1}, "whole number"),
        ({"harmonics": 2.5}, "whole number"),
        ({"harmonics": 5, "samples": 10}, "at least 22"),
        ({"harmonics": 5, "samples": 33}, "even number"),
    ],
)
def test_wrong_harmonics_and_samples(arguments, message):
    with pytest.raises(ModelError, match=message):
        hb.HarmonicBalance(**arguments)


def test_phase_must_be_an_unknown(bogie):
    with pytest.raises(ModelError, match="condensed out"):
        hb.HarmonicBalance(3, phase="q5").equations(bogie)


class TestContactsOfAnOddSystemThatAreNotOddThemselves:
    """IDENTITY: half a period stands for the whole, so the constants of a lopsided law have harmonics there."""

    def _same(self, some, others):
        x, d = hb.Coordinate("x"), hb.Parameter("d", 0.1)
        z, residuals = np.array([1.6, 0.1, -0.2, 0.15, 0.05, 1.1]), []
        for laws in (some, others):
            elements = [hb.Element(f"e{i}", law, x + shift) for i, (law, shift) in enumerate(laws)]
            system = hb.System("s", [x], [d], [x.ddot - d * x.dot + x + sum(elements)], elements)
            assert system.odd
            equations = hb.HarmonicBalance(5).equations(system)
            residuals.append(equations.residual(z, system.vector()).full())
        np.testing.assert_allclose(*residuals, atol=1e-12)

    def test_table_of_a_dead_band(self):
        self._same([(hb.model.Tabulated((-2, -1, 1, 2), (-1, 0, 0, 1)), 0)], [(hb.model.DeadBand(1.0, 1.0), 0)])

    def test_preloaded_pair(self):
        """Stops at 1 shifted by +-0.3 are stops at 0.7 and at 1.3."""
        band = hb.model.DeadBand(1.0, 1.0)
        self._same([(band, 0.3), (band, -0.3)], [(hb.model.DeadBand(1.0, 0.7), 0), (hb.model.DeadBand(1.0, 1.3), 0)])


def test_odd_harmonics_cannot_be_forced_on_a_system_that_is_not_odd():
    x, e = hb.Coordinate("x"), hb.Parameter("e", 0.0)
    system = hb.System("s", [x], [e], [x.ddot - (1 - x**2) * x.dot + x + e * x**2])
    assert not system.odd  # not for all values of e
    assert hb.HarmonicBalance(5).kept(system) == (0, 1, 2, 3, 4, 5)
    assert hb.HarmonicBalance(5, odd=True).kept(system) == (1, 3, 5)
    with pytest.raises(ModelError, match="not odd at its parameter values"):
        hb.HarmonicBalance(5, odd=True).equations(system.with_parameters(e=0.1))


def test_a_spring_without_stiffness_has_no_effect():
    """What is left is van der Pol's oscillator, whose period is known."""
    x, k = hb.Coordinate("x"), hb.Parameter("k", 0.0)
    limit = hb.Element("limit", hb.model.Saturation(k, 1.0), x)
    system = hb.System("s", [x], [k], [x.ddot - (1 - x**2) * x.dot + x + limit], [limit])
    (cycle,) = hb.find_cycles(system)
    assert cycle.period == pytest.approx(6.66328685932313019, rel=1e-6)
    (cycle,) = hb.find_cycles(system, k=1.0)
    assert cycle.stability.verdict == "stable"


def test_a_gap_at_infinity_is_named():
    class Stop(hb.model.PiecewiseLinear):
        def ramps(self):
            return hb.model.Ramps(((1, 1.0, 1 / k), (-1, 1.0, 1 / k)))

    x, k = hb.Coordinate("x"), hb.Parameter("k", 0.0)
    stop = hb.Element("stop", Stop(), x)
    system = hb.System("s", [x], [k], [x.ddot - (1 - x**2) * x.dot + x + stop], [stop])
    with pytest.raises(ModelError, match=r"'stop' \(Stop\): its gaps are inf"):
        hb.HarmonicBalance(5).equations(system)


class TestOddAtThePresentValuesOnly:
    """Odd harmonics of a system that parameters e, c and b may make lopsided: their derivatives count all of it."""

    def _system(self):
        x, y = hb.Coordinate("x"), hb.Coordinate("y")
        names = {"mu": -0.2, "e": 0.0, "c": 0.0, "b": 0.0, "k": 4.0, "g": 0.5}
        P = {name: hb.Parameter(name, value) for name, value in names.items()}
        stop = hb.Element("stop", hb.model.DeadBand(P["k"], P["g"]), x + 0.2 * x.dot - P["c"])
        table = hb.Element("table", hb.model.Tabulated((-2, -1, 1, 2), (-1, 0, 0, 1)), x + P["c"])
        limit = hb.Element("limit", hb.model.Saturation(2.0, P["g"]), y - x - P["b"])
        drift = (P["mu"] + x**2 - x**4) * x.dot
        forces = stop + table - limit + P["e"] * x**2 + P["b"]
        equations = [x.ddot - drift + x + 0.3 * x**3 + forces, y.ddot + 0.3 * y.dot + 2 * y + limit + P["e"] * x.dot**2]
        return hb.System("nearly odd", [x, y], list(P.values()), equations, [stop, table, limit])

    @pytest.mark.parametrize("contact", [True, False])
    def test_derivatives_are_those_of_all_harmonics_projected(self, contact):
        """IDENTITY: at an odd motion the odd rows and columns of the full equations, in every parameter."""
        system = self._system()
        assert not system.odd
        odd, full = (hb.HarmonicBalance(5, odd=o, contact=contact).equations(system) for o in (True, False))
        z, p = _point(odd)
        c, omega = odd.coefficients(z, p).full(), float(odd.frequency(z))
        Z = full.from_coefficients(c, omega)
        places, rows = ([full.__dict__[k].index(n) for n in odd.__dict__[k]] for k in ("unknowns", "rows"))
        np.testing.assert_allclose(Z[places], z, rtol=1e-14)
        free, m, M = tuple(range(len(p))), odd.size, full.size
        columns = [*places, *range(M, M + len(p))]
        (F, J), (F_all, J_all) = ([a.full() for a in q.derivatives(free)(v, p)] for q, v in ((odd, z), (full, Z)))
        np.testing.assert_allclose(F, F_all[rows], atol=1e-11)
        np.testing.assert_allclose(J, J_all[np.ix_(rows, columns)], atol=1e-10)
        weights = np.zeros(M)
        weights[rows] = lam = np.random.default_rng(2).standard_normal(m)
        slopes = odd.sensitivity()(z, p, lam).full()
        np.testing.assert_allclose(slopes, full.sensitivity()(Z, p, weights).full(), atol=1e-10)
        np.testing.assert_allclose(slopes.ravel(), lam @ J[:, m:], atol=1e-10)
        H, H_all = odd.hessian(free)(z, p, lam).full(), full.hessian(free)(Z, p, weights).full()
        np.testing.assert_allclose(H, H_all[np.ix_(columns, columns)], atol=1e-9 * np.abs(H_all).max())

    @pytest.mark.parametrize("contact", [True, False])
    def test_full_equations_by_finite_differences(self, contact):
        """ORDER: the sensitivity of the odd harmonics against central differences of the full residual."""
        system = self._system()
        odd, full = (hb.HarmonicBalance(5, odd=o, contact=contact).equations(system) for o in (True, False))
        z, p = _point(odd)
        Z = full.from_coefficients(odd.coefficients(z, p).full(), float(odd.frequency(z)))
        lam = np.random.default_rng(3).standard_normal(odd.size)
        rows, h = [full.rows.index(n) for n in odd.rows], 1e-6
        steps = h * np.eye(len(p))
        sides = [[full.residual(Z, p + side * step).full()[rows, 0] for step in steps] for side in (1, -1)]
        differences = (np.array(sides[0]) - np.array(sides[1])) @ lam / (2 * h)
        np.testing.assert_allclose(odd.sensitivity()(z, p, lam).full().ravel(), differences, atol=1e-7)

    @pytest.mark.parametrize("odd", [True, None])
    def test_gradient_of_a_fold_is_even_in_what_breaks_the_symmetry(self, odd):
        """x -> -x takes e to -e, so that the fold has the same value at both: the slope in e is 0."""
        x, mu, e = hb.Coordinate("x"), hb.Parameter("mu", -0.2), hb.Parameter("e", 0.0)
        drift = (mu + x**2 - x**4) * x.dot
        system = hb.System("s", [x], [mu, e], [x.ddot - drift + x + 0.3 * x**3 + e * x**2])
        equations = hb.HarmonicBalance(9, odd=odd).equations(system)
        (hopf,) = hb.hopf_points(system, "mu", (-1.0, 1.0))
        start = hb.trace(equations, hopf, "mu", (-1.0, 1.0), stability=False).folds()[0]
        assert hb.fold(equations, start, "mu").gradient["e"] == pytest.approx(0.0, abs=1e-12)


def test_long_chains_are_condensed_in_blocks():
    """One nonlinear mass amid forty linear ones: a few of these are kept, and the cycle stays the same."""
    q = [hb.Coordinate(f"q{i}", "m") for i in range(41)]
    mu, k = hb.Parameter("mu", 0.2), hb.Parameter("k", 0.3)
    links = [k * (b - a) for a, b in pairwise(q)]
    sides = zip(q, [0, *links], [*links, 0], strict=True)
    equations = [u.ddot + u + 0.05 * u.dot - right + left for u, left, right in sides]
    equations[20] -= (mu + 0.05) * (1 - q[20] ** 2) * q[20].dot
    system = hb.System("chain", q, [mu, k], equations)
    condensed, full = (hb.HarmonicBalance(1, condense=c).equations(system) for c in (True, False))
    assert condensed.size < full.size / 4
    alone = np.zeros((3, 41))
    alone[1, 20] = 2.0
    names, units = system.coordinate_names, ("m",) * 41
    start = hb.Orbit("chain", names, units, alone, 1.0, dict(system.values))
    found = [hb.solve(e, start, k=0.05) for e in (condensed, full)]
    assert found[0].omega == pytest.approx(found[1].omega, rel=1e-10)
    np.testing.assert_allclose(found[0].coefficients, found[1].coefficients, atol=1e-10)
