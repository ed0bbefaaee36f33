"""Basins of attraction: boundaries that are known, and motions that are proved to die out."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import plot
from hbbogie.attraction import distances, find_basin, place_of
from hbbogie.attraction.basin import _ends, _Job
from hbbogie.attraction.endings import _at_rest
from hbbogie.commandline import app
from hbbogie.parallel import starting
from hbbogie.progress import silent

matplotlib.use("Agg")
FOLD, HOPF = 88.764, 90.974  # m/s


@pytest.fixture(scope="module")
def bautin():
    return hb.load_problem("bautin")


@pytest.fixture(scope="module")
def sharp(bogie, branch):
    """Motions beside the unstable cycle, below the fold, between fold and Hopf point, and above."""
    values = [87.0, 88.7, 88.8, 89.0, 89.5, 90.0, 90.5, 90.9, 91.0, 93.0]
    return find_basin(bogie, "V", values, [0.0, 0.5, 0.98, 1.02, 1.5], branches=[branch])


def test_unstable_cycle_is_the_boundary(sharp):
    between = (sharp.values > FOLD) & (sharp.values < HOPF)
    assert between.sum() == 6
    assert (sharp.outcome[between][:, :3] == "rest").all()
    assert (sharp.outcome[between][:, 3:] == "cycle").all()
    np.testing.assert_allclose(sharp.amplitudes[between], np.outer(sharp.unstable[between], sharp.factors))


def test_nothing_hunts_below_the_fold(sharp):
    assert (sharp.outcome[sharp.values < FOLD] == "rest").all()


def test_only_the_equilibrium_rests_above_the_hopf_speed(sharp):
    above = sharp.outcome[sharp.values > HOPF]
    assert (above[:, 0] == "rest").all() and (above[:, 1:] != "rest").all()
    assert (above[1, 1:] == "cycle").all()


def test_motions_end_on_the_stable_cycle(sharp):
    on_cycle = sharp.outcome == "cycle"
    expected = np.repeat(sharp.stable[:, None], len(sharp.factors), axis=1)
    assert (sharp.reached[on_cycle] == expected[on_cycle]).all()
    assert (sharp.reached[sharp.outcome == "rest"] == 0).all()
    assert np.isnan(sharp.reached[sharp.outcome == "undecided"]).all()


def test_released_displacements_of_the_paper(bogie, branch):
    """Figures 5 and 6 of the paper, and a third: both wheelsets released at 90 m/s."""
    scan = find_basin(bogie, "V", [90.0], [0.0093, 0.012, 0.03], along={"q1": 1, "q3": 1}, branches=[branch])
    assert scan.outcome.tolist() == [["rest", "rest", "cycle"]]
    np.testing.assert_allclose(scan.amplitudes, [[0.0093, 0.012, 0.03]])
    assert (scan.time < 30).all()


def test_agrees_with_motions_that_are_followed_until_they_settle(bogie, branch):
    """`settle` decides by crossings and needs no cycle to be known."""
    sizes = [0.015, 0.025, 0.04]
    scan = find_basin(bogie, "V", [89.5], sizes, along={"q1": 1}, branches=[branch])
    kinds = [hb.motion.settle(bogie, {"q1": q}, V=89.5).kind for q in sizes]
    assert scan.outcome[0].tolist() == kinds


def test_bautin_basin_is_a_disc(bautin):
    values = np.array([-0.3, -0.2, -0.1, -0.03])
    radius = np.array([bautin.radii(mu)[0] if mu > -0.25 else np.nan for mu in values])
    factors = np.array([0.2, 0.999, 1.001, 3.0])
    scan = find_basin(bautin.bautin(), "mu", values, factors, duration=2000.0)
    np.testing.assert_allclose(scan.unstable, radius, rtol=1e-6)
    assert (scan.outcome[0] == "rest").all()
    assert (scan.outcome[1:] == ["rest", "rest", "cycle", "cycle"]).all()
    # in another direction the radius is the same
    scan = find_basin(bautin.bautin(), "mu", [-0.2], radius[1] * factors, along={"x": 0.6, "y": -0.8}, duration=2000.0)
    assert scan.outcome.tolist() == [["rest", "rest", "cycle", "cycle"]]


def test_time_that_is_too_short_leaves_it_undecided(bautin):
    scan = find_basin(bautin.bautin(), "mu", [-0.2], [0.999], duration=10.0)
    assert scan.outcome[0, 0] == "undecided" and "time was over" in scan.reason[0, 0] and scan.time[0, 0] >= 10


def test_motion_without_bound_is_undecided():
    """Outside the unstable cycle of van der Pol's oscillator with mu < 0."""
    scan = find_basin(hb.load_problem("van_der_pol").van_der_pol(), "mu", [-0.5], [3.0], along={"x": 1})
    assert scan.outcome[0, 0] == "undecided" and "grew without bound" in scan.reason[0, 0]


