"""An orbit answers the same questions in whichever form its motion is stored, before and after saving."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import fourier, plot
from hbbogie.collocation import Collocation, from_motion
from hbbogie.exact import Exact
from hbbogie.results import Branch, FourierSeries, LinearPhases, Orbit, PiecewisePolynomial


@pytest.fixture(scope="module")
def relaxation():
    """Van der Pol's cycle at mu = 1000."""
    system = hb.load_problem("van_der_pol").van_der_pol(mu=1000.0)
    return Collocation(tolerance=1e-11).equations(system).cycle(from_motion(system, [2.0, 0.0])).orbit()


@pytest.fixture(scope="module")
def hunting(bogie, cycles_at_90):
    return hb.solve(Exact().equations(bogie), cycles_at_90[-1], V=90.0)


def same(a, b) -> bool:
    """Whether two motions are equal to the last bit."""
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)]
    return type(a) is type(b) and all(np.array_equal(x, y) and np.shape(x) == np.shape(y) for x, y in pairs)


def test_relaxation_oscillation_after_saving_and_loading(relaxation, tmp_path):
    """PUBLISHED: the period; the peak 2 + 0.77937 mu^(-4/3) - (16/27) ln(mu) / mu^2 - 0.8762 / mu^2 + O(mu^(-8/3)).

    The series are those of A. A. Dorodnicyn (1947), as corrected by P. J. Ponzo and N. Wax, IEEE Trans. Circuit Theory
    12 (1965) 135-136. To 1e-9 the peak is that of polynomials of another degree.
    """
    relaxation.save(tmp_path / "cycle.nc")
    loaded = Orbit.load(tmp_path / "cycle.nc")
    assert same(loaded.motion, relaxation.motion) and loaded.omega == relaxation.omega
    assert loaded.period == pytest.approx(1614.401126, rel=1e-9)
    mu = 1000.0
    series = 2 + 0.77937 * mu ** (-4 / 3) - (16 / 27 * np.log(mu) + 0.8762) / mu**2
    assert loaded.amplitude("x") == pytest.approx(series, abs=3 * mu ** (-8 / 3))
    system = hb.load_problem("van_der_pol").van_der_pol(mu=mu)
    other = hb.solve(Collocation(degree=6, tolerance=1e-11).equations(system), loaded)
    assert loaded.amplitude("x") == pytest.approx(other.amplitude("x"), rel=1e-9)
    assert loaded.period == pytest.approx(other.period, rel=1e-9)
    assert loaded.mean("x") == pytest.approx(0.0, abs=1e-8) and 1.0 < loaded.rms("x") < 2.0
    assert loaded.coefficients.shape[0] <= 127


def test_exact_cycle_answers_and_comes_back(bogie, hunting, tmp_path):
    hunting.save(tmp_path / "cycle.nc")
    loaded = Orbit.load(tmp_path / "cycle.nc")
    assert same(loaded.motion, hunting.motion) and loaded.status == hunting.status
    t = np.linspace(0.0, hunting.period, 1001)
    q, v, a = (getattr(loaded, name)(t) for name in "qva")
    assert all(np.array_equal(x, getattr(hunting, name)(t)) for x, name in zip((q, v, a), "qva", strict=True))
    residual = bogie.residual(q.T, v.T, a.T, bogie.vector(**loaded.parameters)).full()
    assert np.abs(residual).max() < 1e-9 * np.abs(bogie.mass(**loaded.parameters) @ a.T).max()
    for i, name in enumerate(loaded.coordinates):
        assert np.abs(q[:, i]).max() <= loaded.amplitude(name) * (1 + 1e-12)
        assert loaded.rms(name) == pytest.approx(np.sqrt((q[:-1, i] ** 2).mean()), rel=1e-5)
        assert loaded.mean(name) == 0.0
    assert loaded.is_odd() and loaded.kept is None and loaded.tail == 0.0


def test_other_methods_take_an_exact_cycle(bogie, hunting):
    """IDENTITY of the multipliers; harmonic balance and shooting end on the same cycle."""
    multipliers = hb.floquet(bogie, hunting.replace(stability=None)).multipliers
    assert np.abs(multipliers[:4]) == pytest.approx(np.abs(hunting.stability.multipliers[:4]), abs=1e-8)
    truth = hb.verify(bogie, hunting)
    assert truth.orbit.omega == pytest.approx(hunting.omega, rel=1e-10)
    assert truth.waveform_error < 1e-8 and abs(truth.amplitude_errors["q1"]) < 1e-9 * hunting.amplitude("q1")
    balance = hb.solve(hb.HarmonicBalance(15).equations(bogie), hunting)
    assert balance.omega == pytest.approx(hunting.omega, rel=1e-5)
    again = hb.solve(Exact().equations(bogie), hunting)
    assert again.omega == pytest.approx(hunting.omega, rel=1e-12)


