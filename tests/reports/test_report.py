import csv
import json
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest

from hbbogie import Branch, ModelError, Orbit, load_problem
from hbbogie.branches import bifurcation_diagram, stability_of
from hbbogie.model import default_interval, system_of
from hbbogie.reports import Report, Table, check_directory, cycles_table, plain, run_of
from hbbogie.results import Stability

matplotlib.use("Agg")
PNG = b"\x89PNG\r\n\x1a\n"


def shipped(name, **values):
    module = load_problem(name)
    return module, system_of(module, **values)


def orbit(**changes):
    c = np.array([[0.0, 0.1], [2.0, 0.0], [0.0, -1.0]])
    fields = dict(system="s", coordinates=("x", "y"), units=("m", ""), motion=c, omega=2.0, parameters={"mu": 1.0})
    return Orbit(**(fields | changes))


TABLE = Table(
    "t", "A table", ("V [m/s]", "kind", "n"), ((1 / 3, "hopf", 2), (None, 'a "b", c', None)), (".2f", "", "d")
)


def test_csv_round_trip(tmp_path):
    TABLE.to_csv(tmp_path / "t.csv")
    with open(tmp_path / "t.csv", newline="", encoding="utf-8") as file:
        header, first, second = csv.reader(file)
    assert tuple(header) == TABLE.columns
    assert float(first[0]) == 1 / 3 and first[1:] == ["hopf", "2"]
    assert second == ["", 'a "b", c', ""]


