"""The store survives: processes are killed, disks are full, two want it at once."""

from __future__ import annotations

import concurrent.futures as cf
import importlib
import json
import multiprocessing
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import casadi
import numpy as np
import pandas
import pytest
from small_studies import finished, process, wait_for, write_study

import hbbogie as hb
from hbbogie.studies import Store, dataset_of, export, grid, load_study, options_text

unix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals, users and limits of Unix")
NAMES = ["product", "third", "name", "status", "failed"]


def run(path, **keywords):
    wanted = load_study(path)
    return hb.sweep(
        wanted.job,
        wanted.points,
        problem=wanted.problem,
        options={"wait": 0.0} | keywords.pop("options", {}),
        **{"workers": 0, **keywords},
    )


def read(store):
    keep = Store.read(store)
    data = dataset_of(keep)
    keep.close()
    return data


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """The same study, run in one go and in memory."""
    folder = tmp_path_factory.mktemp("truth")
    return run(write_study(folder))


@unix
def test_killed_and_resumed(tmp_path, truth):
    """Killed with no chance to clean up, twice; what was finished is kept, and the whole is as if nothing had been."""
    path, store = write_study(tmp_path, wait=0.05), tmp_path / "s.db"
    command = ("hbbogie", "study", "run", path, "--store", store, "--workers", 2)
    first = process(*command)
    before = wait_for(lambda: finished(store) >= 5 and read(store), "five points")
    first.kill()
    first.communicate(timeout=60)
    second = process(*command, "--resume")
    done = finished(store)
    between = wait_for(lambda: finished(store) >= done + 5 and read(store), "five more points")
    os.kill(second.pid, signal.SIGKILL)
    second.communicate(timeout=60)
    out, err = process(*command, "--resume").communicate(timeout=60)
    assert "40 of 40 points" in err, out
    data = read(store)
    assert data[NAMES].equals(truth[NAMES])
    for earlier in (before, between):  # not computed again
        same = data["finished"].values[earlier["point"].values] == earlier["finished"].values
        assert same.all()


@unix
def test_workers_end_with_their_parent(tmp_path):
    path, store = write_study(tmp_path, wait=0.05), tmp_path / "s.db"
    parent = process("hbbogie", "study", "run", path, "--store", store, "--workers", 2)
    wait_for(lambda: finished(store) >= 2, "two points")
    workers = {int(str(w).split(":")[1]) for w in read(store)["worker"].values}
    parent.kill()
    parent.communicate(timeout=60)

    def gone():
        return not any(_runs(pid) for pid in workers)

    wait_for(gone, "the workers to end", 15.0)


def _runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{pid}/stat")
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"


def test_two_processes_on_one_store(tmp_path, truth):
    """The second is refused, in so many words; the first goes on, and can be looked at meanwhile."""
    path, store = write_study(tmp_path, wait=0.5), tmp_path / "s.db"
    command = ("hbbogie", "study", "run", path, "--store", store, "--workers", 1)
    first = process(*command)
    wait_for(lambda: finished(store) >= 2, "two points")
    _, err = process(*command, "--resume").communicate(timeout=60)
    assert "another process works on" in err and first.poll() is None
    with pytest.raises(hb.ModelError, match="another process works on"):
        Store.open(store)
    first.communicate(timeout=60)
    assert read(store)[NAMES].equals(truth[NAMES])
    with sqlite3.connect(store) as c:
        assert c.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    c.close()


@unix
@pytest.mark.parametrize("raising", [True, False])
def test_ctrl_c_that_is_swallowed(tmp_path, raising):
    """What a job made of it is not stored, and nothing further is begun."""
    write_study(tmp_path)
    keywords = {"problem": f"{tmp_path}/spring.py", "options": {"raising": raising}, "store": tmp_path / "s.db"}
    with pytest.raises(KeyboardInterrupt):
        hb.sweep(f"{tmp_path}/jobs.py:swallowing", {"k": [1.0, 3.0, 4.0]}, workers=0, **keywords)
    data = read(tmp_path / "s.db")
    assert data["k"].values.tolist() == [1.0] and not data["failed"].values.any()


