"""Moving pictures."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import animation
from PIL import Image
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie import plot
from hbbogie.commandline import app


@pytest.fixture(scope="module")
def cycle():
    (found,) = hb.find_cycles(hb.load_problem("van_der_pol").van_der_pol(), mu=1.0)
    return found


def pictures(path):
    with Image.open(path) as film:
        for frame in range(film.n_frames):
            film.seek(frame)
            yield np.asarray(film.convert("L"), dtype=float)


def test_a_cycle_goes_on_for_ever(cycle, tmp_path):
    """All pictures differ, and the step from the last to the first is one like the others."""
    path = plot.animate(cycle, tmp_path / "cycle.gif", frames=8)
    films = list(pictures(path))
    assert len(films) == 8
    steps = [np.abs(a - b).mean() for a, b in zip(films, [*films[1:], films[0]], strict=True)]
    assert min(steps) > 0 and max(steps) < 10 * min(steps)


def test_the_bogie_lights_its_flanges(bogie_module, tmp_path):
    """A flange that is beyond its clearance is lit, on its own side."""
    system = bogie_module.bogie()
    q = dict.fromkeys(system.coordinate_names, 0.0)
    lit = [s.lit for s in bogie_module.sketch(q | {"q1": 0.01, "q3": -0.01}, system.values) if s.kind == "contact"]
    assert lit == [True, False, False, True]
    assert not any(s.lit for s in bogie_module.sketch(q | {"q1": 0.009}, system.values))


@pytest.fixture(scope="module")
def bogie_module():
    return hb.load_problem("yang1995")


def test_a_motion_that_comes_to_rest(tmp_path):
    system = hb.load_problem("van_der_pol").van_der_pol(mu=-0.5)
    motion = hb.simulate(system, {"x": 0.5}, 20.0)
    assert sum(1 for _ in pictures(plot.animate(motion, tmp_path / "rest.gif", frames=5))) == 5


@pytest.mark.parametrize(
    ("name", "frames", "message"),
    [
        ("a.avi", 5, r"ends in \.gif or \.mp4"),
        ("nowhere/a.gif", 5, "does not exist"),
        ("a.gif", 1, "2 or more"),
        ("a.gif", "many", "2 or more"),
    ],
)
def test_errors(cycle, tmp_path, name, frames, message):
    with pytest.raises(hb.ModelError, match=message):
        plot.animate(cycle, tmp_path / name, frames=frames)


@pytest.mark.skipif(animation.writers.is_available("ffmpeg"), reason="ffmpeg is installed")
def test_no_ffmpeg(cycle, tmp_path):
    with pytest.raises(hb.ModelError, match="ffmpeg"):
        plot.animate(cycle, tmp_path / "a.mp4")


def test_what_does_not_move(cycle, tmp_path):
    rest = cycle.replace(coefficients=np.zeros((1, 1)), omega=0.0)
    with pytest.raises(hb.ModelError, match="does not move"):
        plot.animate(rest, tmp_path / "a.gif")
    with pytest.raises(hb.ModelError, match="animate: motion"):
        plot.animate("cycle", tmp_path / "a.gif")


def test_command(tmp_path):
    target, call = tmp_path / "vdp.gif", CliRunner().invoke
    found = call(app, ["animate", "van_der_pol", "--output", str(target), "--frames", "3"])
    assert found.exit_code == 0 and "one period of the cycle of" in found.output and target.stat().st_size > 1000
    refused = call(app, ["animate", "van_der_pol", "--output", str(target), "--cycle", "2"])
    assert refused.exit_code == 2 and "give another number" in refused.output
