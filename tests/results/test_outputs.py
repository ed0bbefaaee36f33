"""Outputs along an orbit: numbers of signals known in closed form, balances of power, files."""

from __future__ import annotations

import copy
import pickle

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie import plot
from hbbogie.model import DeadBand
from hbbogie.results import LimitLine, Signal
from hbbogie.solving import minimise
from hbbogie.studies import JOBS, grid

A, K = 0.7, 9.0  # amplitude and stiffness: x = A cos(3 t)


def oscillator() -> hb.System:
    x, k = hb.Coordinate("x", "m"), hb.Parameter("k", K, "1/s2")
    outputs = [
        hb.Output("displacement", x, "m"),
        hb.Output("acceleration", x.ddot, "m/s2", "of the mass"),
        hb.Output("energy", (x.dot**2 + k * x**2) / 2, "m2/s2"),
        hb.Output("half wave", ca.fmax(x, 0), "m"),
        hb.Output("below zero", -ca.fabs(x), "m"),
        hb.Output("switch", ca.if_else(x > 0.1 * A, 1, 0), "1"),
        hb.Output("square", x**2, "m2"),
    ]
    return hb.System("oscillator", [x], [k], [x.ddot + k * x], outputs=outputs)


@pytest.fixture(scope="module")
def orbit() -> hb.Orbit:
    system = oscillator()
    c = np.array([[0.0], [A], [0.0]])
    return hb.Orbit("oscillator", ("x",), ("m",), c, np.sqrt(K), dict(system.values), naming=system.naming)


@pytest.fixture(scope="module")
def van_der_pol() -> tuple[hb.System, hb.Orbit]:
    return solved_van_der_pol(1.0, 41)


def solved_van_der_pol(mu: float, harmonics: int) -> tuple[hb.System, hb.Orbit]:
    system = hb.load_problem("van_der_pol").van_der_pol(mu=mu)
    c = np.array([[0.0], [2.0], [0.0]])
    guess = hb.Orbit(system.name, ("x",), ("1",), c, 1.0, dict(system.values))
    return system, hb.solve(hb.HarmonicBalance(harmonics).equations(system), guess)


# peak, mean, half peak to peak, rms, first harmonic
TRUTHS = {
    "displacement": (A, 0, A, A / np.sqrt(2), A),
    "acceleration": (K * A, 0, K * A, K * A / np.sqrt(2), K * A),
    "energy": (K * A**2 / 2, K * A**2 / 2, 0, K * A**2 / 2, 0),
    "half wave": (A, A / np.pi, A / 2, A / 2, A / 2),
    "below zero": (A, -2 * A / np.pi, A / 2, A / np.sqrt(2), 0),
    "switch": (1, np.arccos(0.1) / np.pi, 0.5, np.sqrt(np.arccos(0.1) / np.pi), 2 / np.pi * np.sqrt(0.99)),
    "square": (A**2, A**2 / 2, A**2 / 2, A**2 * np.sqrt(3 / 8), 0),
}


@pytest.mark.parametrize("name", TRUTHS)
def test_numbers_of_signals_in_closed_form(orbit, name):
    """SOLVER: the integrals are refined at kinks and jumps to 1e-9, the extremes to 1e-6 of the period."""
    s = orbit.output(name)
    found = (s.peak, s.mean, s.half_peak_to_peak, s.rms, s.first_harmonic)
    np.testing.assert_allclose(found, TRUTHS[name], atol=(1e-5 if name == "below zero" else 1e-8) * s.peak)
    named = (orbit.amplitude, orbit.mean, orbit.half_peak_to_peak, orbit.rms, orbit.first_harmonic)
    assert tuple(number(name) for number in named) == found


def test_a_coordinate_and_an_output_of_the_same_motion_agree(orbit):
    for number in (hb.Orbit.amplitude, hb.Orbit.mean, hb.Orbit.half_peak_to_peak, hb.Orbit.rms):
        assert number(orbit, "displacement") == pytest.approx(number(orbit, "x"), abs=1e-12)
    np.testing.assert_allclose(orbit.spectrum("displacement"), orbit.spectrum("x"), atol=1e-12)


def test_a_kink_is_a_peak(orbit):
    """The largest value, 0, is at a kink; the slope there is 3 A per second."""
    s = orbit.output("below zero")
    assert -1e-6 * 2 * np.pi * A < s.largest <= 0


def test_bands(orbit):
    """IDENTITY: x^2 has a mean of A^2 / 2 and a second harmonic of A^2 / 2."""
    f, s = orbit.frequency, orbit.output("square")
    assert s.rms_within(2 * f, 2 * f + 0.1) == pytest.approx(A**2 / np.sqrt(8), rel=1e-12)
    assert s.rms_within(0.0, 3 * f) == pytest.approx(s.rms, rel=1e-9)
    assert s.rms_about(width=0.9 * f) == pytest.approx(0, abs=1e-12)
    assert s.rms_about(2 * f, 0.1) == pytest.approx(A**2 / np.sqrt(8), rel=1e-12)


