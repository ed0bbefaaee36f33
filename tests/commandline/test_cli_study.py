"""The commands of studies, and the study files."""

from __future__ import annotations

import json
import re
import shlex
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from small_studies import STUDY, finished, process, wait_for, write_study
from typer.testing import CliRunner

from hbbogie.commandline import app
from hbbogie.studies import load_study, shipped_studies

runner = CliRunner()


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def call(*args):
    return runner.invoke(app, ["study", *map(str, args)])


def about(document):
    """Return what the report says about the study, by its names."""
    return dict(next(table["rows"] for table in document["tables"] if table["name"] == "about"))


def test_run_status_export_report(tmp_path):
    path = write_study(tmp_path)
    result = call("run", path, "--workers", 0)
    assert result.exit_code == 0, result.output
    assert "40 of 40 points" in result.stderr and "40 of 40 finished" in result.stdout
    state = json.loads(call("status", path, "--json").stdout)["data"]
    assert state == {"total": 40, "done": 40, "failed": 0, "damaged": []}
    for suffix in ("nc", "csv", "parquet"):
        result = call("export", "products.db", "--output", f"out.{suffix}")
        assert result.exit_code == 0, result.output
    with xr.open_dataset("out.nc") as data:
        expected = data["k"].values * data["c"].values
        np.testing.assert_array_equal(data["product"].values, expected)
        assert data["product"].attrs["units"] == "N2 s/m2" and data.attrs["job"].endswith("jobs.py:product")
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert lines[0].startswith("point,k [N/m],c [N s/m],product [N2 s/m2],third,name,status")
    assert len(lines) == 41 and float(lines[-1].split(",")[3]) == expected[-1]
    import pyarrow.parquet

    table = pyarrow.parquet.read_table("out.parquet")
    np.testing.assert_array_equal(table["product"].to_numpy(), expected)
    assert table.schema.field("k").metadata == {b"unit": b"N/m"}
    result = call("report", path, "--output", "report.html")
    assert result.exit_code == 0 and "<title>Products</title>" in (tmp_path / "report.html").read_text("utf-8")


def test_run_again_needs_resume(tmp_path):
    path = write_study(tmp_path)
    assert call("run", path, "--workers", 0, "--points", 6).exit_code == 0
    assert (tmp_path / "products-6.db").is_file()
    result = call("run", path, "--workers", 0, "--points", 6)
    assert result.exit_code == 2 and "--resume" in result.stderr
    assert call("run", path, "--workers", 0, "--points", 6, "--resume").exit_code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_interruption_says_how_to_resume(tmp_path):
    path = write_study(tmp_path, wait=0.05)
    run = process("hbbogie", "study", "run", path, "--workers", 2, cwd=tmp_path)
    wait_for(lambda: finished(tmp_path / "products.db") >= 4, "four points")
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 130 and out == "" and "Traceback" not in err
    assert "stopped." in err and f"hbbogie study run {path} --workers 2 --resume" in err
    done = finished(tmp_path / "products.db")
    assert 4 <= done < 40 and f"{done} of 40 points" in err
    result = call("run", path, "--workers", 0, "--resume")
    assert result.exit_code == 0 and finished(tmp_path / "products.db") == 40


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_second_interruption_abandons_points_that_hang(tmp_path):
    path = write_study(tmp_path)
    path.write_text(STUDY.format(wait=0.0).replace(":product", ":hanging").replace("wait = 0.0", ""))
    run = process("hbbogie", "study", "run", path, "--workers", 2, cwd=tmp_path)
    wait_for(lambda: finished(tmp_path / "products.db") >= 10, "ten points")
    run.send_signal(signal.SIGINT)
    assert any("again to drop them" in line for line in iter(run.stderr.readline, ""))
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=30)
    assert run.returncode == 130 and "Traceback" not in err and f"hbbogie study run {path} --workers 2 --resume" in err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