def test_the_bound_holds_on_simulated_motions(bogie):
    """Where rest is proved, no wheelset touches the flange ever after."""
    system = bogie.with_parameters(V=90.0)
    place = place_of(system, "V", [], [])
    rng = np.random.default_rng(5)
    x = rng.standard_normal((200, 14)) * np.r_[np.full(7, 1e-3), np.full(7, 0.03)]
    proved = _at_rest(place, x)
    assert 5 < proved.sum() < 195
    names = [*system.coordinate_names, *(f"{c}'" for c in system.coordinate_names)]
    for state in x[proved][:5]:
        motion = hb.simulate(system, dict(zip(names, state, strict=True)), 4.0)
        assert max(motion.amplitude("q1"), motion.amplitude("q3")) < 0.0091


def test_distance_from_a_circle():
    t = np.linspace(0, 2 * np.pi, 257)
    circle = np.column_stack([np.cos(t), np.sin(t)])
    angle, radius = np.array([0.1, 1.0, 4.0]), np.array([0.5, 1.0, 3.0])
    x = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    away = distances(x, circle, np.ones(2))
    # the polygon lies inside the circle by at most 1 - cos(pi / 256)
    np.testing.assert_allclose(away, np.abs(radius - 1) / np.sqrt(2), atol=1e-4)


def test_processes_give_the_same(bautin):
    system, grid = bautin.bautin(), ("mu", [-0.2, 0.1], [0.5, 0.98, 1.02])
    told = []
    alone, together = (
        find_basin(system, *grid, workers=workers, progress=lambda message, share: told.append(share))
        for workers in (1, 2)
    )
    assert (alone.outcome == together.outcome).all() and (alone.time == together.time).all()
    assert told[-1] == 1.0
    assert not multiprocessing.active_children()


class Dying(_Job):
    """A job whose process ends."""

    def run(self, i, x, stopped=None):
        os._exit(1)


def test_a_process_that_ends_leaves_motions_undecided(bautin):
    system = bautin.bautin()
    place = place_of(system, "mu", [], [])
    ends = _ends(Dying(system, [place], [1.0], 256), np.ones((1, 2)), np.array([0.1, 0.2]), 2, silent)
    assert ends.outcome.tolist() == [["undecided", "undecided"]]
    assert ends.reason[0, 0] == "the process that followed it ended"


class Hanging(_Job):
    """A job that looks at nothing; Ctrl-C is pressed twice meanwhile."""

    def run(self, i, x, stopped=None):
        for _ in range(2):
            os.kill(os.getppid(), signal.SIGINT)
            time.sleep(1.0)  # else the two may be one
        time.sleep(1000)


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C cannot be sent to one process")
def test_second_interruption_ends_what_hangs(bautin):
    system = bautin.bautin()
    place = place_of(system, "mu", [], [])
    with pytest.raises(KeyboardInterrupt):
        _ends(Hanging(system, [place], [1.0], 256), np.ones((1, 2)), np.array([0.1, 0.2]), 2, silent)
    assert not multiprocessing.active_children()


def test_saved_and_loaded(sharp, tmp_path):
    sharp.save(tmp_path / "basin.nc")
    again = hb.results.Basin.load(tmp_path / "basin.nc")
    for name, value in vars(sharp).items():
        np.testing.assert_array_equal(getattr(again, name), value, err_msg=name)
    data = sharp.to_dataset()
    assert data["V"].attrs["units"] == "m/s" and data["amplitude"].attrs["units"] == "m"
    assert data["outcome"].sel(V=90.0, factor=1.02) == "cycle"