def test_waveforms_at_times(orbit):
    t = np.array([0.0, 0.1, 0.25, 10.0])
    np.testing.assert_allclose(orbit.output("acceleration").at(t), -K * A * np.cos(3 * t), atol=1e-12)


def test_equilibria_have_outputs(orbit):
    rest = orbit.replace(coefficients=np.array([[-0.2]]), omega=0.0)
    s = rest.output("acceleration")
    assert (s.peak, s.mean, s.rms, s.half_peak_to_peak, s.first_harmonic) == pytest.approx((0.2 * K,) * 3 + (0, 0))
    assert s.rms_about(0.0, 1.0) == pytest.approx(0.2 * K)


def test_accelerations_are_those_of_the_equations_of_motion():
    """In the gap no force acts, so that the acceleration is zero there, whatever the series of the motion says."""
    problem = hb.load_problem("gap_oscillator")
    system, peak = problem.gap_oscillator(), 2.0
    omega = 2 * np.pi / float(problem.period(peak))
    guess = hb.Orbit(
        system.name, ("x",), ("m",), np.array([[0.0], [peak], [0.0]]), omega, dict(system.values), naming=system.naming
    )
    cycle = hb.solve(hb.HarmonicBalance(15).equations(system), guess, free="d", amplitude={"x": peak})
    crossing = np.linspace(0.24, 0.26, 5) * cycle.period
    assert np.abs(cycle.q(crossing)).max() < 1
    np.testing.assert_array_equal(np.abs(cycle.output("spring force").at(crossing)), 0)
    # d was found to be zero to round-off
    np.testing.assert_allclose(cycle.output("acceleration").at(crossing), 0, atol=1e-12)
    assert cycle.output("acceleration").peak == pytest.approx(cycle.amplitude("x") - 1, rel=1e-9)


def test_the_energy_of_a_free_oscillator_is_constant():
    problem = hb.load_problem("duffing")
    system = problem.duffing()
    c = np.array([[0.0], [1.0], [0.0]])
    guess = hb.Orbit(system.name, ("x",), ("m",), c, 1.3, dict(system.values), naming=system.naming)
    cycle = hb.solve(hb.HarmonicBalance(25).equations(system), guess, free="d", amplitude={"x": 1.0})
    energy = cycle.output("energy")
    assert energy.half_peak_to_peak < 1e-9 * energy.peak
    assert energy.mean == pytest.approx(float(problem.energy(cycle.amplitude("x"))), rel=1e-9)


def test_van_der_pol_feeds_in_what_it_dissipates(van_der_pol):
    """SOLVER: the mean powers agree to the error of the waveform; about mu = 0, x = 2 cos t and both are 2 mu."""
    _, cycle = van_der_pol
    fed, lost = cycle.mean("power of the self-excitation"), cycle.mean("dissipated power")
    assert fed == pytest.approx(lost, rel=1e-9)
    _, small = solved_van_der_pol(0.01, 5)
    assert small.mean("dissipated power") == pytest.approx(0.02, rel=0.01**2)
    assert small.mean("energy") == pytest.approx(2.0, rel=0.01**2)


def test_the_forward_motion_of_the_bogie_does_the_work_that_dampers_and_creep_dissipate(bogie):
    """IDENTITY: harmonic balance holds when weighted with the velocities, so that the balance closes for any H."""
    guess = hb.find_cycles(bogie, V=100.0, stability=False)[-1]
    for H in (3, 15):
        cycle = hb.solve(hb.HarmonicBalance(H).equations(bogie), guess, V=100.0)
        work = cycle.mean("power of the forward motion")
        assert cycle.mean("damper power") + cycle.mean("creep power") == pytest.approx(work, rel=1e-11)
        assert work > 0


def test_a_cycle_in_closed_form_balances_to_the_accuracy_of_the_integrals(bogie):
    """SOLVER: ten times the 1e-9 of the means."""
    cycle = hb.find_cycles(bogie, V=100.0, stability=False)[-1]
    work = cycle.mean("power of the forward motion")
    assert cycle.mean("damper power") + cycle.mean("creep power") == pytest.approx(work, rel=1e-8)


# --- results and files --------------------------------------------------------------------------


def same(a: Signal, b: Signal) -> bool:
    numbers = ("smallest", "largest", "mean_square", "omega", "unit", "description")
    arrays = np.array_equal(a.samples, b.samples) and np.allclose(a.coefficients, b.coefficients, rtol=0, atol=0)
    return arrays and all(getattr(a, n) == getattr(b, n) for n in numbers)


