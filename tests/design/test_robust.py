"""Critical values under uncertain parameters: moments in closed form, Monte Carlo, a robust optimum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import hbbogie as hb
from hbbogie.design import (
    MonteCarlo,
    RobustValue,
    SampledQuantile,
    Spread,
    Uncertainty,
    design_point,
    monte_carlo,
    predicted_below,
    spreads,
)

FACTORS = {
    "f11": stats.lognorm(0.1),
    "lam": stats.uniform(0.9, 0.25),
    "K1": stats.norm(1, 0.05),
    "K2": stats.norm(1, 0.1),
}


def moments_by_quadrature(spread, factors):
    """Mean and deviation of a quadratic function of independent factors, by Gauss quadrature in their quantiles."""
    nodes, weights = np.polynomial.legendre.leggauss(120)
    u, w = (nodes + 1) / 2, weights / 2
    grids = np.meshgrid(*(d.ppf(u) for d in factors.values()), indexing="ij")
    weight = np.prod(np.meshgrid(*[w] * len(factors), indexing="ij"), axis=0).ravel()
    values = spread.predict(np.column_stack([g.ravel() for g in grids]))
    mean = weight @ values
    return mean, np.sqrt(weight @ (values - mean) ** 2)


def test_second_order_moments_are_exact_for_a_quadratic_function():
    """Skewed factors whose mean is not 1; the quadrature is good to about 1e-6 in the tails."""
    factors = {"a": stats.uniform(0.7, 0.9), "b": stats.gamma(20, scale=0.06)}
    spread = Spread("q", 3.0, np.array([1.2, -0.7]), np.array([[2.0, -1.5], [-1.5, 0.8]]), Uncertainty(factors))
    mean, deviation = spread.second_order
    expected = moments_by_quadrature(spread, factors)
    assert mean == pytest.approx(expected[0], rel=1e-5) and deviation == pytest.approx(expected[1], rel=1e-4)


def test_first_order_moments_are_exact_for_a_linear_function():
    factors = {"a": stats.uniform(0.7, 0.9), "b": stats.lognorm(0.2)}
    slopes = np.array([1.2, -0.7])
    spread = Spread("l", 3.0, slopes, np.zeros((2, 2)), Uncertainty(factors))
    means, deviations = np.array([(d.mean(), d.std()) for d in factors.values()]).T
    for mean, deviation in (spread.first_order, spread.second_order):
        assert mean == pytest.approx(3 + slopes @ (means - 1), rel=1e-14)
        assert deviation == pytest.approx(np.linalg.norm(slopes * deviations), rel=1e-14)
    assert sum(spread.shares.values()) == pytest.approx(1.0, abs=1e-14)


def test_correlated_normal_factors():
    """Isserlis: the variance of x' h x / 2 is tr (h C h C) / 2, and that of a linear function a' C a."""
    C = np.array([[1.0, 0.6], [0.6, 1.0]])
    uncertain = Uncertainty({"a": stats.norm(1, 0.1), "b": stats.norm(1, 0.2)}, C)
    S, a, h = np.outer([0.1, 0.2], [0.1, 0.2]) * C, np.array([1.0, -2.0]), np.array([[3.0, 1.0], [1.0, -4.0]])
    mean, deviation = Spread("q", 0.0, a, h, uncertain).second_order
    assert mean == pytest.approx(np.trace(h @ S) / 2, rel=1e-13)
    assert deviation**2 == pytest.approx(a @ S @ a + np.trace(h @ S @ h @ S) / 2, rel=1e-13)
    drawn = uncertain.sample(40_000, np.random.default_rng(1))
    assert np.abs(np.cov(drawn.T) - S).max() < 1e-3


def test_bautin_in_closed_form():
    """The fold is -a^2 / 4, a quadratic function: with a = 1.5 x and x normal its moments and probability are known."""
    system = hb.load_problem("bautin").bautin(a=1.5)
    point, uncertain = design_point(system, "mu", (-2.5, 0.5), 3), Uncertainty({"a": stats.norm(1, 0.1)})
    (fold,) = (s for s in spreads(point, uncertain) if s.name == "fold 1")
    c = -(1.5**2) / 4
    assert fold.first_order == pytest.approx((c, -c * 2 * 0.1), rel=1e-8)
    # E x^2 = 1 + s^2, var x^2 = 4 s^2 + 2 s^4
    assert fold.second_order == pytest.approx((c * 1.01, -c * np.sqrt(0.04 + 2e-4)), rel=1e-7)
    _, second = predicted_below([fold], -0.7, count=200_000)
    exact = stats.norm.sf((np.sqrt(0.7 * 4) / 1.5 - 1) / 0.1)
    assert second == pytest.approx(exact, abs=4 * np.sqrt(exact * (1 - exact) / 200_000))
    drawn = monte_carlo(point, uncertain, 40, seed=3)
    np.testing.assert_allclose(drawn.values, c * drawn.factors[:, 0] ** 2, rtol=1e-8)


def test_clopper_pearson():
    """PUBLISHED: no failure in n trials: upper end 1 - (0.025)^(1/n)."""
    drawn = MonteCarlo(np.ones((30, 1)), np.append(np.full(29, 2.0), np.nan))
    share, low, high = drawn.probability_below(1.0)
    assert (share, low, drawn.failed) == (0.0, 0.0, 1) and high == pytest.approx(1 - 0.025 ** (1 / 29), rel=1e-12)


@pytest.fixture(scope="module")
def point(bogie):
    return design_point(bogie, "V", (60.0, 190.0))


def test_the_bogie_against_monte_carlo(point):
    """The quadratic prediction, design by design; the moments within four standard errors of the sample's."""
    uncertain = Uncertainty(FACTORS)
    found, drawn = spreads(point, uncertain), monte_carlo(point, uncertain, 40, seed=1)
    assert drawn.failed == 0
    linear = found[0].value + (drawn.factors - 1) @ found[0].slopes
    quadratic = np.min([f.predict(drawn.factors) for f in found], axis=0)
    errors = [np.sqrt(np.mean((p - drawn.values) ** 2)) for p in (linear, quadratic)]
    assert errors[1] < 0.5 * errors[0] and errors[1] < 0.1 * drawn.values.std()
    mean, deviation = found[0].second_order
    assert abs(drawn.values.mean() - mean) < 4 * deviation / np.sqrt(40)
    assert abs(drawn.values.std(ddof=1) / deviation - 1) < 4 / np.sqrt(2 * 40)


