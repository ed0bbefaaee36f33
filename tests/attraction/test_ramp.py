"""Slowly changing parameters: the limits of no rate and of small rates, and the laws of delay."""

from __future__ import annotations

import json

import matplotlib
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import plot
from hbbogie.attraction import find_hysteresis, predicted_onset
from hbbogie.commandline import app
from hbbogie.motion import simulate_ramp, turning_points

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def bautin():
    return hb.load_problem("bautin")


@pytest.fixture(scope="module")
def runs(bautin):
    """Four rates, each half the one before."""
    return find_hysteresis(bautin.bautin(), "mu", (-0.35, 0.2), [2e-3, 1e-3, 5e-4, 2.5e-4])


@pytest.fixture(scope="module")
def bogie_runs(bogie, branch):
    return find_hysteresis(bogie, "V", (86.0, 103.0), [1.0, 0.5], branches=[branch])


def test_rate_zero_is_plain_simulation(bogie):
    start, duration = {"q1": 0.03}, 1.3
    plain = hb.simulate(bogie, start, duration, V=90.0)
    ramped = simulate_ramp(bogie, start, duration, parameter="V", rate=0.0, V=90.0)
    np.testing.assert_allclose(ramped.t, plain.t, rtol=1e-13)
    for a, b in ((ramped.q, plain.q), (ramped.v, plain.v)):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * np.abs(b).max())


def decay():
    """Return x' + mu x = 0, solved by exp(-mu t - rate t^2 / 2) while mu rises."""
    x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
    return hb.System("decay", [x], [mu], [x.dot + mu * x])


def test_the_parameter_is_linear_inside_the_steps():
    """The order of the method is kept: with a parameter constant over each step it would be 1."""
    exact, errors, steps = np.exp(-1.0 * 2 - 0.7 * 2**2 / 2), [], (0.2, 0.1, 0.05)
    for step in steps:
        motion = simulate_ramp(decay(), {"x": 1.0}, 2.0, parameter="mu", rate=0.7, step=step)
        errors.append(abs(motion.q[-1, 0] - exact))
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(4, abs=0.3)


def test_velocities_of_first_order_coordinates_follow_the_parameter():
    motion = simulate_ramp(decay(), {"x": 1.0}, 2.0, parameter="mu", rate=0.7, step=0.01)
    np.testing.assert_allclose(motion.v[:, 0], -(1.0 + 0.7 * motion.t) * motion.q[:, 0], rtol=1e-12)


def test_turning_points_of_a_decaying_oscillation():
    x = hb.Coordinate("x")
    system = hb.System("linear", [x], [], [x.ddot + 0.02 * x.dot + x])
    motion = hb.simulate(system, {"x": 1.0}, 40.0, step=0.02)
    times, peaks = turning_points(motion, "x")
    # the one after the start is half a period later, and the larger of two is the earlier
    omega = np.sqrt(1 - 0.01**2)
    np.testing.assert_allclose(times, np.pi / omega * (np.arange(len(times)) + 1.5), atol=1e-4)
    np.testing.assert_allclose(peaks, np.exp(-0.01 * np.pi / omega * (np.arange(len(times)) + 1)), rtol=1e-6)


def test_oscillation_dies_below_the_fold_and_starts_beyond_the_hopf_point(runs, bautin):
    fold, radius = bautin.fold()
    assert runs.fold == pytest.approx(fold, abs=1e-8) and runs.hopf == pytest.approx(0, abs=1e-8)
    assert runs.level == pytest.approx(radius / 2, rel=1e-4)
    for late in (runs.late_falling, runs.late_rising):
        assert (late > 0).all() and (np.diff(late) < 0).all()  # the slower, the nearer


def test_delay_at_a_smooth_fold_grows_with_the_two_thirds_power(runs):
    """x' = t + x^2 leaves to infinity after a time proportional to rate^(-1/3)."""
    exponents = runs.exponents(runs.late_falling)
    np.testing.assert_allclose(exponents, 2 / 3, atol=0.02)


def test_passages_are_those_of_the_radial_equation(runs):
    """r' = r (mu + a r^2 - r^4) with mu changing, by another integrator; peaks are known once per half period."""
    for passage, start, radius in (
        *((p, 0.2, None) for p in runs.falling),
        *((p, 0.0, 0.01 * runs.level) for p in runs.rising),
    ):
        first = radius or np.sqrt(0.5 + np.sqrt(0.25 + start))

        def rate_of(t, r, rate=passage.rate, start=start):
            return r * (start + rate * t + r**2 - r**4)

        def crossing(t, r):
            return r[0] - runs.level

        crossing.terminal = True
        exact = solve_ivp(rate_of, (0, 1 / abs(passage.rate)), [first], events=crossing, rtol=1e-9, atol=1e-12)
        (when,) = exact.t_events[0]
        assert passage.event == pytest.approx(start + passage.rate * when, abs=abs(passage.rate) * np.pi)


def _branches(bautin):
    system = bautin.bautin()
    return [
        hb.trace(
            hb.HarmonicBalance(3).equations(system), hb.hopf_points(system, "mu", (-0.3, 0.2))[0], "mu", (-0.3, 0.2)
        )
    ]