def test_a_file_holds_the_outputs(orbit, tmp_path):
    orbit.save(tmp_path / "orbit.nc")
    loaded = hb.Orbit.load(tmp_path / "orbit.nc")
    assert loaded.naming.outputs == orbit.naming.outputs
    assert all(same(orbit.output(name), loaded.output(name)) for name in TRUTHS)
    # from a file, straight lines between 256 samples: (h^2 / 8) of the second derivative at most
    t = np.linspace(0, orbit.period, 400)
    off = np.abs(loaded.output("displacement").at(t) - orbit.output("displacement").at(t)).max()
    assert off <= (2 * np.pi / 256) ** 2 / 8 * A
    loaded.save(tmp_path / "again.nc")
    assert same(hb.Orbit.load(tmp_path / "again.nc").output("energy"), orbit.output("energy"))
    assert "outputs" not in hb.Orbit("o", ("x",), ("",), np.zeros((1, 1)), 0.0, {}).to_dataset()


def test_a_changed_orbit_does_not_keep_what_was_recorded(orbit, tmp_path):
    orbit.save(tmp_path / "orbit.nc")
    loaded = hb.Orbit.load(tmp_path / "orbit.nc")
    assert loaded.replace(status="seen").output("energy").mean == orbit.output("energy").mean
    with pytest.raises(hb.ModelError, match="is not known any more"):
        loaded.replace(coefficients=2 * loaded.coefficients).output("displacement")


def test_copies_and_pickles_measure(orbit):
    for other in (pickle.loads(pickle.dumps(orbit)), copy.deepcopy(orbit)):
        assert same(other.output("half wave"), orbit.output("half wave"))
        np.testing.assert_array_equal(other.output("half wave").at(0.1), orbit.output("half wave").at(0.1))


def test_a_branch_draws_outputs_from_its_file(tmp_path):
    system, cycle = solved_van_der_pol(0.5, 9)
    branch = hb.trace(hb.HarmonicBalance(9).equations(system), cycle, "mu", (0.4, 0.6), stability=False)
    branch.save(tmp_path / "branch.nc")
    loaded = hb.Branch.load(tmp_path / "branch.nc")
    np.testing.assert_array_equal(loaded.amplitude("energy"), branch.amplitude("energy"))
    for quantity in ("peak", "first harmonic", "half peak to peak", "mean", "rms"):
        ax = plot.branch(loaded, y="energy", quantity=quantity, limits=[LimitLine(2.5, "limit", "1")])
        assert "energy" in ax.get_ylabel() and "limit" in ax.get_legend_handles_labels()[1]
        plot.figure_of(ax).clear()
    assert plot.waveform(loaded[0], ["energy", "dissipated power"]).get_xlabel() == "time t [s]"
    assert "energy" in plot.spectrum(loaded[0], "energy").get_ylabel()
    assert "energy" in plot.orbit(loaded[0], "x", "energy").get_ylabel()
    table = loaded.to_dataframe()
    assert table.attrs["units"]["rms dissipated power"] == "1/s"


def test_a_hopf_point_has_the_outputs_of_the_equilibrium(tmp_path):
    """The orbit kept there is the mode, a metre high; the flange force at rest is zero."""
    system = hb.load_problem("yang1995").bogie()
    point = hb.hopf_points(system, "V", (80.0, 100.0))[0]
    near = hb.Branch((point.orbit.replace(coefficients=1e-3 * point.orbit.coefficients),), "V", (point,))
    near.save(tmp_path / "branch.nc")
    kept = hb.Branch.load(tmp_path / "branch.nc").special[0].orbit
    assert kept.output("front flange force").peak == 0 and point.orbit.output("front flange force").peak > 1e6


# --- limits and objectives ------------------------------------------------------------------------


def test_limits_on_outputs_are_met_exactly(van_der_pol):
    """SOLVER: the largest mu with an rms of the energy of at most 2.4 has just that."""
    system, cycle = van_der_pol
    equations = hb.HarmonicBalance(21).equations(system)
    found = minimise(
        equations,
        cycle,
        ["mu"],
        lambda c: -c.parameter("mu"),
        [(lambda c: c.root_mean_square("energy"), None, 2.4), (lambda c: c.values("dissipated power"), None, 1e3)],
    )
    assert found.orbit.rms("energy") == pytest.approx(2.4, rel=1e-6)
    mean = hb.solve(equations, cycle, free=["mu"], minimise=lambda c: (c.mean("energy") - 2.05) ** 2)
    assert mean.orbit.mean("energy") == pytest.approx(2.05, rel=1e-4)


# --- wrong input ----------------------------------------------------------------------------------