def test_resuming_does_only_what_is_missing(tmp_path):
    path, store = write_study(tmp_path), tmp_path / "s.db"
    first = run(path, store=store)
    with pytest.raises(hb.ModelError, match="exists, with 40 of 40 points finished"):
        run(path, store=store)
    again = run(path, store=store, resume=True)
    assert again.equals(first)  # also the times of finishing


def test_changes_are_refused(tmp_path):
    path, store = write_study(tmp_path), tmp_path / "s.db"
    first = run(path, store=store)
    with pytest.raises(hb.ModelError, match="other options of the job"):
        run(path, store=store, resume=True, options={"wait": 0.001})
    jobs = tmp_path / "jobs.py"
    jobs.write_text(jobs.read_text().replace("multiplied", "changed"))
    with pytest.raises(hb.ModelError, match=r"another job .hash"):
        run(path, store=store, resume=True)
    jobs.write_text(jobs.read_text().replace("changed", "multiplied"))
    path.write_text(path.read_text().replace("5.0]", "5.0, 6.0]"))
    with pytest.raises(hb.ModelError, match=r"other points .40 of k, c, now 48"):
        run(path, store=store, resume=True)
    more = run(path, store=store, resume=True, accept_changes=True)
    assert more.sizes["point"] == 48
    (change,) = json.loads(more.attrs["changes"])
    assert change["what"] == ["other points (40 of k, c, now 48 of k, c)"]
    assert (more["finished"].values < change["accepted"]).sum() == 40
    np.testing.assert_array_equal(more["product"].values, more["k"].values * more["c"].values)
    kept = more.isel(point=more["c"].values < 6)
    np.testing.assert_array_equal(kept["finished"].values, first["finished"].values)


