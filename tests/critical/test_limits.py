"""Where a branch meets a limit: closed forms, and neighbours that are solved for anew."""

from __future__ import annotations

import pytest

import hbbogie as hb
from hbbogie.critical import limit_points


@pytest.fixture(scope="module")
def simple():
    return hb.load_problem("simple_bogie").simple_bogie()


def branch_of(system, parameter, low, high, at, harmonics):
    equations = hb.HarmonicBalance(harmonics).equations(system)
    cycle = hb.find_cycles(system, parameter=parameter, interval=(low, high), **{parameter: at})[-1]
    cycle = hb.solve(equations, cycle)
    return equations, hb.trace(equations, cycle, parameter, (low, high), stability=False)


@pytest.fixture(scope="module")
def traced(simple):
    return branch_of(simple, "V", 64.0, 120.0, 70.0, 15)


def test_circles_in_closed_form():
    """x' = x (mu - b (x^2 + y^2)) - y and its like for y: the radius is sqrt(mu/b), its rms sqrt(mu/(2 b))."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    mu, b = hb.Parameter("mu", 0.3), hb.Parameter("b", 2.0)
    rate = mu - b * (x**2 + y**2)
    outputs = [hb.Output("double", 2 * x + 0 * b, "m")]
    equations = [x.dot - x * rate + y, y.dot - y * rate - x]
    system = hb.System("circles", [x, y], [mu, b], equations, outputs=outputs)
    balance, branch = branch_of(system, "mu", 0.05, 1.0, 0.3, 3)
    for of, quantity, limit, value in (
        ("x", "rms", 0.2, 2 * 2.0 * 0.2**2),
        ("double", "rms", 0.4, 2 * 2.0 * 0.2**2),
        ("double", "peak", 0.8, 2.0 * 0.4**2),
        ("y", "first harmonic", 0.5, 2.0 * 0.5**2),
    ):
        (point,) = limit_points(balance, branch, of, limit, quantity)
        assert point.value == pytest.approx(value, rel=1e-9), (of, quantity)
        assert point.gradient == pytest.approx({"b": value / 2.0}, rel=1e-8)
        assert point.per_limit == pytest.approx(2 * value / limit, rel=1e-8)
        assert point.elasticities["b"] == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize(
    ("of", "quantity", "limit"),
    [
        ("guiding forces, rear", "rms", 9e3),
        ("frame acceleration, front", "peak", 2.5),
        ("q1", "first harmonic", 9.2e-3),
    ],
)
def test_gradient_is_that_of_neighbours_solved_for_anew(simple, traced, of, quantity, limit):
    equations, branch = traced
    (point,) = limit_points(equations, branch, of, limit, quantity)
    measured = {"rms": point.orbit.rms, "peak": point.orbit.amplitude, "first harmonic": point.orbit.first_harmonic}
    assert measured[quantity](of) == pytest.approx(limit, rel=1e-6)
    assert set(point.gradient) == set(simple.parameter_names) - {"V"}

    def at(name, change):
        value = limit * (1 + change) if name is None else limit
        moved = simple if name is None else simple.with_parameters(**{name: simple.values[name] * (1 + change)})
        own = hb.HarmonicBalance(15).equations(moved)
        beside = [hb.solve(own, point.orbit, method="newton", V=point.value + d) for d in (-0.1, 0.1)]
        (found,) = limit_points(own, hb.results.Branch(tuple(beside), "V"), of, value, quantity)
        return found.value

    for name in ("m", "lam", "muN", "k0", None):
        slope = (at(name, 5e-5) - at(name, -5e-5)) / 1e-4
        size = limit * point.per_limit if name is None else simple.values[name] * point.gradient[name]
        assert size == pytest.approx(slope, rel=2e-6, abs=1e-6 * point.value), name


def test_branch_on_one_side_of_a_limit_meets_it_nowhere(traced):
    assert limit_points(*traced, "q1", 1.0) == []


def test_what_is_refused(simple, traced):
    for wrong, said in (
        (("q7", 1.0), "unknown coordinate or output 'q7'"),
        (("q1", -1.0), "above 0 in m"),
        (("q1", 1.0, "mean"), "quantity"),
    ):
        with pytest.raises(hb.ModelError, match=said):
            limit_points(*traced, *wrong)
    rest = hb.HarmonicBalance(0).equations(simple)
    with pytest.raises(hb.ModelError, match="equations of cycles"):
        limit_points(rest, traced[1], "q1", 0.01)