def test_advice_on_resuming_repeats_the_given_options(tmp_path):
    path = write_study(tmp_path, wait=0.05)
    given = ["--store", "my store.db", "--workers", "0", "--limit", "5.0", "--output", "my report"]
    run = process("hbbogie", "study", "run", path, *given, cwd=tmp_path)
    wait_for(lambda: finished(tmp_path / "my store.db") >= 4, "four points")
    run.send_signal(signal.SIGINT)
    _, err = run.communicate(timeout=60)
    again = shlex.split(err.partition("go on with: ")[2])
    assert run.returncode == 130 and sorted(again) == sorted(["hbbogie", "study", "run", str(path), *given, "--resume"])


@pytest.mark.parametrize("workers", [0, 1])
def test_a_job_that_prints_and_changes_its_directory(tmp_path, workers):
    """Standard output holds one JSON document, and files are where they were asked for."""
    path = write_study(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    text = (
        STUDY.format(wait=0.0).replace(":product", ":noisy").replace("wait = 0.0", f'folder = "{tmp_path}/elsewhere"')
    )
    path.write_text(text)
    run = process("hbbogie", "study", "run", path.name, "--workers", workers, "-o", "out", "--json", cwd=tmp_path)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "40 of 40 finished" in about(json.loads(out))["points"]
    assert "printed\n" in err and "printed by another process" in err
    assert (tmp_path / "out" / "products.html").exists() and finished(tmp_path / "products.db") == 40
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"spring.py"', '"springs.py"', "line 2: problem: no problem file"),
        ('"jobs.py:product"', '"jobs.py:produkt"', "line 3: job: job"),
        ('"jobs.py:product"', '"criticl"', "Did you mean 'critical'"),
        ("title", "titel", "line 1: titel: unknown key 'titel'. Did you mean 'title'"),
        ('title = "Products"', "title = 3", "line 1: title: got 3; give a value of type str"),
        ('"grid"', '"gird"', "line 9: [points] sample: unknown sample 'gird'. Did you mean 'grid'"),
        ("c = [", "cc = [", "line 13: [points.parameters] cc: unknown parameter 'cc'. Did you mean 'c'"),
        ("count = 8", "cuont = 8", "unknown key 'cuont'. Did you mean 'count'"),
        ("high = 8.0", 'high = "x"', "[points.parameters] high: got 'x'"),
        ("high = 8.0", "high = 800.0", "from 0 to 100 N/m"),
        ("count = 8", 'count = 8, unit = "kg"', "line 12: [points.parameters] k: parameter 'k': got the unit 'kg'"),
        ("[options]", "[options", "line 5"),
        ("wait =", "wiat =", "line 6: [options] wiat: job product: unknown option 'wiat'. Did you mean 'wait'"),
        ("c = [1.0", 'c = ["x"', "[points.parameters] c: got ['x', 2.0"),
        ("c = [1.0", "c = [[1.0]", "[points.parameters] c: got [[1.0], 2.0"),
        ("count = 8", "count = -8", "count"),
        ('"grid"', '"grid"\nseed = 3', "line 10: [points] seed: sample = 'grid' has no such key; allowed"),
        ('"grid"', '"list"\nrows = [{ k = 1.0 }]', "[points.parameters]: sample = 'list' has no such key; allowed"),
        ('"grid"', '"sobol"\ncount = 4\nexcept = ["k"]', "line 11: [points] except: names what 'around' leaves out"),
        (
            '"grid"',
            '"sobol"\ncount = 4',
            "[points.parameters] k: distribution 'uniform': got low, high, count",
        ),
        ("[options]", "[values]\nc = nan\n\n[options]", "line 6: [values] c: parameter 'c' (no description): got nan"),
        ('"grid"', '"sobol"\ncount = 4\naround = 0.1\nexcept = ["kk"]', "except: unknown parameter 'kk'"),
        ('"grid"', '"sobol"\ncount = 4\naround = -0.1', "around"),
        (
            "c = [1.0, 2.0, 3.0, 4.0, 5.0]",
            '[[figures]]\nkind = "distribution"\noutput = "product"\nbelow = ["x"]',
            "line 16: [figures] below: got ['x']; give a number",
        ),
        (
            "c = [1.0, 2.0, 3.0, 4.0, 5.0]",
            '[[figures]]\nkind = "parallel"\noutput = "product"\ninputs = ["kk"]',
            "line 16: [figures] inputs: unknown input 'kk'",
        ),
        (
            "c = [1.0, 2.0, 3.0, 4.0, 5.0]",
            '[[figures]]\nkind = "mapp"',
            "unknown kind of figure 'mapp'. Did you mean 'map'",
        ),
        (
            "c = [1.0, 2.0, 3.0, 4.0, 5.0]",
            '[[figures]]\nkind = "map"\nx = "kk"\ny = "k"\noutput = "product"',
            "line 15: [figures] x: unknown input 'kk'",
        ),
        (
            "c = [1.0, 2.0, 3.0, 4.0, 5.0]",
            '[[figures]]\nkind = "sensitivity"\noutput = "product"',
            "needs points with sample = 'saltelli'",
        ),
    ],
)
def test_wrong_study_files(tmp_path, old, new, message):
    path = write_study(tmp_path)
    text = STUDY.format(wait=0.0)
    assert old in text
    path.write_text(text.replace(old, new))
    result = call("run", path, "--workers", 0)
    assert result.exit_code == 2 and message in result.stderr.replace("\n", " "), result.stderr
    assert "products.toml" in result.stderr and not (tmp_path / "products.db").exists()