@unix
def test_edited_files_reach_workers_that_outlive_a_study(tmp_path, monkeypatch):
    """Job file, problem file and imported module are edited, to the same length; the pool of the user stays."""
    write_study(tmp_path)
    (tmp_path / "imported_job.py").write_text("def f(system):\n    return {'y': 3.0}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    imported = importlib.import_module("imported_job")
    context = multiprocessing.get_context("spawn")
    with cf.ProcessPoolExecutor(1, mp_context=context) as pool:
        for keywords in ({"executor": pool}, {"workers": 0}):
            for factor in ("2", "3"):
                (tmp_path / "job.py").write_text(f"def f(system):\n    return {{'y': {factor} * system.values['k']}}\n")
                for k in ("1.0", "2.0"):
                    text = (tmp_path / "spring.py").read_text()
                    (tmp_path / "p.py").write_text(text.replace('"k", 2.0', f'"k", {k}'))
                    data = hb.sweep(f"{tmp_path}/job.py:f", {"c": [1.0]}, problem=f"{tmp_path}/p.py", **keywords)
                    assert data["y"].item() == float(factor) * float(k)
        problem = f"{tmp_path}/spring.py"
        assert hb.sweep(imported.f, {"c": [1.0]}, problem=problem, executor=pool)["y"].item() == 3.0
        (tmp_path / "imported_job.py").write_text("def f(system):\n    return {'y': 14.0}\n")
        importlib.reload(imported)
        assert hb.sweep(imported.f, {"c": [1.0]}, problem=problem, executor=pool)["y"].item() == 14.0


def test_functions_without_a_file_are_told_apart(tmp_path):
    """By code, constants, defaults and what they close over; the same function typed again is the same."""

    def typed(text):
        space = {}
        exec(text, space)
        return space["f"]

    def closed(factor):
        return lambda system: {"y": factor}

    for k, (old, same, others) in enumerate(
        [
            (
                typed("def f(s): return {'y': 1.0}"),
                typed("def f(s): return {'y': 1.0}"),
                [typed("def f(s): return {'y': 2.0}"), typed("def f(s, a=1): return {'y': 1.0}")],
            ),
            (closed(1.0), closed(1.0), [closed(2.0)]),
        ]
    ):
        keywords = {"problem": "bautin", "store": tmp_path / f"{k}.db", "resume": True, "workers": 0}
        hb.sweep(old, {"a": [1.0]}, **keywords)
        hb.sweep(same, {"a": [1.0]}, **keywords)
        for other in others:
            with pytest.raises(hb.ModelError, match="another job"):
                hb.sweep(other, {"a": [1.0]}, **keywords)


def test_changed_arrays_among_the_options_are_refused(tmp_path):
    """Also in what text leaves out or rounds."""
    array, store = np.arange(3000.0), tmp_path / "s.db"
    write_study(tmp_path)

    def go(weight):
        given = {"name": "y", "value": 1.0, "weight": weight}
        (tmp_path / "w.py").write_text("def f(system, name, value, weight):\n    return {name: value}\n")
        keywords = {"problem": f"{tmp_path}/spring.py", "store": store, "resume": True, "workers": 0}
        return hb.sweep(f"{tmp_path}/w.py:f", {"k": [1.0]}, options=given, **keywords)

    go(array)
    go(array.copy())
    for place, change in ((1500, 1e9), (1, 1e-9)):
        other = array.copy()
        other[place] += change
        with pytest.raises(hb.ModelError, match=r"other options of the job .*e\+00 \.\.\. .*\(hash"):
            go(other)


def test_fingerprints_distinguish_arrays_that_print_alike():
    @dataclass(frozen=True)
    class Measured:
        values: object

    def measured(place, kind):
        array = np.arange(3000.0)
        array[place] = -1.0
        return options_text({"weight": kind(array)})

    for kind in (Measured, lambda a: {"deep": [a]}, casadi.DM, lambda a: a.astype(object), pandas.Series):
        assert measured(1500, kind) == measured(1500, kind) != measured(1501, kind)
    x = casadi.SX.sym("x")
    assert options_text({"a": x**2}) == options_text({"a": x**2}) != options_text({"a": x**3})
    assert options_text({"b": np.float64(2.5), "a": np.int64(3)}) == '{"a": 3, "b": 2.5}'


def test_text_that_no_file_can_hold(tmp_path):
    """As of a file name whose bytes are no text: in the status of a failure, in a status given, in an output."""
    write_study(tmp_path)
    (tmp_path / "odd.py").write_text(
        "def f(system):\n"
        "    if system.values['k'] > 1: raise OSError('no file \\udcff')\n"
        "    return {'name': 'a\\udcff', 'status': 'read \\udcff'}\n"
    )
    data = hb.sweep(
        f"{tmp_path}/odd.py:f", {"k": [1.0, 2.0]}, problem=f"{tmp_path}/spring.py", store=tmp_path / "s.db", workers=0
    )
    assert data["failed"].values.tolist() == [False, True] and data["name"].values[0] == "a\\udcff"
    assert data["status"].values.tolist() == ["read \\udcff", "OSError: no file \\udcff"]
    for ending in ("nc", "csv"):
        export(data, tmp_path / f"s.{ending}")


def test_a_changed_problem_is_refused(tmp_path):
    """The equations count, not the text: comments may change."""
    write_study(tmp_path)
    store, points = tmp_path / "s.db", {"k": [1.0, 2.0]}

    def go(name):
        return hb.sweep(
            f"{tmp_path}/jobs.py:product", points, problem=f"{tmp_path}/{name}", store=store, resume=True, workers=0
        )

    text = (tmp_path / "spring.py").read_text()
    (tmp_path / "comment.py").write_text("# a comment\n" + text)
    (tmp_path / "other.py").write_text(text.replace("c * x.dot", "1.01 * c * x.dot"))
    go("spring.py")
    assert go("comment.py").sizes["point"] == 2
    with pytest.raises(hb.ModelError, match=r"another problem .hash"):
        go("other.py")


def test_failed_points_are_tried_again_when_asked(tmp_path):
    write_study(tmp_path)
    job, store = tmp_path / "flaky.py", tmp_path / "s.db"
    job.write_text(
        "import pathlib\ndef f(system):\n    return {'y': float(pathlib.Path(__file__).with_name('n').read_text())}\n"
    )
    keywords = {"problem": f"{tmp_path}/spring.py", "store": store, "workers": 0}
    first = hb.sweep(f"{job}:f", {"k": [1.0, 2.0]}, **keywords)
    assert first["failed"].values.all() and "FileNotFoundError" in str(first["status"].values[0])
    (tmp_path / "n").write_text("7")
    assert hb.sweep(f"{job}:f", {"k": [1.0, 2.0]}, resume=True, **keywords)["failed"].values.all()
    again = hb.sweep(f"{job}:f", {"k": [1.0, 2.0]}, resume=True, retry_failed=True, **keywords)
    assert again["y"].values.tolist() == [7.0, 7.0]


@contextmanager
def as_nobody():
    """Root may write everywhere: give that up for a while."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@unix
def test_read_only_directory(tmp_path, monkeypatch):
    """Nothing is computed; the directory holds nothing afterwards."""
    path, closed = write_study(tmp_path), tmp_path / "closed"
    closed.mkdir()
    for folder in (tmp_path, *tmp_path.parents):
        if Path(tempfile.gettempdir()) in folder.parents:  # for another user to get there
            folder.chmod(0o755)
    wanted = load_study(path)
    closed.chmod(0o555)
    monkeypatch.chdir(tmp_path)
    with as_nobody(), pytest.raises(hb.ModelError, match="read-only"):
        Store.create(Path("closed") / "s.db", wanted.points, {})
    closed.chmod(0o755)
    assert list(closed.iterdir()) == []
    with pytest.raises(hb.ModelError, match=r"does not exist; make it|unable to open"):
        run(path, store=tmp_path / "nowhere" / "s.db")


@unix
def test_full_disk_stops_before_work_starts(tmp_path):
    """A limit on the size of files is a full disk to SQLite."""
    path, store = write_study(tmp_path), tmp_path / "s.db"
    code = f"""
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
import hbbogie as hb
from hbbogie.studies import load_study
w = load_study({str(path)!r})
try:
    hb.sweep(w.job, w.points, problem=w.problem, store={str(store)!r}, workers=0)
except hb.ModelError as error:
    print(error)
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert "the disk is full" in out.stdout and "finished before" not in out.stdout, out.stderr
    assert not {p.name for p in tmp_path.iterdir() if p.name.startswith("s.db")} - {"s.db.lock"}


@unix
def test_full_disk_leaves_no_part_of_an_export(tmp_path):
    """And what was there before stays."""
    write_study(tmp_path)
    names = [f"out.{ending}" for ending in ("nc", "csv", "parquet", "html")]
    for name in names:
        (tmp_path / name).write_text("before")
    code = f"""
import resource
import hbbogie as hb
from hbbogie import studies
from hbbogie.reports import report_of, write_html
points = studies.random({{"k": (1.0, 2.0), "c": (1.0, 2.0)}}, 1000)
data = hb.sweep({f"{tmp_path}/jobs.py:product"!r}, points, problem={f"{tmp_path}/spring.py"!r}, workers=0)
report = report_of(data, "full" * 2000)
resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000))
for name in {names!r}:
    try:
        if name.endswith("html"):
            write_html(report, {str(tmp_path)!r} + "/" + name)
        else:
            studies.export(data, {str(tmp_path)!r} + "/" + name)
    except hb.ModelError as error:
        print(error)
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert out.returncode == 0 and out.stdout.count("cannot write") == 4, out.stdout + out.stderr
    assert {p.name for p in tmp_path.glob("out*")} == set(names)
    assert all((tmp_path / name).read_text() == "before" for name in names)


def test_what_is_no_store(tmp_path):
    with pytest.raises(hb.ModelError, match="no study"):
        Store.read(tmp_path / "s.db")
    (tmp_path / "text.db").write_text("no database, but long enough to be read as a header of one " * 3)
    with pytest.raises(hb.ModelError, match=r"not a database|not the store"):
        Store.read(tmp_path / "text.db")
    points = grid({"a": [1.0]})
    (tmp_path / "new.db.part").write_text("what a process left that was killed before it had made its store")
    Store.create(tmp_path / "new.db", points, {}).close()
    with pytest.raises(hb.ModelError, match="exists"):
        Store.create(tmp_path / "new.db", points, {})


@unix
def test_finished_store_is_one_file_that_can_be_read_anywhere(tmp_path):
    """Also where nothing can be written beside it."""
    path, store = write_study(tmp_path), tmp_path / "shelf" / "s.db"
    store.parent.mkdir()
    first = run(path, store=store)
    assert {p.name for p in store.parent.iterdir()} == {"s.db", "s.db.lock"}
    store.chmod(0o444)
    store.parent.chmod(0o555)
    for folder in (tmp_path, *tmp_path.parents):
        if Path(tempfile.gettempdir()) in folder.parents:
            folder.chmod(0o755)
    with as_nobody():
        assert read(store).equals(first)
        with pytest.raises(hb.ModelError, match="read-only"):
            Store.open(store)
    store.parent.chmod(0o755)


@unix
def test_dask_cluster_that_loses_a_worker_and_is_interrupted(tmp_path, truth):
    """A scheduler and two workers, started by hand on loopback; one of them is killed in the midst of it."""
    path, store, where = write_study(tmp_path, wait=0.1), tmp_path / "s.db", tmp_path / "scheduler.json"
    nothing = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    loopback = ("--host", "127.0.0.1", "--no-dashboard")
    cluster = [process("dask", "scheduler", "--port", 0, "--scheduler-file", where, *loopback, **nothing)]
    try:
        wait_for(lambda: where.exists() and where.read_text().strip().endswith("}"), "the scheduler")
        address = json.loads(where.read_text())["address"]
        study = process("hbbogie", "study", "run", path, "--store", store, "--scheduler", address)
        assert any("no worker has joined" in line for line in iter(study.stderr.readline, ""))
        worker = ("dask", "worker", "--scheduler-file", where, "--nthreads", 1, "--no-nanny", *loopback)
        cluster += [process(*worker, **nothing) for _ in range(2)]
        wait_for(lambda: len(_workers(store)) == 2 and finished(store) >= 8, "both workers")
        cluster[1].kill()
        out, err = study.communicate(timeout=90)
        assert study.returncode == 0, err
        slow = write_study(tmp_path, wait=0.5)
        study = process("hbbogie", "study", "run", slow, "--store", tmp_path / "t.db", "--scheduler", address)
        wait_for(lambda: finished(tmp_path / "t.db") >= 2, "two points")
        before = finished(tmp_path / "t.db")
        study.send_signal(signal.SIGINT)  # what runs comes down, what only waits for a worker is not begun
        _, err = study.communicate(timeout=30)
        assert study.returncode == 130 and f"--scheduler {address} --resume" in err
        assert before < finished(tmp_path / "t.db") < 16
    finally:
        for one in cluster[::-1]:
            one.kill()
            one.wait()
    data = read(store)
    assert data[NAMES].equals(truth[NAMES]) and len(set(data["worker"].values)) == 2, out


def _workers(store):
    return set(read(store)["worker"].values) if finished(store) else set()