def test_another_frequency_runs_through_the_same_motion(hunting, relaxation):
    for orbit in (hunting, relaxation, relaxation.replace(coefficients=relaxation.coefficients)):
        fast, tau = orbit.replace(omega=2 * orbit.omega), np.linspace(0.0, 6.0, 50)
        assert np.array_equal(fast.q(tau / fast.omega), fast.at(fast.omega * (tau / fast.omega)))
        assert fast.q(tau / fast.omega) == pytest.approx(orbit.q(tau / orbit.omega), rel=1e-9, abs=1e-9)
        assert fast.v(0.0) == pytest.approx(2 * orbit.v(0.0), rel=1e-12)
        assert fast.a(0.0) == pytest.approx(4 * orbit.a(0.0), rel=1e-12)
        assert fast.period == orbit.period / 2 and fast.amplitude("x" if orbit is not hunting else "q1") > 0


def test_series_and_polynomial_agree():
    """Van der Pol's cycle at mu = 1, of both methods: the same answers."""
    system = hb.load_problem("van_der_pol").van_der_pol(mu=1.0)
    (series,) = hb.find_cycles(system, mu=1.0, harmonics=63)
    polynomial = hb.solve(Collocation(tolerance=1e-12).equations(system), series)
    assert isinstance(series.motion, FourierSeries) and isinstance(polynomial.motion, PiecewisePolynomial)
    assert polynomial.coefficients.shape[0] <= 127
    for name, tolerance in (("amplitude", 1e-8), ("rms", 1e-9), ("first_harmonic", 1e-9)):
        assert getattr(polynomial, name)("x") == pytest.approx(getattr(series, name)("x"), rel=tolerance)
    late = np.angle(series.coefficients[1, 0] - 1j * series.coefficients[2, 0])
    other = np.angle(polynomial.coefficients[1, 0] - 1j * polynomial.coefficients[2, 0])
    tau = np.linspace(0.0, 2 * np.pi, 100)
    for d, tolerance in ((0, 1e-7), (1, 1e-6), (2, 1e-3)):
        assert polynomial.at(tau - other, d) == pytest.approx(series.at(tau - late, d), abs=tolerance)
    assert series.rms("x") == pytest.approx(np.sqrt((series.q(series.period * np.arange(999) / 999) ** 2).mean()))


def test_branch_of_mixed_forms_comes_back(hunting, tmp_path):
    first = fourier.resize(hunting.coefficients, 9)
    second = np.ones(len(hunting.coordinates), dtype=bool)
    values = np.random.default_rng(1).normal(size=(4, 3, 2 * len(second)))
    polynomial = PiecewisePolynomial(second, np.linspace(0.0, 1.0, 5), values)
    motions = [FourierSeries(first), hunting.motion, polynomial, FourierSeries(first[:7])]
    orbits = [hunting.replace(motion=m) for m in motions]
    branch = Branch(tuple(orbits), "V")
    branch.save(tmp_path / "branch.nc")
    loaded = Branch.load(tmp_path / "branch.nc")
    assert all(same(a.motion, b) for a, b in zip(loaded, motions, strict=True))
    assert isinstance(loaded[1].motion, LinearPhases) and [o.kept for o in loaded] == [9, None, None, 3]
    assert loaded.to_dataframe()["highest harmonic"].isna().sum() == 2


def test_figures_draw_the_motion(relaxation):
    """The jumps take less than a thousandth of the period, and are drawn through points of theirs."""
    x = plot.orbit(relaxation).lines[0].get_xdata()
    assert np.abs(np.diff(x)).max() < 0.2
    t, x = plot.waveform(relaxation).lines[0].get_data()
    assert np.abs(np.diff(x)).max() < 0.2 and t[-1] == pytest.approx(relaxation.period)


@pytest.mark.parametrize("motion", [None, np.zeros(3), np.zeros((4, 1)), "wave", {"x": 1.0}])
def test_what_is_no_motion(motion):
    with pytest.raises(hb.ModelError, match=r"give Fourier coefficients, an array of shape \(2 H \+ 1, n\)"):
        Orbit("s", ("x",), ("m",), motion, 1.0, {})