def test_csv_of_numpy_numbers(tmp_path):
    Table("t", "", ("x",), ((np.float64(0.1),), (np.int64(3),)), (".1f",)).to_csv(tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "x\n0.1\n3\n"


def test_table_as_text_and_json():
    assert TABLE.cells() == [["0.33", "hopf", "2"], ["", 'a "b", c', ""]]
    assert json.loads(json.dumps(TABLE.as_dict(), allow_nan=False))["rows"][1] == [None, 'a "b", c', None]


def test_table_of_uneven_rows():
    with pytest.raises(ModelError, match="one format and one entry for each column"):
        Table("t", "", ("a", "b"), ((1,),), ("", ""))


def test_plain_values_for_json():
    value = {"a": np.array([1.0, np.nan]), "b": 1 + 2j, "c": (np.int64(3), np.bool_(True)), "d": None, "e": np.inf}
    expected = {"a": [1.0, None], "b": [1.0, 2.0], "c": [3, True], "d": None, "e": None}
    assert plain(value) == expected


def test_numbers_are_never_cut_in_a_narrow_terminal(capsys):
    """A table that is too wide is printed in parts, each with the first column, in lines that fit."""
    from rich.console import Console

    from hbbogie.commandline import print_table

    columns = ("state", *(f"quantity {i} [m/s]" for i in range(12)))
    for rows in (2, 9):
        table = Table("t", "T", columns, ((77777, *[-1234.5678] * 12),) * rows, ("d", *[".4f"] * 12))
        print_table(table, Console(width=40))
        text = capsys.readouterr().out
        assert text.count("-1234.5678") == 12 * rows and "…" not in text and "[m/s]" in text
        assert max(map(len, text.splitlines())) <= 40
        if rows == 9:
            parts = text.count("state")
            assert parts > 1 and text.count("77777") == parts * rows


def test_a_table_in_parts_keeps_subjects_together(capsys):
    from rich.console import Console

    from hbbogie.commandline import print_table

    columns = ("state", *(f"{subject} {kind}" for subject in ("omega", "a1", "a2") for kind in ("printed", "computed")))
    print_table(Table("t", "T", columns, ((1, *[123456.789] * 6),) * 9, ("d", *[".3f"] * 6)), Console(width=45))
    heads = [line.split() for line in capsys.readouterr().out.splitlines() if "." not in line]
    assert sum("state" in head for head in heads) == 3
    assert not any(head.count("omega") == 1 or head.count("a1") == 1 or head.count("a2") == 1 for head in heads)


@pytest.mark.parametrize(
    ("multipliers", "largest"),
    [([1.2, 1.0001, 0.3], 1.2), ([0.99, 0.5j, -0.5j], 0.5), ([np.nan, np.nan], None), ([1.0], None)],
)
def test_largest_multiplier_leaves_the_trivial_one_out(multipliers, largest):
    s = Stability("stable", np.array(multipliers, complex), 0.0, 0, "")
    assert orbit(stability=s).largest_multiplier == largest


def test_cycles_table():
    judged = orbit(stability=Stability("unknown", np.array([1.0, 0.5 + 0j]), 0.0, 0, "neutral."))
    table = cycles_table([orbit(), judged])
    header = dict(zip(table.columns, table.rows[1], strict=True))
    assert header["peak x [m]"] == pytest.approx(2.0, rel=1e-12)
    assert header["peak y [1]"] == pytest.approx(1.1, rel=1e-12)
    assert header["first harmonic y [1]"] == pytest.approx(1.0, rel=1e-12)
    assert header["stability"] == "unknown" and header["largest multiplier [1]"] == 0.5
    assert dict(zip(table.columns, table.rows[0], strict=True))["stability"] is None
    assert table.notes == ("Of the 2 cycles none is known to be stable.", "Cycle 2: neutral.")


def test_write(tmp_path):
    def draw():
        from hbbogie import plot

        return plot.orbit(orbit()).figure

    report = Report("r", (TABLE,), {"b": Branch((orbit(),), "mu")}, {"f": draw}, long_tables=(TABLE,))
    folder = tmp_path / "new" / "out"
    files = report.write(folder)
    assert [f.name for f in files] == ["b.nc", "t.csv", "t.csv", "f.png"]
    assert all(f.is_file() for f in files)
    assert (folder / "f.png").read_bytes().startswith(PNG)
    assert Branch.load(folder / "b.nc").orbits[0].omega == 2.0
    document = json.loads(json.dumps(report.as_dict(), allow_nan=False))
    assert document["branches"]["b"]["amplitude"]["x"] == [pytest.approx(2.0, rel=1e-12)]


def test_a_directory_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    for bad in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(ModelError, match=r"cannot write to the directory.*give a directory"):
            check_directory(bad)


def test_study_of_the_problem_itself():
    own = SimpleNamespace(__name__="mine", study=lambda system, progress: Report(system))
    assert run_of(own, "s").title == "s"
    own.study = lambda system, progress: 3
    with pytest.raises(ModelError, match="returned an object of type int"):
        run_of(own, "s")
    own.study = 3
    with pytest.raises(ModelError, match="must be a function"):
        run_of(own, "s")


def test_default_interval():
    module, system = shipped("bautin")
    assert default_interval(module, system) == (module.PARAMETER, module.RANGE)
    name, (lo, hi) = default_interval(SimpleNamespace(), system)
    assert name == system.parameter_names[0] and lo < system.values[name] < hi


def test_default_study_of_the_bautin_form():
    module, system = shipped("bautin")
    said = []
    report = run_of(module, system, lambda message, fraction: said.append((message, fraction)))
    tables = {t.name: t for t in report.tables}
    assert [row[1] for row in tables["cycles"].rows] == ["unstable", "stable"]
    assert tables["cycles"].notes[0] == "Of the 2 cycles 1 is stable: 2."
    special = {row[0]: row[1] for row in tables["special_points"].rows}
    assert special["hopf"] == pytest.approx(0.0, abs=1e-12)
    assert special["fold"] == pytest.approx(-0.25, abs=1e-8)  # -a^2/4 with a = 1
    assert {"branch"} == set(report.branches) and {"amplitude", "phase_portrait"} <= set(report.figures)
    assert report.branches["branch"].verdicts.count("unknown") <= 2  # next to the fold
    assert any("tracing" in message for message, _ in said)


@pytest.mark.parametrize("name", ["duffing", "gap_oscillator"])
def test_default_study_of_a_conservative_system_shows_the_backbone(name):
    module, system = shipped(name)
    report = run_of(module, system)
    table = next(t for t in report.tables if t.name == "family")
    peak, omega = (np.array([row[i] for row in table.rows]) for i in (0, 2))
    assert (np.diff(peak) > 0).all()
    exact = module.backbone(peak) if name == "duffing" else 2 * np.pi / module.period(peak)
    large = peak > (0.0 if name == "duffing" else 1.3)  # close to the gap 15 harmonics are few
    np.testing.assert_allclose(omega[large], exact[large], rtol=1e-5 if name == "duffing" else 1e-3)
    assert "family_backbone" in report.figures and any("every amplitude" in n for n in report.notes)


def test_default_study_where_nothing_is_found():
    module, system = shipped("duffing")
    module = SimpleNamespace(PARAMETER="d", RANGE=(0.5, 1.0))
    report = run_of(module, system.with_parameters(d=0.7))
    assert not report.branches and any("No branch" in note for note in report.notes)


def test_an_unknown_verdict_is_that_of_the_polished_cycle():
    from hbbogie import HarmonicBalance, find_cycles, solve

    _, system = shipped("van_der_pol", mu=2.0)
    few = HarmonicBalance(5).equations(system)
    rough = solve(few, find_cycles(system, stability=False)[0])
    unknown = Stability("unknown", np.array([1.1, 0.1], complex), 0.1, 0, "rough.")
    better = stability_of(system, rough.replace(stability=unknown))
    assert better.verdict == "stable" and "Judged on the cycle with harmonics up to" in better.reason


def test_only_one_of_two_mirror_images_is_shown():
    """The circuit without bias: symmetric branch, one asymmetric half from the pitchfork, doubled cycles if any."""
    module = load_problem("circuit")
    found = bifurcation_diagram(module.circuit(e=0.0), "v", (-0.6, -0.57), harmonics=15)
    assert found.branches["pitchfork"].special[0].kind == "pitchfork"
    half = found.branches["pitchfork"]
    assert (np.diff(half.values) < 0).all()
    assert abs(half.orbits[0].coefficients[0]).max() < 1e-8 < abs(half.orbits[-1].coefficients[0]).max()
    assert any("mirror image" in note for note in found.notes)


def test_a_branch_through_a_known_cycle_is_listed_once():
    """Fifteen harmonics lead from the Hopf point around the fold to the cycle that its own method finds exactly."""
    module = load_problem("yang1995")
    found = bifurcation_diagram(module.bogie(V=100.0), "V", (85.0, 105.0), harmonics=15)
    assert len(found.cycles) == 1 and [*found.branches] == ["branch"]


@pytest.mark.parametrize(("form", "begins"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_figures_have_the_form_asked_for(tmp_path, form, begins):
    from hbbogie.reports import draw

    report = Report("r", figures={"orbit": lambda: draw("orbit", orbit())})
    (file,) = report.write(tmp_path, form=form)
    assert file.name == f"orbit.{form}" and file.read_bytes().startswith(begins)
    assert report.write(tmp_path, figures=False) == []
    with pytest.raises(ModelError, match="unknown form of figures 'gif'"):
        report.write(tmp_path, form="gif")