def with_outputs(*outputs: object) -> hb.System:
    x, k = hb.Coordinate("x"), hb.Parameter("k", 1.0)
    stop = hb.Element("stop", DeadBand(k, 1.0), x)
    return hb.System("s", [x], [k], [x.ddot + k * x + stop], [stop], outputs=outputs)  # type: ignore[arg-type]


Y = hb.Coordinate("y")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: hb.Output("", 1.0), "name of an output: got ''"),
        (lambda: hb.Output(3, 1.0), "name of an output: got 3"),
        (lambda: hb.Output("a\nb", 1.0), "name of an output"),
        (lambda: hb.Output("f", "x"), "Leave out the quotes"),
        (lambda: hb.Output("f", lambda: 1), "Call the function"),
        (lambda: hb.Output("f", ca.SX.sym("x", 2)), "shape"),
        (lambda: hb.Output("f", Y * float("nan")), "NaN"),
        (lambda: hb.Output("f", Y, 3), "unit"),
        (lambda: hb.Output("f", Y, "N", None), "description"),
        (lambda: with_outputs(hb.Output("f", Y)), "output 'f' contains y"),
        (lambda: with_outputs(Y), "outputs: got"),
        (lambda: with_outputs(hb.Output("f", 1.0), hb.Output("f", 2.0)), "each name may be used once"),
        (lambda: with_outputs(hb.Output("stop", 1.0)), "each name may be used once.*stop"),
        (lambda: hb.System("s", [Y], [], [Y.dot + Y], outputs=hb.Output("f", Y)), "outputs: got"),
        (lambda: LimitLine(float("nan"), "limit"), "finite number"),
        (lambda: LimitLine("3", "limit"), "finite number"),
        (lambda: LimitLine(3.0, ""), "label"),
    ],
)
def test_what_is_no_output_is_refused(wrong, said):
    with pytest.raises(hb.ModelError, match=said):
        wrong()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda o: o.output("energie"), "Did you mean 'energy'"),
        (lambda o: o.output(None), "give a name"),
        (lambda o: o.amplitude("energie"), "energie"),
        (lambda o: o.output("energy").rms_within(3.0, 2.0), "low < high"),
        (lambda o: o.output("energy").rms_within(-1.0, 2.0), "from 0 Hz"),
        (lambda o: o.output("energy").rms_within(0.0, 1e4), "harmonic 33"),
        (lambda o: o.output("energy").number("median"), "quantity"),
        (lambda o: plot.orbit(o, "energy"), "give y="),
        (lambda o: plot.waveform(o, "energie"), "energie"),
        (
            lambda o: plot.branch(hb.Branch((o,), "k"), y="energy", limits=[LimitLine(1.0, "l", "N")]),
            "the limit 'l' is",
        ),
        (lambda o: plot.branch(hb.Branch((o,), "k"), y="energy", limits=[3.0]), "limits"),
        (lambda o: plot.branch(hb.Branch((o,), "k"), y="energy", quantity="median"), "quantity"),
    ],
)
def test_names_and_bands_that_are_not_there(orbit, wrong, said):
    with pytest.raises(hb.ModelError, match=said):
        wrong(orbit)


def test_limits_on_names_that_are_not_there(van_der_pol):
    system, cycle = van_der_pol
    equations = hb.HarmonicBalance(3).equations(system)
    for quantity in ("values", "root_mean_square", "mean", "first_harmonic"):
        with pytest.raises(hb.ModelError, match="coordinate or output 'energie'"):
            hb.solve(equations, cycle, free=["mu"], minimise=lambda c, q=quantity: getattr(c, q)("energie"))


def test_studies_return_outputs_with_their_units():
    """The peak of a mass on a spring is what its amplitude says; a slash is spelled out, for files cannot hold it."""
    x, mu = hb.Coordinate("x", "m"), hb.Parameter("mu", 0.1)
    outputs = [hb.Output("omega ratio", 0.5, "1"), hb.Output("Y/Q", 3 * x, "N")]
    system = hb.System("van", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x], outputs=outputs)
    found = JOBS["cycles"](system, "mu", (-0.05, 0.15), 3)
    for name in ("peak_{}_1", "rms_{}_1"):
        assert {name.format("omega ratio"), name.format("Y over Q")} <= set(found)
    assert found["peak_Y over Q_1"] == pytest.approx(3 * found["peak_x_1"], rel=1e-6)
    assert found["rms_omega ratio_1"] == pytest.approx(0.5, rel=1e-9)
    options = {"parameter": "mu", "harmonics": 3}
    data = hb.sweep("cycles", grid({"mu": [0.5]}), problem="van_der_pol", options=options, workers=0)
    assert data["rms_dissipated power_1"].attrs["units"] == "1/s"
    assert data["omega_1"].attrs["units"] == "rad/s"
