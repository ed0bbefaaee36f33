"""Wrong study files of every kind, ten of each: a sentence says what belongs there, and no store is begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie.commandline import app
from hbbogie.errors import pair
from hbbogie.studies import grid

HEAD = 'problem = "bautin"\njob = "{job}"\n'
GRID = '[points]\nsample = "grid"\n[points.parameters]\na = [0.5, 1.0]\n'


def critical(options, job="critical", points=GRID):
    return f"{HEAD.format(job=job)}[options]\n{options}\n{points}"


def sampled(table, count="count = 4", extra=""):
    return f'{HEAD.format(job="critical")}[points]\nsample = "sobol"\n{count}\n{extra}\n[points.parameters]\n{table}\n'


def listed(rows):
    return f'{HEAD.format(job="critical")}[points]\nsample = "list"\nrows = {rows}\n'


WRONG = {
    "wrong type": [
        critical("interval = [-1.0]"),
        critical("interval = 10.0"),
        critical("interval = [-1.0, 0.0, 1.0]"),
        critical('interval = "-1 to 0"'),
        critical('interval = ["low", "high"]'),
        critical("interval = [false, true]"),
        critical('gradients = "no"'),
        critical("gradients = 0"),
        critical("harmonics = 3.5"),
        critical('harmonics = "many"'),
        critical("harmonics = true"),
        critical("parameter = 3"),
        critical("method = 1"),
        critical('at = "0.1"', "branch"),
        critical('at = ["x"]', "branch"),
        critical('methods = "df1"', "compare"),
        critical("truth = 15", "compare"),
        sampled("a = 3"),
        listed("[3]"),
    ],
    "wrong order": [
        critical("interval = [0.5, -2.0]"),
        critical("interval = [1, -1]"),
        critical("interval = [0.5, -2.0]", "cycles"),
        critical("interval = [0.5, -2.0]", "branch"),
        critical("interval = [0.5, -2.0]", "compare"),
        sampled("a = { low = 2.0, high = 1.0 }"),
        sampled("a = { low = -1.0, high = -2.0 }"),
        sampled('a = { distribution = "truncated_normal", mean = 1.0, deviation = 0.1, low = 2.0, high = 0.0 }'),
        sampled('a = { distribution = "triangular", low = 2.0, mode = 1.0, high = 0.0 }'),
        sampled('a = { distribution = "uniform", low = 2.0, high = 1.0 }'),
    ],
    "wrong name": [
        critical("intervall = [-2.0, 0.5]"),
        critical("Interval = [-2.0, 0.5]"),
        critical('method = "hb"'),
        critical('parameter = "nu"'),
        critical("", "kritical"),
        critical("", "jobs.py"),
        critical("", "nothing.py:f"),
        critical("", points=GRID.replace("a =", "b0 =")),
        critical("", points=GRID.replace("grid", "lattice")),
        sampled("a = { distribution = 'gauss', mean = 1.0 }"),
        critical("", points=GRID.replace("a =", "alpha =")),
        HEAD.format(job="critical").replace("bautin", "bautim") + GRID,
    ],
    "out of range": [
        critical("harmonics = 0"),
        critical("harmonics = -3"),
        critical("harmonics = 0", "cycles"),
        critical("harmonics = -1", "branch"),
        sampled("a = { around = -0.1 }"),
        sampled("a = { low = 0.5, high = 1.0 }", "count = 0"),
        sampled("a = { low = 0.5, high = 1.0 }", "count = -4"),
        sampled("a = { low = 0.5, high = 1.0 }", "count = 4", "seed = -1"),
        sampled('a = { distribution = "normal", mean = 1.0, deviation = -1.0 }'),
        critical("", points=GRID.replace("[0.5, 1.0]", "{ low = 0.5, high = 1.0, count = 0 }")),
        critical("interval = [1e3, 1e4]"),
    ],
    "empty": [
        "",
        critical("interval = []"),
        critical('parameter = ""'),
        critical('method = ""'),
        critical("", ""),
        critical("", points=GRID.replace("[0.5, 1.0]", "[]")),
        critical("", points='[points]\nsample = "grid"\n'),
        critical("", points='[points]\nsample = ""\n'),
        critical("", points=""),
        critical('truth = ""', "compare"),
        listed("[]"),
        listed("[{}]"),
        sampled("a = {}"),
    ],
    "not finite": [
        critical("interval = [nan, 0.5]"),
        critical("interval = [-inf, 0.5]"),
        critical("interval = [-2.0, inf]"),
        critical("harmonics = inf"),
        critical("harmonics = nan"),
        critical("", points=GRID.replace("1.0]", "nan]")),
        critical("", points=GRID.replace("1.0]", "inf]")),
        sampled("a = { low = nan, high = 1.0 }"),
        sampled("a = { low = 0.5, high = inf }"),
        sampled("a = { around = nan }"),
        listed("[{ a = nan }]"),
        sampled('a = { distribution = "normal", mean = 1.0, deviation = inf }'),
    ],
    "absurdly large": [
        critical("harmonics = 1000000"),
        critical("harmonics = 9000000000000000000"),
        critical("harmonics = 1000000", "cycles"),
        critical("harmonics = 1000000", "branch"),
        critical('methods = ["mhb1000000"]', "compare"),
        sampled("a = { low = 0.5, high = 1.0 }", "count = 1000000000000"),
        sampled("a = { low = 0.5, high = 1.0 }", "count = 9000000000000000000"),
        critical("", points=GRID.replace("[0.5, 1.0]", "{ low = 0.5, high = 1.0, count = 1000000000000 }")),
        sampled("a = { low = 0.5, high = 1e300 }"),
        critical("", points=GRID.replace("1.0]", "1e300]")),
        sampled("a = { around = 1e300 }"),
    ],
    "duplicated": [
        critical("harmonics = 3\nharmonics = 5"),
        critical("interval = [-2.0, 0.5]\ninterval = [-2.0, 0.5]"),
        HEAD.format(job="critical") + 'job = "cycles"\n' + GRID,
        HEAD.format(job="critical") + 'problem = "bautin"\n' + GRID,
        critical("") + "[options]\n",
        critical("") + "[points]\n",
        critical("", points=GRID + "a = [2.0]\n"),
        critical("", points=GRID + '"a" = [2.0]\n'),
        sampled("a = { low = 0.5, low = 0.6, high = 1.0 }"),
        listed("[{ a = 1.0, a = 2.0 }]"),
    ],
    "contradictory": [
        f"{HEAD.format(job='critical')}[values]\na = 1.0\n{GRID}",
        sampled("a = { around = 0.1, low = 0.5 }"),
        sampled('a = { distribution = "normal", low = 0.5, high = 1.0 }'),
        critical("", points=GRID.replace('"grid"', '"grid"\ncount = 3')),
        critical("", points=GRID.replace('"grid"', '"grid"\nrows = [{ a = 1.0 }]')),
        critical("", points=GRID.replace('"grid"', '"csv"')),
        listed("[{ a = 1.0 }, { w0 = 1.0 }]"),
        listed("[{ a = 1.0 }]") + "[points.parameters]\na = [1.0]\n",
        sampled("a = { low = 0.5, high = 1.0 }", extra='except = ["a"]'),
        f"{HEAD.format(job='critical')}[values]\na = 1.0\n{listed('[{ a = 1.0 }]').partition('critical')[2][2:]}",
        sampled("a = { low = 0.5, high = 1.0, around = 0.1 }"),
        critical("method = 'batch'"),
        critical("", points=GRID.replace("a =", "mu =")),
        critical("", "branch", GRID.replace("a =", "mu =")),
        critical("parameter = 'a'", "compare"),
    ],
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_study_files_end_before_they_begin(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    assert len(WRONG[kind]) >= 10
    for k, content in enumerate(WRONG[kind]):
        (tmp_path / f"s{k}.toml").write_text(content)
        result = CliRunner().invoke(app, ["study", "run", f"s{k}.toml", "--workers", "0"])
        assert result.exit_code == 2 and isinstance(result.exception, SystemExit), (content, result.output)
        assert "Error" in result.stderr or result.stderr.strip(), content
        assert not list(tmp_path.glob("*.db")), content


SQUARE = "def square(system):\n    return {'square': system.values['a'] ** 2}\n"


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A study that is done at once, in the working directory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.py").write_text(SQUARE)
    (tmp_path / "s.toml").write_text(HEAD.format(job="job.py:square") + GRID)

    def run(*arguments):
        found = CliRunner().invoke(app, ["study", *arguments])
        return found.exit_code, " ".join(found.stderr.split())

    return run


def test_a_file_begun_by_a_byte_order_mark_and_empty_lines_of_points(small, tmp_path):
    listed = HEAD.format(job="job.py:square") + '[points]\nsample = "csv"\nfile = "p.csv"\n'
    (tmp_path / "s.toml").write_text(listed, "utf-8-sig")
    (tmp_path / "p.csv").write_text("a\n\n1.0\n\n2.0\n\n")
    assert small("run", "s.toml", "--workers", "0")[0] == 0
    assert small("export", "s.toml", "-o", "s.csv")[0] == 0
    assert [line.split(",")[1] for line in (tmp_path / "s.csv").read_text().splitlines()[1:]] == ["1.0", "2.0"]


def test_places_where_no_store_can_be(small, tmp_path):
    for place in (".", "/dev/null"):
        code, said = small("run", "s.toml", "--workers", "0", "--store", place)
        assert code == 2 and "is no file; give the path of a store" in said


def test_an_export_does_not_replace_the_store(small, tmp_path):
    store = tmp_path / "x.nc"
    assert small("run", "s.toml", "--workers", "0", "--store", "x.nc")[0] == 0
    whole = store.read_bytes()
    code, said = small("export", "x.nc", "-o", "x.nc")
    assert code == 2 and "is the store of a study, which an export would replace" in said
    assert store.read_bytes() == whole


def test_an_export_does_not_replace_the_points(small, tmp_path):
    points = tmp_path / "p.csv"
    (tmp_path / "s.toml").write_text(HEAD.format(job="job.py:square") + '[points]\nsample = "csv"\nfile = "p.csv"\n')
    points.write_text("a\n1.0\n2.0\n")
    assert small("run", "s.toml", "--workers", "0")[0] == 0
    code, said = small("export", "s.toml", "-o", "p.csv")
    assert code == 2 and "holds the study's points, which an export would replace" in said
    assert points.read_text() == "a\n1.0\n2.0\n"


def test_more_processes_than_a_machine_can_start_are_refused(small):
    code, said = small("run", "s.toml", "--workers", "1000000000")
    assert code == 2 and "give at most" in said and "cluster" in said


def test_the_line_of_a_wrong_option_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for option, said in {
        "interval = [190]": "got [190]; give a list of 2 values",
        "interval = [1, 0]": "interval: got (1, 0); give two finite numbers (low, high) with low < high",
        "gradients = 'no'": "got 'no'; give true or false",
        "method = 'hb'": "got 'hb'; give one of 'auto', 'exact', 'mhb'",
        "harmonics = 0": "harmonics: got 0; give a whole number, 1 or more",
    }.items():
        (tmp_path / "s.toml").write_text(critical(f"# of the job\n{option}"))
        result = CliRunner().invoke(app, ["study", "run", "s.toml", "--workers", "0"])
        assert f"s.toml, line 5: [options] {option.partition(' ')[0]}: job smallest_critical: {said}" in " ".join(
            result.stderr.split()
        )


def annotated(
    system: Any,
    shares: Mapping[str, float] | None = None,
    names: Sequence[str] = (),
    span: Annotated[tuple[float, float], pair] = (0.0, 1.0),
    size: Literal["small", "large"] = "small",
    levels: list[int] | None = None,
    weights: tuple[float, ...] = (),
    anything: Any = None,
    other: np.ndarray | None = None,
):
    return {"y": 1.0}


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({"shares": [1.0]}, "a table"),
        ({"shares": {"a": "b"}}, "a number in each place"),
        ({"names": "abc"}, "a list"),
        ({"names": [1]}, "a text in each place"),
        ({"span": [1.0]}, "a list of 2 values"),
        ({"span": [1.0, 0.0]}, "low < high"),
        ({"size": "huge"}, "one of 'small', 'large'"),
        ({"levels": [1.5]}, "a whole number in each place"),
        ({"levels": np.array([1.5])}, "a whole number in each place"),
        ({"weights": ["a"]}, "a number in each place"),
        ({"weights": 1.0}, "a list"),
        ({"wights": 1.0}, "Did you mean 'weights'"),
    ],
)
def test_options_of_a_function_are_compared_with_its_signature(options, wanted):
    with pytest.raises(hb.ModelError, match=wanted):
        hb.sweep(annotated, grid({"a": [1.0]}), problem="bautin", options=options, workers=0)


def test_options_that_fit_are_accepted():
    good = {
        "shares": {"a": 1},
        "names": ("b", "c"),
        "span": np.array([0, 1]),
        "size": "large",
        "levels": [np.int64(3)],
        "weights": [1, 2.5, np.float64(3)],
        "anything": object,
        "other": [1],
    }
    data = hb.sweep(annotated, grid({"a": [1.0]}), problem="bautin", options=good, workers=0)
    assert data["y"].item() == 1.0


@pytest.mark.parametrize(
    "error", [TypeError, ValueError, KeyError, IndexError, AttributeError, NameError, ImportError, AssertionError]
)
def test_a_mistake_at_the_nominal_point_ends_the_study(tmp_path, error):
    def job(system):
        raise error("a mistake")

    with pytest.raises(hb.ModelError, match=f"cannot be done at the nominal point: {error.__name__}: .*a mistake"):
        hb.sweep(job, {"a": [1.0]}, problem="bautin", store=tmp_path / "s.db", workers=0)
    assert not (tmp_path / "s.db").exists()


@pytest.mark.parametrize("error", [ArithmeticError, RuntimeError, MemoryError, np.linalg.LinAlgError, OSError])
def test_work_that_does_not_succeed_is_a_failed_row(error):
    def job(system):
        if system.values["a"] != 2.0:
            raise error("no success")
        return {"y": 1.0}

    data = hb.sweep(job, {"a": [1.0, 2.0]}, problem="bautin", workers=0)
    assert data["failed"].values.tolist() == [True, False]