@pytest.mark.parametrize("name", ["K1", "lam", "b"])
def test_gradient_of_the_robust_value(bogie, point, name):
    """ORDER: central differences, for parameters that are uncertain themselves and for one that is not."""
    robust = RobustValue.quantile(Uncertainty(FACTORS), 0.05)
    assert robust.k == pytest.approx(1.6449, abs=5e-5)
    h, value, sides = 1e-4, bogie.values[name], []
    for sign in (1, -1):
        near = design_point(bogie.with_parameters(**{name: value * (1 + sign * h)}), "V", (60.0, 190.0), near=point)
        sides.append([row.value for row in robust.rows(near)])
    slopes = [row.gradient[bogie.parameter_names.index(name)] * value for row in robust.rows(point)]
    np.testing.assert_allclose((np.array(sides[0]) - sides[1]) / (2 * h), slopes, atol=1e-5)


def test_a_robust_optimum_in_closed_form():
    """A Hopf point at 2 s - s^2 x of an uncertain factor x: mean minus k sigma has its maximum at 1 / (1 + k sigma)."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    mu, s, e = hb.Parameter("mu", 0.0), hb.Parameter("s", 0.4), hb.Parameter("e", 1.0)
    rate = mu - 2 * s + s**2 * e - x**2 - y**2
    system = hb.System("parabola", [x, y], [mu, s, e], [x.dot - rate * x + y, y.dot - rate * y - x])
    robust = RobustValue(Uncertainty({"e": stats.norm(1, 0.25)}), 2.0)
    found = hb.optimise(
        system, raise_="mu", over={"s": (0.1, 1.5)}, maximise=robust, interval=(-3.0, 3.0), harmonics=3, tolerance=1e-8
    )
    assert found.converged and found.parameters["s"] == pytest.approx(1 / 1.5, rel=1e-6)
    assert found.value == pytest.approx(1 / 1.5, rel=1e-9)


def test_a_sampled_quantile_in_closed_form():
    """The fold -a^2 x^2 / 4: SciPy's quantile of Harrell and Davis of the true values; its derivative is 2 v / a."""
    system = hb.load_problem("bautin").bautin(a=1.5)
    point, uncertain = design_point(system, "mu", (-2.5, 0.5), 3), Uncertainty({"a": stats.norm(1, 0.1)})
    row, *others = SampledQuantile(uncertain, 0.1, 30, seed=2).rows(point)
    true = -((1.5 * uncertain.evenly(30, 2)[:, 0]) ** 2) / 4
    assert row.value == pytest.approx(float(stats.mstats.hdquantiles(true, [0.1])[0]), rel=1e-8)
    for other in (row, *others):  # homogeneous of degree 2 in a, whichever values count
        assert other.value >= row.value
        assert other.gradient[system.parameter_names.index("a")] == pytest.approx(2 * other.value / 1.5, rel=1e-6)
        assert other.hessian(["a"])[0, 0] == pytest.approx(2 * other.value / 1.5**2, rel=0.02)  # of those that count


