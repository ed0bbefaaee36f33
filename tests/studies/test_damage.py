"""Damaged stores and full disks: nothing is read that was not written, and what is whole can be used."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
from small_studies import write_study
from typer.testing import CliRunner

import hbbogie as hb
from hbbogie.commandline import app
from hbbogie.studies import Store, dataset_of, load_study, shipped_studies

unix = pytest.mark.skipif(sys.platform == "win32", reason="needs limits of Unix")
COLUMNS = ("k", "c", "product", "third", "name", "finished")
PAGE = 4096


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    write_study(folder)
    run(folder)
    return folder


def run(folder, **keywords):
    wanted = load_study(folder / "products.toml")
    given = {"problem": wanted.problem, "options": wanted.options, "store": folder / "products.db", "workers": 0}
    return hb.sweep(wanted.job, wanted.points, **given | keywords)


def read(store):
    with closing(Store.read(store)) as keep:
        return dataset_of(keep)


def changed(study, tmp_path, name, statement, *values):
    """Return a copy of the store in which a statement of SQL has changed something."""
    path = tmp_path / f"{name}.db"
    path.write_bytes((study / "products.db").read_bytes())
    with closing(sqlite3.connect(path)) as c, c:
        c.execute(statement, values)
    return path


def test_no_bit_flip_is_read_silently(study, tmp_path):
    """Of 200, in the pages that hold anything: every value is the one written, or its row is named, or a sentence."""
    truth, whole, path = read(study / "products.db"), (study / "products.db").read_bytes(), tmp_path / "flipped.db"
    pages = [i for i in range(0, len(whole), PAGE) if any(whole[i : i + PAGE])]
    rng, named, refused = np.random.default_rng(3), 0, 0
    for _ in range(200):
        flipped = bytearray(whole)
        flipped[int(rng.choice(pages)) + int(rng.integers(PAGE))] ^= 1 << int(rng.integers(8))
        path.write_bytes(flipped)
        try:
            data = read(path)
        except hb.ModelError as error:
            refused += 1
            assert "damaged" in str(error) or "another version" in str(error)
            continue
        damaged = json.loads(data.attrs["damaged"])
        named += bool(damaged)
        said = np.char.find(data["status"].values, "the row is damaged") >= 0
        assert data["point"].values.tolist() == list(range(40))
        assert np.flatnonzero(said).tolist() == [i for i in damaged if i >= 0]
        for column in COLUMNS if not said.all() else ():
            assert (data[column].values[~said] == truth[column].values[~said]).all()
        assert damaged or {**data.attrs} == {**truth.attrs}
    assert named > 10 and refused < 20  # of the bytes of a page, about a third are in use


CHANGES = {
    "an output": "UPDATE points SET outputs = replace(outputs, '6.0', '7.0') WHERE point IN (3, 7)",
    "an input": """UPDATE points SET inputs = '{"k": 1.5, "c": 4.0}' WHERE point IN (3, 7)""",
    "a status": "UPDATE points SET status = 'multiplies' WHERE point IN (3, 7)",
    "a failure": "UPDATE points SET failed = 1 WHERE point IN (3, 7)",
    "a time": "UPDATE points SET seconds = seconds + 1 WHERE point IN (3, 7)",
    "a worker": "UPDATE points SET worker = 'another' WHERE point IN (3, 7)",
    "an end": "UPDATE points SET finished = '2020-01-01T00:00:00.000Z' WHERE point IN (3, 7)",
    "a checksum": "UPDATE points SET checksum = 'f' || checksum WHERE point IN (3, 7)",
    "no outputs": "UPDATE points SET outputs = NULL, failed = NULL WHERE point IN (3, 7)",
    "no row": "DELETE FROM points WHERE point IN (3, 7)",
    "another kind": "UPDATE points SET outputs = x'00ff' WHERE point IN (3, 7)",
    "a number": "UPDATE points SET point = 1000 + point WHERE point IN (3, 7)",
}


@pytest.mark.parametrize("statement", CHANGES.values(), ids=CHANGES)
def test_damaged_rows_are_named_and_computed_anew(study, tmp_path, statement):
    """Whatever part of a row is damaged: the others are used, and resuming the study makes it whole."""
    if "'6.0'" in statement:
        statement = statement.replace("'6.0', '7.0'", "'product', 'produkt'")
    path = changed(study, tmp_path, "s", statement)
    data, truth = read(path), read(study / "products.db")
    assert json.loads(data.attrs["damaged"]) == [3, 7]
    assert data["failed"].values.nonzero()[0].tolist() == [3, 7] and np.isnan(data["k"].values[[3, 7]]).all()
    np.testing.assert_array_equal(np.delete(data["product"].values, [3, 7]), np.delete(truth["product"].values, [3, 7]))
    with closing(Store.read(path)) as keep:
        counts = keep.counts()
        assert (counts.total, counts.done, counts.missing, counts.damaged) == (40, 38, 0, (3, 7))
    again = run(study, store=path, resume=True)
    assert again[["product", "k", "status"]].equals(truth[["product", "k", "status"]])
    assert json.loads(again.attrs["damaged"]) == []
    assert "2 damaged rows, computed anew (points 3, 7)" in again.attrs["changes"]
    kept = np.delete(np.arange(40), [3, 7])
    assert (again["finished"].values[kept] == truth["finished"].values[kept]).all()


def test_what_describes_the_study_is_there_twice(study, tmp_path):
    """One damaged copy changes nothing; without both there is a sentence."""
    truth = read(study / "products.db")
    path = changed(study, tmp_path, "once", "UPDATE about SET value = '9' || value")
    assert read(path).identical(truth)
    with closing(sqlite3.connect(path)) as c, c:
        c.execute("DELETE FROM about_again WHERE name = 'versions'")
    with pytest.raises(hb.ModelError, match="does not say its 'versions'"):
        read(path)


def test_a_store_of_another_version_is_refused_in_one_sentence(study, tmp_path):
    path = changed(study, tmp_path, "old", "PRAGMA user_version = 0")
    for how in (Store.read, Store.open):
        with pytest.raises(hb.ModelError, match=r"another version of hbbogie .layout 0; this version reads layout 2"):
            how(path)


def test_nothing_is_added_to_a_file_whose_structure_is_damaged(study, tmp_path):
    """A leaf of the table of points loses its count of rows; what is on the other pages can be exported."""
    path, whole = tmp_path / "torn.db", bytearray((study / "products.db").read_bytes())
    leaves = [i for i in range(PAGE, len(whole), PAGE) if whole[i] == 13 and b"multiplied" in whole[i : i + PAGE]]
    assert len(leaves) > 1
    whole[leaves[-1] + 3 : leaves[-1] + 5] = b"\xff\xff"
    path.write_bytes(whole)
    data = read(path)
    damaged = json.loads(data.attrs["damaged"])
    assert 0 < len(damaged) < 39 and data["failed"].values.sum() == sum(i >= 0 for i in damaged)
    with pytest.raises(hb.ModelError, match="nothing can be added to it; take what is whole with hbbogie study export"):
        run(study, store=path, resume=True)
    result = CliRunner().invoke(app, ["study", "export", str(path), "-o", str(tmp_path / "whole.csv")])
    assert result.exit_code == 0 and "Damaged in the store" in result.stdout
    assert (tmp_path / "whole.csv").read_text().count("multiplied") == 40 - data["failed"].values.sum()
    result = CliRunner().invoke(app, ["study", "status", str(path)])
    assert result.exit_code == 0 and "damaged rows" in result.stdout


FULL = """
import os, resource
import hbbogie as hb
from hbbogie.studies import load_study, sweeps
wanted, drive = load_study({path!r}), sweeps.drive