def test_onset_of_the_bogie_is_that_of_linear_growth(bogie_runs):
    """Up to contact the bogie is linear; its modes change with the speed, which linear growth leaves out."""
    for passage in bogie_runs.rising:
        assert passage.event == pytest.approx(passage.predicted, abs=0.05 * (passage.event - bogie_runs.hopf))
    assert bogie_runs.level == pytest.approx(0.0091)


def test_predicted_onset_remembers_the_start():
    """With sigma = mu the growth from -m comes to nothing at +m: the onset lies beyond it at every rate."""
    system = hb.load_problem("bautin").bautin(mu=-0.1)
    given = {"start": {"x": 1e-6}, "parameter": "mu", "interval": (-0.1, 0.5), "name": "x", "level": 1e-3}
    for rate in (1e-3, 1e-5):
        expected = np.sqrt(0.1**2 + 2 * rate * np.log(1e3))
        assert predicted_onset(system, rate=rate, **given) == pytest.approx(expected, abs=1e-5)


def test_rise_from_below_the_hopf_point_follows_the_prediction(bautin):
    system, start = bautin.bautin(), {"x": 1e-4}
    runs = find_hysteresis(system, "mu", (-0.05, 0.4), [1e-3], rise_from=-0.05, start=start, level=1e-2)
    (passage,) = runs.rising
    assert passage.event == pytest.approx(np.sqrt(0.05**2 + 2e-3 * np.log(100)), rel=0.02)
    assert passage.event == pytest.approx(passage.predicted, rel=0.02)


def test_hunting_of_the_bogie_dies_below_the_fold(bogie_runs):
    assert bogie_runs.fold == pytest.approx(88.764, abs=2e-3)
    assert (bogie_runs.late_falling > 0).all() and (np.diff(bogie_runs.late_falling) < 0).all()
    stays = bogie_runs.falling[0]
    on_branch = stays.peaks[(stays.values > 92) & (stays.values < 102)]
    assert (np.diff(on_branch) < 0).all() and (on_branch > 0.01).all()


def test_dying_out_and_starting_that_do_not_happen_are_nan(bautin):
    runs = find_hysteresis(bautin.bautin(), "mu", (-0.24, 0.01), [1e-2])
    assert np.isnan(runs.falling[0].event) and "not died out" in runs.falling[0].status
    assert np.isnan(runs.rising[0].event) and "not started" in runs.rising[0].status


def test_figures(runs, bautin):
    ax = plot.hysteresis(runs, _branches(bautin), parameter_label="mu [1/s]")
    assert ax.get_ylabel() == "peak of x" and ax.get_xlim() == runs.interval
    matplotlib.pyplot.close(plot.figure_of(ax))
    ax = plot.delays(runs)
    assert ax.get_xlabel() == "rate [1/s²]" and ax.get_ylabel() == "delay in mu [1/s]"
    matplotlib.pyplot.close(plot.figure_of(ax))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rates": [0.0]}, "rates: got"),
        ({"rates": []}, "rates: got"),
        ({"interval": (0.2, -0.3)}, "low < high"),
        ({"interval": (-2.0, -1.0)}, "no stable cycle"),
        ({"rise_from": 1.0}, "rise_from: got 1"),
        ({"level": -1.0}, "level"),
        ({"coordinate": "z"}, "unknown coordinate 'z'"),
        ({"start": {"z": 1.0}}, "unknown state 'z'"),
    ],
)
def test_wrong_input(bautin, change, message):
    given = {"parameter": "mu", "interval": (-0.3, 0.2), "rates": [1e-2], **change}
    with pytest.raises(hb.ModelError, match=message):
        find_hysteresis(bautin.bautin(), **given)


def test_a_ramp_beyond_the_bounds_is_refused(bogie):
    with pytest.raises(hb.ModelError, match="allowed is"):
        simulate_ramp(bogie, {"q1": 0.01}, 100.0, parameter="V", rate=-1.0, V=90.0)


# --- command line -----------------------------------------------------------------------------


def call(*args):
    return CliRunner().invoke(app, ["ramp", *map(str, args)])


def test_command(tmp_path):
    result = call("bautin", "--rates", "0.002,0.001", "--json", "--output", tmp_path)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["data"]["fold"] == pytest.approx(-0.25, abs=1e-6)
    assert len(found["tables"][0]["rows"]) == 2
    assert {file.name for file in tmp_path.iterdir()} == {"ramp.csv", "ramp_peaks.csv", "ramp.png", "ramp_delays.png"}


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("bautin", "--range", 0.2, -0.3), "low < high"),
        (("bautin", "--rates", "fast"), "write numbers separated by commas"),
        (("bautin", "--rates", "-1"), "rates: got"),
        (("bautin", "--start", "z=1"), "unknown state 'z'"),
        (("duffing",), "no stable cycle"),
    ],
)
def test_command_with_wrong_input(tmp_path, args, message):
    result = call(*args, "--output", tmp_path)
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")