def test_a_sampled_optimum_in_closed_form():
    """The Hopf point 2 s - s^2 x: with Q the upper quantile of x, the lower one has its maximum 1 / Q at s = 1 / Q."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    mu, s, e = hb.Parameter("mu", 0.0), hb.Parameter("s", 0.4), hb.Parameter("e", 1.0)
    rate = mu - 2 * s + s**2 * e - x**2 - y**2
    system = hb.System("parabola", [x, y], [mu, s, e], [x.dot - rate * x + y, y.dot - rate * y - x])
    uncertain = Uncertainty({"e": stats.norm(1, 0.25)})
    quantile = SampledQuantile(uncertain, 0.1, 6, seed=1)
    found = hb.optimise(
        system, raise_="mu", over={"s": (0.1, 1.5)}, maximise=quantile, interval=(-3.0, 3.0), harmonics=3
    )
    Q = float(stats.mstats.hdquantiles(uncertain.evenly(6, 1)[:, 0], [0.9])[0])
    assert found.converged and found.parameters["s"] == pytest.approx(1 / Q, rel=1e-4)
    assert found.value == pytest.approx(1 / Q, rel=1e-6)


def test_evenly_spread_factors():
    """The mean of 256 normal factors misses the true one by far less than 1 / 16 of their deviation; so correlated."""
    C = np.array([[1.0, 0.6], [0.6, 1.0]])
    pair = {"a": stats.norm(1, 0.1), "b": stats.norm(1, 0.2)}
    for uncertain in (Uncertainty(pair), Uncertainty(pair, C)):
        x = uncertain.evenly(256, seed=1)
        np.testing.assert_allclose(x.mean(axis=0), 1.0, atol=0.1 / 160)
        correlation = 0.0 if uncertain.correlation is None else 0.6
        assert np.corrcoef(x.T)[0, 1] == pytest.approx(correlation, abs=0.02)


def test_the_best_quantile_lies_where_two_random_designs_are_equal():
    """The critical value s e + (1 - s) (2 - e) is 1 for every e at s = 1/2, and for some e lower on either side."""
    x, y, mu = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("mu", 0.0)
    s, e = hb.Parameter("s", 0.3), hb.Parameter("e", 1.0)
    rate = mu - s * e - (1 - s) * (2 - e) - x**2 - y**2
    system = hb.System("crossing", [x, y], [mu, s, e], [x.dot - rate * x + y, y.dot - rate * y - x])
    quantile = SampledQuantile(Uncertainty({"e": stats.uniform(0.5, 1.0)}), 0.1, 4, seed=1)
    found = hb.optimise(
        system, raise_="mu", over={"s": (0.1, 0.9)}, maximise=quantile, interval=(-3.0, 3.0), harmonics=3
    )
    assert found.converged and found.parameters["s"] == pytest.approx(0.5, abs=1e-6)
    assert found.value == pytest.approx(1.0, rel=1e-8) and len(found.weights) >= 2


def test_random_bogies_are_solved_for_in_batches(bogie, point):
    """SOLVER: as by the function for many designs; ORDER: the gradient of the quantile by central differences."""
    uncertain = Uncertainty(FACTORS)
    drawn = monte_carlo(point, uncertain, 24, seed=4)
    designs = {name: bogie.values[name] * drawn.factors[:, i] for i, name in enumerate(FACTORS)}
    found = hb.critical_speeds_of(bogie, designs, interval=(60.0, 190.0))
    np.testing.assert_allclose(drawn.values, found.critical, rtol=1e-10)
    quantile, h = SampledQuantile(uncertain, 0.2, 24, seed=4), 1e-4
    row = quantile.rows(point)[0]
    assert np.sort(drawn.values)[0] < row.value < np.median(drawn.values)
    for name in ("K1", "b"):  # one that is uncertain, one that is not
        sides = []
        for sign in (1, -1):
            system = bogie.with_parameters(**{name: bogie.values[name] * (1 + sign * h)})
            sides.append(quantile.rows(design_point(system, "V", (60.0, 190.0), near=point))[0].value)
        slope = row.gradient[bogie.parameter_names.index(name)] * bogie.values[name]
        assert (sides[0] - sides[1]) / (2 * h) == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_wrong_input(point):
    with pytest.raises(hb.ModelError, match="names no parameter"):
        Uncertainty({})
    with pytest.raises(hb.ModelError, match="factor of 'a' is 'normal'; give a frozen distribution"):
        Uncertainty({"a": "normal"})
    with pytest.raises(hb.ModelError, match="finite number of standard deviations"):
        RobustValue(Uncertainty(FACTORS), float("nan"))
    for quantity in (RobustValue, SampledQuantile):  # a stiffness of less than nothing
        with pytest.raises(hb.ModelError, match=r"'K1' takes it from -.* but its bounds are"):
            quantity(Uncertainty({"K1": stats.norm(1, 0.5)})).rows(point)
    with pytest.raises(hb.ModelError, match="'a' has no finite moments"):
        Uncertainty({"a": stats.cauchy()})
    with pytest.raises(hb.ModelError, match="normal factors"):
        Uncertainty({"a": stats.uniform(), "b": stats.norm()}, np.eye(2))
    for q in (0.0, 1.0, -0.1, 5, float("nan")):
        with pytest.raises(hb.ModelError, match="between 0 and 1"):
            SampledQuantile(Uncertainty(FACTORS), q)
    for count in (0, 1.5, -3, float("inf"), "many"):
        with pytest.raises(hb.ModelError, match="count"):
            SampledQuantile(Uncertainty(FACTORS), 0.05, count)
        with pytest.raises(hb.ModelError, match="count"):
            monte_carlo(point, Uncertainty(FACTORS), count)
    with pytest.raises(hb.ModelError, match="between 0 and 1"):
        RobustValue.quantile(Uncertainty(FACTORS), 5)
    with pytest.raises(hb.ModelError, match="unknown parameter 'k1'"):
        spreads(point, Uncertainty({"k1": stats.norm(1, 0.1)}))
    with pytest.raises(hb.ModelError, match="'V' is the parameter"):
        spreads(point, Uncertainty({"V": stats.norm(1, 0.1)}))