def test_wrong_arguments(tmp_path):
    for args, message in (
        (("run", "conicity_yaw_stifness"), "Did you mean 'conicity_yaw_stiffness'"),
        (("run", "nothing.toml"), "no study file 'nothing.toml'"),
        (("status", "nothing.db"), "no study 'nothing.db'"),
        (("export", "nothing.db", "-o", "x.xls"), "ends in .nc, .csv, .parquet"),
        (("report", "nothing.db", "-o", "x.pdf"), "ends in .html"),
        (("run", write_study(tmp_path), "--scheduler", "tcp://127.0.0.1:1"), "no Dask scheduler answers"),
    ):
        result = call(*args)
        assert result.exit_code == 2 and message in result.stderr, result.output


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("{ distribution = 3 }", "line 10: [points.parameters] k: distribution = 3; give a name such as"),
        ("{ around = 0.1, low = 3.0 }", "line 10: [points.parameters] k: unknown key 'low'. Allowed: around"),
    ],
)
def test_wrong_ranges(tmp_path, table, message):
    head = write_study(tmp_path).read_text().partition("[options]")[0]
    points = f'[points]\nsample = "sobol"\ncount = 4\n\n[points.parameters]\nk = {table}\n'
    (tmp_path / "ranges.toml").write_text(head + points)
    result = call("run", "ranges.toml", "--workers", 0)
    assert result.exit_code == 2 and message in result.stderr.replace("\n", " "), result.stderr


def test_files_of_another_kind(tmp_path):
    path = write_study(tmp_path)
    assert call("run", path, "--workers", 0, "--points", 4, "--store", "my.sqlite").exit_code == 0
    assert call("status", "my.sqlite").exit_code == 0
    (tmp_path / "latin.toml").write_bytes(b'title = "caf\xe9"')
    (tmp_path / "latin.csv").write_bytes(b"k,c\n1,\xe9\n")
    csv = STUDY.format(wait=0.0).partition("[points]")[0] + '[points]\nsample = "csv"\nfile = "latin.csv"\n'
    (tmp_path / "csv.toml").write_text(csv)
    (tmp_path / "other.sqlite").write_bytes(b"SQLite format 3\0" + bytes(100))
    for args, message in (
        (("run", "my.sqlite"), "is the store of a study"),
        (("status", "other.sqlite"), "not the store"),
        (("run", "latin.toml"), "cannot be read as text in UTF-8"),
        (("run", "csv.toml"), "cannot be read as text in UTF-8"),
    ):
        result = call(*args)
        assert result.exit_code == 2 and message in result.stderr.replace("\n", " "), result.output