def test_figure(sharp, branch):
    ax = plot.basin(sharp, [branch], parameter_label="speed V [m/s]")
    assert ax.get_xlabel() == "speed V [m/s]" and ax.get_ylabel() == "initial amplitude of q1 [mm]"
    entries = {text.get_text() for text in ax.get_legend().get_texts()}
    assert {"comes to rest", "settles on a cycle"} <= entries
    matplotlib.pyplot.close(plot.figure_of(ax))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"along": {"q9": 1}}, r"unknown state 'q9'"),
        ({"along": {}}, "at least one coordinate that is displaced"),
        ({"along": {"q1'": 1.0}}, "at least one coordinate that is displaced"),
        ({"workers": 0}, "workers: got 0"),
        ({"duration": -1.0}, "duration"),
        ({"values": [91.0, 90.0]}, "increasing order"),
        ({"factors": [np.nan]}, "factors"),
        ({"parameter": "v"}, "Did you mean 'V'"),
        ({"values": [60.0]}, "no unstable cycle was found"),
    ],
)
def test_wrong_input(bogie, branch, change, message):
    given = {"parameter": "V", "values": [90.0], "factors": [1.0], **change}
    with pytest.raises(hb.ModelError, match=message):
        find_basin(bogie, **given, branches=[branch])


# --- command line -----------------------------------------------------------------------------


def call(*args):
    return CliRunner().invoke(app, ["basin", *map(str, args)])


def test_command(tmp_path):
    result = call("bautin", "--points", 3, "--amplitudes", 4, "--workers", 1, "--output", tmp_path)
    assert result.exit_code == 0, result.output
    names = {file.name for file in tmp_path.iterdir()}
    assert names == {"basin.csv", "basin_motions.csv", "basin.nc", "basin.png"}
    assert "12 motions; " in result.stdout.replace("\n", " ")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("yang1995", "--along", "q9=1"), "unknown state 'q9'"),
        (("yang1995", "--along", "q1"), "write NAME=VALUE"),
        (("yang1995", "--range", 92, 88), "low < high"),
        (("yang1995", "--workers", 0), "workers: got 0"),
        (("yang1995", "--points", 0), "number of parameter values: got 0"),
        (("duffing",), "no unstable cycle was found"),
    ],
)
def test_command_with_wrong_input(tmp_path, args, message):
    result = call(*args, "--output", tmp_path)
    assert result.exit_code == 2
    assert message in result.output.replace("\n", " ")


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C cannot be sent to one process")
def test_starting_processes_ignore_ctrl_c():
    """And it is not lost: the exception comes afterwards."""
    code = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    begun = False
    with pytest.raises(KeyboardInterrupt), starting():
        os.kill(os.getpid(), signal.SIGINT)
        begun = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    assert begun == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C cannot be sent to one process")
@pytest.mark.parametrize("seconds", [0.0, 2.0])
def test_interruption_leaves_no_process(tmp_path, seconds):
    """Ctrl-C at a terminal while two processes start, or follow motions: one sentence, code 130, nothing goes on."""
    environment = os.environ | {"PYTHONPATH": str(Path(hb.__file__).parent.parent)}
    # about d = 0 nothing grows or decays in the time: no motion is ever decided
    args = ["basin", "duffing", "--range", "-1e-9", "1e-9", "--along", "x=1", "--largest", "1", "--duration", "1e6"]
    command = [sys.executable, "-m", "hbbogie", *args, "--workers", "2", "--output", str(tmp_path)]
    run = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True)
    for line in run.stderr:
        if "following motions" in line:
            break
    time.sleep(seconds)
    os.killpg(run.pid, signal.SIGINT)
    _, error = run.communicate(timeout=60)  # until the last process that holds the stream has ended
    assert run.returncode == 130 and "interrupted" in error and "Traceback" not in error
    assert not list(tmp_path.iterdir())