def filled(*args):
    size = max(os.path.getsize(f) for f in ({store!r}, {store!r} + "-wal"))
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))  # to SQLite, a full disk
    drive(*args)

sweeps.drive = filled
try:
    hb.sweep(wanted.job, wanted.points, problem=wanted.problem, store={store!r}, workers=0, options={options!r})
    print("finished")
except hb.ModelError as error:
    print(error)
"""
LONG = """
def product(system, length):
    k, c = system.values["k"], system.values["c"]
    return {"product": k * c, "text": "x" * length}
"""


@unix
@pytest.mark.parametrize(("length", "enough"), [(1000, True), (100_000, False)])
def test_full_disk_during_the_work(tmp_path, length, enough):
    """The room reserved, with that of the log, is enough for usual outputs; else a sentence, and what is done stays."""
    path, store = write_study(tmp_path), tmp_path / "s.db"
    (tmp_path / "jobs.py").write_text(LONG)
    path.write_text(path.read_text().replace("wait = 0.0", f"length = {length}"))
    code = FULL.format(path=str(path), store=str(store), options={"length": length})
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert out.stderr == "" and len(out.stdout.splitlines()) == 1
    if enough:
        assert out.stdout == "finished\n"
        return
    assert "the disk is full or broken; make room. What was finished before is safe" in out.stdout
    before = read(store)
    assert 1 < before.sizes["point"] < 40
    np.testing.assert_array_equal(before["product"].values, before["k"].values * before["c"].values)
    wanted = load_study(path)
    keywords = {"problem": wanted.problem, "options": wanted.options, "store": store, "resume": True, "workers": 0}
    after = hb.sweep(wanted.job, wanted.points, **keywords)
    assert after.sizes["point"] == 40 and not after["failed"].values.any()
    n = before.sizes["point"]
    assert (after["finished"].values[:n] == before["finished"].values).all()


def test_results_are_shown_without_running_any_code(study, tmp_path, monkeypatch):
    """The files of problem and job are gone, or would do harm; status, export and report need the store alone."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "products.db").write_bytes((study / "products.db").read_bytes())
    figures = '\n[[figures]]\nkind = "map"\nx = "k"\ny = "c"\noutput = "product"\n'
    (tmp_path / "products.toml").write_text((study / "products.toml").read_text() + figures)
    harm = "import pathlib\npathlib.Path(__file__).with_name('ran').touch()\nraise SystemExit('code has run')\n"
    for content in (None, harm):
        for name in ("spring.py", "jobs.py"):
            if content:
                (tmp_path / name).write_text(content)
        for args in (
            ("status", "products.toml", "--json"),
            ("export", "products.toml", "-o", "out.csv"),
            ("report", "products.toml", "-o", "out.html"),
            ("report", "products.db", "-o", "again.html"),
        ):
            result = CliRunner().invoke(app, ["study", *args])
            assert result.exit_code == 0, result.output
        assert "<title>Products</title>" in (tmp_path / "out.html").read_text("utf-8")
        assert "<img" in (tmp_path / "out.html").read_text("utf-8")
    assert not (tmp_path / "ran").exists()
    (tmp_path / "products.toml").write_text('title = "T"\nfigure = 3\n')
    result = CliRunner().invoke(app, ["study", "report", "products.toml", "-o", "out.html"])
    assert result.exit_code == 2 and "line 2: figure: unknown key 'figure'" in result.stderr


def test_a_store_of_a_shipped_study_is_found_by_name(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = next(iter(shipped_studies()))
    (tmp_path / f"{name}.db").write_bytes((study / "products.db").read_bytes())
    assert CliRunner().invoke(app, ["study", "status", name]).exit_code == 0