def test_points_of_a_file_and_a_list(tmp_path):
    path = write_study(tmp_path)
    head = STUDY.format(wait=0.0).partition("[points]")[0]
    path.write_text(head + '[points]\nsample = "list"\nrows = [{ k = 1.0, c = 2.0 }, { k = 3.0, c = 4.0 }]\n')
    assert load_study(path).points.values.tolist() == [[1, 2], [3, 4]]
    (tmp_path / "points.csv").write_text("k,c\n5,6\n7,8\n")
    path.write_text(head + '[points]\nsample = "csv"\nfile = "points.csv"\n')
    assert load_study(path).points.values.tolist() == [[5, 6], [7, 8]]
    path.write_text(head + '[points]\nsample = "sobol"\ncount = 4\naround = 0.5\nexcept = ["c"]\n')
    points = load_study(path).points
    assert points.names == ("k",) and (np.abs(points.values - 2) <= 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("conicity_yaw_stiffness", 4), ("describing_function_error", 2)])
def test_shipped_studies_in_small(tmp_path, name, count):
    output = ("--output", tmp_path / "out") if name.startswith("conicity") else ()
    result = call("run", name, "--points", count, "--workers", 0, "--json", *output)
    assert result.exit_code == 0, result.output
    rows = about(json.loads(result.stdout))
    assert f"{count} of {count} finished, 0 without an answer" in rows["points"]
    assert not output or (tmp_path / "out" / f"{name}.html").stat().st_size > 50_000


@pytest.mark.slow
def test_shipped_uncertainty_in_small():
    """Eight base points of five inputs."""
    result = call("run", "creep_conicity_uncertainty", "--points", 8, "--workers", 0, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert "56 of 56 finished, 0 without" in about(document)["points"]
    assert {"2_sensitivity", "1_exceedance", "3_prediction"} <= {t["name"] for t in document["tables"]}


def test_the_study_file_of_the_documentation(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "studies.md").read_text("utf-8")
    (tmp_path / "shown.toml").write_text(re.search(r"```toml\n(.*?)```", text, re.DOTALL)[1])
    shown = load_study(tmp_path / "shown.toml")
    assert len(shown.points) == 200 and "V" not in shown.points.names and shown.values == {"K1": 3.2e6}
    K2 = shown.points.values[:, shown.points.names.index("K2")]
    assert 2e6 <= K2.min() < 2.2e6 and 19.8e6 < K2.max() <= 20e6


def test_every_shipped_study_is_sound():
    assert set(shipped_studies()) == {
        "conicity_yaw_stiffness",
        "creep_conicity_uncertainty",
        "describing_function_error",
        "vehicle_hunting",
    }
    for path in shipped_studies().values():
        assert load_study(path).figures


def test_status_finds_the_only_store_of_a_study(tmp_path):
    """That of --points N where there is no other; of several it asks which."""
    path = write_study(tmp_path)
    result = call("run", path, "--workers", 0, "--points", 10)
    assert result.exit_code == 0, result.output
    made = json.loads(call("status", path, "--json").stdout)["data"]["total"]
    assert made == json.loads(call("status", path, "--points", 10, "--json").stdout)["data"]["total"]
    if made != 10:
        assert f"--points 10 makes {made} points" in result.stderr and f"makes {made} points" in result.stdout
    Path("products-11.db").write_bytes(b"")
    refused = call("status", path)
    assert refused.exit_code == 2 and "say which by --points N" in " ".join(refused.stderr.split())
