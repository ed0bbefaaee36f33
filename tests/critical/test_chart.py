"""Curves of folds and of Hopf points over two parameters."""

from __future__ import annotations

import json
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import plot
from hbbogie.commandline import app
from hbbogie.critical import HopfCurve
from hbbogie.equilibria import Linearisation

SPAN = (1.0, 270.0)


def radial(growth, parameters, name):
    """x' = x growth(x^2 + y^2) - y, y' = y growth + x: cycles are the circles on which the growth vanishes."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    rate = growth(x**2 + y**2)
    return hb.System(name, [x, y], parameters, [x.dot - x * rate + y, y.dot - y * rate - x])


def points_of(chart, kind):
    return [p for p in chart.special if p.kind == kind]


@pytest.fixture(scope="module")
def bogie_chart(bogie):
    return hb.chart(bogie, "V", "lam", (0.02, 0.3), span=SPAN)


@pytest.fixture(scope="module")
def balanced_chart(bogie):
    return hb.chart(bogie, "V", "lam", (0.02, 0.11), span=SPAN, harmonics=15)


@pytest.fixture(scope="module")
def limit(bogie_chart):
    """The curve of Hopf points at which the straight run loses its stability."""
    (curve,) = [c for c in bogie_chart.hopf if np.any(c.side != 0)]
    return curve


@pytest.fixture(scope="module")
def bautin_chart():
    return hb.chart(hb.load_problem("bautin").bautin(), "mu", "a", (-1.0, 1.0), span=(-0.5, 0.5), harmonics=3)


class TestBautin:
    """SOLVER: folds at mu = -a^2 / 4, Hopf points at mu = 0, sub- and supercritical by the sign of a."""

    def test_folds(self, bautin_chart):
        (fold,) = bautin_chart.folds
        np.testing.assert_allclose(fold.values, -(fold.over_values**2) / 4, atol=1e-9)
        np.testing.assert_allclose(fold.slope, -fold.over_values / 2, atol=1e-6)
        assert set(fold.character) == {"minimum"} and len(fold) > 20

    def test_they_end_in_the_bautin_point(self, bautin_chart):
        (bautin,) = points_of(bautin_chart, "Bautin point")
        assert (bautin.value, bautin.omega) == pytest.approx((0.0, 1.0), abs=1e-10)
        assert bautin.over_value == pytest.approx(0.0, abs=1e-10)
        (fold,) = bautin_chart.folds
        assert fold.extent == pytest.approx((0.0, 1.0), abs=1e-10)
        assert "ends on a curve of Hopf points" in " ".join(map(str, fold.ends))

    def test_hopf_points(self, bautin_chart):
        (hopf,) = bautin_chart.hopf
        np.testing.assert_allclose(hopf.values, 0.0, atol=1e-10)
        decided = np.abs(hopf.over_values) > 1e-9
        expected = np.where(hopf.over_values > 0, "subcritical", "supercritical")
        assert (np.array(hopf.character)[decided] == expected[decided]).all()
        assert (hopf.side == -1).all()

    def test_the_range_without_a_fold(self, bautin_chart):
        assert bautin_chart.without_fold == (pytest.approx((-1.0, 0.0), abs=1e-10),)
        assert bautin_chart.without_hopf == ()
        assert any(
            "No fold on branches at which rest loses stability was found for a from -1 to 0 1/s" in note
            for note in bautin_chart.notes
        )


@pytest.fixture(scope="module")
def cusp_chart():
    mu, b = hb.Parameter("mu", 0.0), hb.Parameter("b", 0.5)
    system = radial(lambda R: mu + b * R + R**2 - R**3, [mu, b], "cusp of folds")
    return hb.chart(system, "mu", "b", (-0.6, 1.0), span=(-0.6, 0.3), harmonics=1)


class TestCusp:
    """SOLVER: growth mu + b R + R^2 - R^3; folds where it and its slope vanish, a cusp at R = 1/3."""

    def test_the_cusp(self, cusp_chart):
        (cusp,) = points_of(cusp_chart, "cusp")
        assert cusp.over_value == pytest.approx(-1 / 3, rel=1e-8)
        assert cusp.value == pytest.approx(1 / 27, rel=1e-8)

    def test_both_folds(self, cusp_chart):
        (fold,) = cusp_chart.folds
        b, root = fold.over_values, np.sqrt(np.maximum(1 + 3 * fold.over_values, 0))
        sign = np.where(np.array(fold.character) == "minimum", 1.0, -1.0)
        R = (1 + sign * root) / 3
        away = np.abs(b + 1 / 3) > 1e-6  # at the cusp itself both radii are the same
        expected = -(b * R + R**2 - R**3)
        np.testing.assert_allclose(fold.values[away], expected[away], atol=1e-9)
        assert {*fold.character} == {"minimum", "maximum"}
        np.testing.assert_allclose(fold.slope[away], -R[away], atol=1e-4)

    def test_the_inner_fold_ends_in_the_bautin_point(self, cusp_chart):
        (bautin,) = points_of(cusp_chart, "Bautin point")
        assert (bautin.over_value, bautin.value) == pytest.approx((0.0, 0.0), abs=1e-10)
        (fold,) = cusp_chart.folds
        ends = [(fold.over_values[i], fold.values[i]) for i in (0, -1)]
        assert (0.0, 0.0) in ends

    def test_the_range_without_a_fold(self, cusp_chart):
        assert cusp_chart.without_fold[0] == pytest.approx((-0.6, -1 / 3), abs=1e-8)


def test_a_closed_curve_of_hopf_points_with_its_turning_points():
    """SOLVER: the circle (V - 1)^2 + s^2 = 1 / 4; the equilibrium is unstable inside."""
    V, s = hb.Parameter("V", 1.0), hb.Parameter("s", 0.0)
    system = radial(lambda R: 0.25 - (V - 1) ** 2 - s**2 - R, [V, s], "circle")
    chart = hb.chart(system, "V", "s", (-1.0, 1.0), span=(0.0, 2.0), harmonics=1)
    (hopf,) = chart.hopf
    np.testing.assert_allclose((hopf.values - 1) ** 2 + hopf.over_values**2, 0.25, atol=1e-9)
    assert tuple(map(str, hopf.ends)) == ("the curve closes on itself",) * 2
    turns = sorted(p.over_value for p in points_of(chart, "turning point"))
    assert turns == pytest.approx([-0.5, 0.5], abs=1e-9)
    assert np.array(chart.without_hopf) == pytest.approx(np.array([(-1.0, -0.5), (0.5, 1.0)]), abs=1e-9)
    away = np.abs(hopf.values - 1) > 1e-3
    assert (hopf.side[away] == np.sign(hopf.values - 1)[away]).all()


def test_hopf_points_of_an_equilibrium_that_moves():
    """SOLVER: Brusselator, b = 1 + A^2 with omega = A; everywhere supercritical."""
    x, y = hb.Coordinate("x"), hb.Coordinate("y")
    b, A = hb.Parameter("b", 2.0), hb.Parameter("A", 1.2)
    system = hb.System("Brusselator", [x, y], [b, A], [x.dot - A + (b + 1) * x - x**2 * y, y.dot - b * x + x**2 * y])
    chart = hb.chart(system, "b", "A", (0.5, 1.5), span=(1.1, 4.0), harmonics=3)
    (hopf,) = chart.hopf
    np.testing.assert_allclose(hopf.values, 1 + hopf.over_values**2, rtol=1e-9)
    np.testing.assert_allclose(hopf.omega, hopf.over_values, rtol=1e-9)
    np.testing.assert_allclose(hopf.slope, 2 * hopf.over_values, rtol=1e-7)
    assert {*hopf.character} == {"supercritical"}


def test_a_mass_on_a_belt():
    """SOLVER: friction m (1 + exp(-v^2)) / 2 on a belt of speed V, damping ratio zeta.

    Hopf points at zeta = m V exp(-V^2) / 2, which is largest at V^2 = 1 / 2; the onset has the sign of the third
    derivative of the friction, which changes at V^2 = 3 / 2.
    """
    x, V = hb.Coordinate("x", "m"), hb.Parameter("V", 1.0, "m/s", bounds=(0.01, 5.0))
    m, zeta = hb.Parameter("m", 0.3), hb.Parameter("zeta", 0.02, bounds=(0.0, 1.0))
    friction = m * (1 + ca.exp(-((V - x.dot) ** 2))) / 2
    system = hb.System("belt", [x], [V, m, zeta], [x.ddot + 2 * zeta * x.dot + x - friction])
    chart = hb.chart(system, "V", "zeta", (0.005, 0.3), span=(0.01, 3.0), harmonics=5)
    (hopf,) = chart.hopf
    expected = 0.3 * hopf.values * np.exp(-(hopf.values**2)) / 2
    np.testing.assert_allclose(hopf.over_values, expected, rtol=1e-8)
    (turn,), (bautin,) = (
        [p for p in points_of(chart, kind) if p.curve == "hopf"] for kind in ("turning point", "Bautin point")
    )
    assert turn.value == pytest.approx(np.sqrt(0.5), rel=1e-6)
    assert turn.over_value == pytest.approx(0.15 * np.sqrt(0.5) * np.exp(-0.5), rel=1e-9)
    assert bautin.value == pytest.approx(np.sqrt(1.5), rel=1e-8)
    assert chart.without_hopf == (pytest.approx((turn.over_value, 0.3)),)
    fold = chart.folds[0]
    assert max(fold.extent) == pytest.approx(bautin.over_value, rel=1e-6)


class TestBogie:
    @pytest.mark.parametrize(("charted", "options"), [("bogie_chart", {}), ("balanced_chart", {"harmonics": 15})])
    def test_folds_against_an_independent_computation(self, bogie, charted, options, request):
        """SOLVER: by following the branch at that conicity, on both sides of where the rear wheelset grazes."""
        (fold,) = request.getfixturevalue(charted).folds
        for i in (len(fold) // 3, np.flatnonzero(fold.over_values > 0.09)[0]):
            lam = float(fold.over_values[i])
            span = (0.8 * fold.values[i], 1.2 * fold.values[i])
            found = hb.critical_speeds(bogie.with_parameters(lam=lam), "V", span, **options)
            (other,) = [c for c in found if c.kind == "fold"]
            assert fold.values[i] == pytest.approx(other.value, rel=1e-8)
            assert fold.slope[i] == pytest.approx(other.gradient["lam"], rel=1e-5)
            assert fold.omega[i] == pytest.approx(other.omega, rel=1e-5)
            assert fold.character[i] == other.extremum

    def test_hopf_points_against_an_independent_computation(self, bogie, limit):
        for i in (1, len(limit) // 2, -2):
            lam = float(limit.over_values[i])
            first = hb.hopf_points(bogie.with_parameters(lam=lam), "V", SPAN)[0]
            assert limit.values[i] == pytest.approx(first.value, rel=1e-8)
            assert limit.omega[i] == pytest.approx(first.omega, rel=1e-8)

    def test_slopes_are_the_gradients(self, bogie, bogie_chart, limit):
        gradients = {c.kind: c for c in hb.critical_speeds(bogie, "V", (60.0, 190.0))}
        for kind, curve in (("fold", bogie_chart.folds[0]), ("hopf", limit)):
            (i,) = np.flatnonzero(np.abs(curve.over_values - bogie.values["lam"]) < 1e-12)
            assert curve.values[i] == pytest.approx(gradients[kind].value, rel=1e-9)
            assert curve.slope[i] == pytest.approx(gradients[kind].gradient["lam"], rel=1e-7)

    def test_the_direction_of_the_onset(self, bogie, bogie_chart, limit):
        """Against the branch itself: which way the speed goes where the first wheelset begins to touch."""
        (change,) = [p for p in points_of(bogie_chart, "onset changes") if p.value < 100]
        for lam, character in ((0.98 * change.over_value, "subcritical"), (1.02 * change.over_value, "supercritical")):
            system = bogie.with_parameters(lam=lam)
            hopf = hb.hopf_points(system, "V", SPAN)[0]
            equations = hb.HarmonicBalance(15).equations(system)
            branch = hb.trace(equations, hopf, "V", SPAN, step=1e-3, longest=1e-3, max_points=12)
            assert np.sign(branch.values[-1] - hopf.value) == (1 if character == "supercritical" else -1)
            beyond = (limit.over_values - change.over_value) * (lam - change.over_value) > 1e-12
            assert {limit.character[i] for i in np.flatnonzero(beyond)} == {character}

    def test_the_size_of_the_onset(self, bogie, balance):
        """ORDER: eq-grazing-onset, with an error that falls like the root of the penetration."""
        hopf = hb.hopf_points(bogie, "V", (60.0, 190.0))[0]
        curve = HopfCurve(bogie, ("V", "lam"), SPAN, (0.02, 0.3), hopf)
        line = Linearisation(bogie, "V")
        growth = np.diff([line.pairs(hopf.value + d)[0][0] for d in (-1e-4, 1e-4)])[0] / 2e-4
        start = hb.trace(balance, hopf, "V", (60.0, 190.0), max_points=2).orbits[0]
        errors = []
        for depth in (1e-4, 3e-4):
            amplitude = {"q1": bogie.values["y0"] * (1 + depth)}
            cycle = hb.solve(balance, start, amplitude=amplitude, free="V")
            spring = 2 * 4 * np.sqrt(2) / (3 * np.pi) * depth**1.5  # of two ramps, in units of their stiffness
            expected = -spring * curve.state(curve.first()).onset / growth
            errors.append((cycle.parameters["V"] - hopf.value) / expected - 1)
        assert errors[0] < 0.02
        assert errors[1] / errors[0] == pytest.approx(np.sqrt(3), rel=0.05)

    def test_folds_end_where_the_onset_changes(self, bogie_chart):
        (change,) = [p for p in points_of(bogie_chart, "onset changes") if p.value < 100]
        (fold,) = bogie_chart.folds
        assert fold.extent == pytest.approx((0.02, change.over_value), rel=1e-9)
        assert bogie_chart.without_fold == (pytest.approx((change.over_value, 0.3)),)

    @pytest.mark.parametrize("options", [{}, {"harmonics": 7}])
    def test_cusps_against_the_number_of_folds(self, bogie, options):
        """Two folds more between the cusps: counted on traced branches."""
        chart = hb.chart(bogie, "V", "a", (0.385, 0.425), span=(80.0, 140.0), longest=0.3, **options)
        cusps = sorted(points_of(chart, "cusp"), key=lambda p: p.over_value)
        (first, second), (fold,) = cusps, chart.folds
        for a, count in ((first.over_value - 2e-3, 1), (second.over_value - 2e-3, 3)):
            found = hb.critical_speeds(bogie.with_parameters(a=a), "V", (80.0, 140.0), **options)
            assert sum(c.kind == "fold" for c in found) == count
            assert np.sum(np.diff(np.sign(fold.over_values - a)) != 0) == count

    @pytest.mark.parametrize("options", [{}, {"harmonics": 7}])
    def test_the_clearance_has_no_influence(self, bogie, options):
        """IDENTITY: the flange force is homogeneous in the displacement and the clearance."""
        chart = hb.chart(bogie, "V", "y0", (0.005, 0.015), span=(60.0, 190.0), **options)
        (fold,), (hopf,) = chart.folds, chart.hopf
        for curve in (fold, hopf):
            assert np.ptp(curve.values) < 1e-8 * curve.values[0]
            assert curve.extent == pytest.approx((0.005, 0.015), rel=1e-12)
        assert chart.special == () and chart.without_fold == ()


def test_what_could_not_be_found_is_reported():
    """Damping grows with V: the equilibrium is stable throughout."""
    x, V, k = hb.Coordinate("x"), hb.Parameter("V", 1.0, bounds=(0.1, 10.0)), hb.Parameter("k", 1.0, bounds=(0.1, 5.0))
    chart = hb.chart(hb.System("damped", [x], [V, k], [x.ddot + V * x.dot + k * x]), "V", "k", (0.5, 2.0))
    assert chart.curves == () and chart.without_fold == chart.without_hopf == ((0.5, 2.0),)
    assert len(chart.notes) == 2


def test_files_and_figures(bogie_chart, tmp_path):
    data = bogie_chart.to_dataset()
    (fold,) = bogie_chart.folds
    np.testing.assert_array_equal(data["V"].values[data["curve"].values == 0], fold.values)
    np.testing.assert_array_equal(data["lam"].values[data["curve"].values == 0], fold.over_values)
    bogie_chart.save(tmp_path / "chart.nc")
    assert (tmp_path / "chart.nc").stat().st_size > 0
    ax = plot.chart(bogie_chart)
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert {"fold of cycles", "Hopf, subcritical", "Hopf, supercritical", "onset changes"} <= set(texts)
    assert ax.get_xlim() == pytest.approx((0.02, 0.3)) and "[m/s]" in ax.get_ylabel()
    plot.save(plot.coexistence_width(bogie_chart), tmp_path / "width.png")
    empty = replace(bogie_chart, folds=(), hopf=(), special=())
    plot.save(plot.chart(empty), tmp_path / "empty.png")


def test_width_of_the_region_of_coexistence(bogie_chart):
    """Between the points of the curves a cubic with their slopes is good to a millimetre per second."""
    low, high = plot.coexistence(bogie_chart, np.array([0.05, 0.15]))[0]
    assert high[0] - low[0] == pytest.approx(90.97398 - 88.76411, abs=1e-3)
    assert np.isnan(low[1])


def test_command(tmp_path):
    arguments = ["chart", "bautin", "--over", "a", "0.1", "1", "--harmonics", "3", "-o", str(tmp_path), "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["data"]["without_fold"] == []
    assert (tmp_path / "chart.png").is_file() and (tmp_path / "chart.csv").is_file()
    result = CliRunner().invoke(app, ["chart", "bautin", "--over", "b", "0.1", "1", "-o", str(tmp_path)])
    assert result.exit_code == 2


def test_a_range_cut_to_the_bounds_is_reported():
    limited = hb.Parameter("a", 0.2, "", "", (0.0, 2.0))
    x, y, mu = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("mu", 0.0)
    rate = mu + limited * (x**2 + y**2) - (x**2 + y**2) ** 2
    system = hb.System("limited", [x, y], [mu, limited], [x.dot - x * rate + y, y.dot - y * rate - x])
    chart = hb.chart(system, "mu", "a", (-1.0, 0.3), span=(-0.5, 0.5), harmonics=1)
    assert chart.interval == (0.0, 0.3) and any("cut to its bounds: (0, 0.3)" in note for note in chart.notes)


def test_wrong_input(bogie):
    with pytest.raises(hb.ModelError, match="two different"):
        hb.chart(bogie, "V", "V")
    with pytest.raises(hb.ModelError, match="unknown parameter"):
        hb.chart(bogie, "V", "lambda")
    with pytest.raises(hb.ModelError, match="low < high"):
        hb.chart(bogie, "V", "lam", (0.3, 0.02))
    with pytest.raises(hb.ModelError, match="1 or more"):
        hb.chart(bogie, "V", "lam", harmonics=0)
    with pytest.raises(hb.ModelError, match="positive step"):
        hb.chart(bogie, "V", "lam", longest=0.0)
