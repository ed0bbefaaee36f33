"""The command ``hbbogie conicity``."""

import csv
import json

import matplotlib
import numpy as np
import pytest
from typer.testing import CliRunner

from hbbogie.commandline import app
from hbbogie.railway import s1002_height

matplotlib.use("Agg")


def call(*args):
    return CliRunner().invoke(app, ["conicity", *map(str, args)])


def test_table_files_and_figures(tmp_path):
    result = call("s1002", "UIC60", "--output", tmp_path)
    assert result.exit_code == 0, result.output
    assert "S1002 on UIC60: equivalent conicity" in result.stdout and "0.1835" in result.stdout
    for name in ("conicity", "radius_difference", "contact_angle", "contact_point"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    with open(tmp_path / "conicity_curve.csv", encoding="utf-8") as file:
        curve = list(csv.DictReader(file))
    assert len(curve) == 61
    with open(tmp_path / "contact_geometry.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 161
    at_2 = next(row for row in rows if abs(float(row["shift [mm]"]) - 2) < 1e-6)
    assert float(at_2["radius difference [mm]"]) == pytest.approx(0.8044841, abs=1e-3)


def test_profile_from_a_file(tmp_path):
    """A file of S1002 gives the conicity of S1002, computed independently at 3 mm."""
    y = np.linspace(-69.5, 59.5, 1291)
    np.savetxt(tmp_path / "wheel.txt", np.column_stack([-y, -s1002_height(y)]), header="mirrored, heights upwards")
    result = call(tmp_path / "wheel.txt", "uic60", "--amplitudes", "3,6", "--largest", "7", "--json")
    assert result.exit_code == 0, result.output
    rows = json.loads(result.stdout)["tables"][0]["rows"]
    assert [row[1] for row in rows] == pytest.approx([0.1835417203, 0.3047022771], abs=2e-4)


def test_inclination_of_the_rails(tmp_path):
    """On rails inclined 1:20 a wheel S1002 has next to no conicity; a drawing is turned, UIC60 has its own turn."""
    rows = []
    for arguments in (("--inclination", 0.05), ("--inclination", 0.025), ()):
        result = call("s1002", "uic60", "--amplitudes", "3", *arguments, "--json")
        rows.append(json.loads(result.stdout)["tables"][0]["rows"][0][1])
    assert rows[0] < 0.012 and rows[1] == pytest.approx(rows[2], rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("s1003", "uic60"), "unknown profile 's1003'. Did you mean 's1002'?"),
        (("s1002", "none.txt"), "cannot read the profile 'none.txt': No such file"),
        (("s1002", "uic60", "--amplitudes", "9"), "amplitude 9 mm: the travel leaves the table of shifts"),
        (("s1002", "uic60", "--step", "0"), "step: got 0.0; give a finite number above 0 in mm"),
        (("s1002", "uic60", "--step", "9"), "step 9 mm is more than the largest shift"),
        (("s1002", "uic60", "--inclination", "20"), "rail inclination: got 20.0; give a slope of at most 0.2"),
        (("s1002", "uic60", "--gauge", "900"), "at a lateral shift of"),
    ],
)
def test_what_is_refused(arguments, words):
    result = call(*arguments, "--json")
    assert result.exit_code == 2
    assert words in json.loads(result.stdout)["error"]


def test_points_that_are_too_far_apart_are_told(tmp_path):
    for step, warned in ((5.0, True), (0.5, False)):
        y = np.arange(-65.0, 60.0, step)
        np.savetxt(tmp_path / "wheel.txt", np.column_stack([y, s1002_height(y)]))
        found = " ".join(call(tmp_path / "wheel.txt", "uic60").stdout.split())
        assert ("WARNING: the points of wheel are too far apart" in found) == warned
        assert "ithout every other point of wheel the conicity changes by up to" in found
