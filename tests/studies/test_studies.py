"""Points, jobs, the verb `sweep`, and what is made of its results."""

from __future__ import annotations

import concurrent.futures as cf
import functools
import html
import json
import multiprocessing
import os
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from small_studies import process, write_study

import hbbogie as hb
from hbbogie import plot, studies
from hbbogie.errors import ModelError
from hbbogie.exact import at_grazing, follow
from hbbogie.reports import report_of, write_html
from hbbogie.reports.study import _most_correlated
from hbbogie.studies import (
    Scaled,
    exceedance,
    independent,
    named_distribution,
    prediction,
    smallest_critical,
    sobol_indices,
)
from hbbogie.units import unit_factor


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("studies")
    write_study(path)
    return path


def sweep(folder, job, points, **keywords):
    return hb.sweep(
        f"{folder / 'jobs.py'}:{job}", points, problem=str(folder / "spring.py"), **{"workers": 0, **keywords}
    )


class TestPoints:
    def test_latin_hypercube_has_one_point_in_each_stratum(self):
        points = studies.latin_hypercube({"a": (2.0, 4.0), "b": stats.norm(0, 1)}, 50, seed=3)
        strata = (
            np.sort(np.floor(50 * (points.values[:, 0] - 2) / 2)),
            np.sort(np.floor(50 * stats.norm.cdf(points.values[:, 1]))),
        )
        for found in strata:
            np.testing.assert_array_equal(found, np.arange(50))

    def test_sobol_sequence_is_balanced(self):
        """Of 2^m points each dimension has one in each of 2^m intervals, and each pair of halves a quarter."""
        points = studies.sobol({"a": (0.0, 1.0), "b": (0.0, 1.0), "c": (0.0, 1.0)}, 64, seed=2)
        for column in points.values.T:
            np.testing.assert_array_equal(np.sort(np.floor(64 * column)), np.arange(64))
        assert np.count_nonzero((points.values[:, 0] < 0.5) & (points.values[:, 1] < 0.5)) == 16

    def test_random_points_follow_their_distribution(self):
        law = named_distribution("triangular", {"low": 1.0, "mode": 2.0, "high": 5.0})
        points = studies.random({"a": law}, 2000, seed=1)
        assert stats.kstest(points.values[:, 0], law.cdf).pvalue > 1e-3

    def test_the_seed_makes_the_points(self):
        for make in (studies.random, studies.sobol, studies.latin_hypercube, studies.saltelli):
            a, b, other = (make({"a": (0.0, 1.0), "b": (0.0, 1.0)}, 8, seed=s).values for s in (5, 5, 6))
            np.testing.assert_array_equal(a, b)
            assert (a != other).any()

    @pytest.mark.parametrize(
        ("kind", "values", "share", "quantile"),
        [
            ("uniform", {"low": 2.0, "high": 6.0}, 0.25, 3.0),
            ("normal", {"mean": 5.0, "deviation": 2.0}, stats.norm.cdf(1.0), 7.0),
            ("lognormal", {"median": 3.0, "deviation": 0.2}, stats.norm.cdf(-1.0), 3 * np.exp(-0.2)),
            ("truncated_normal", {"mean": 5.0, "deviation": 2.0, "low": 4.0, "high": 6.0}, 0.5, 5.0),
            ("triangular", {"low": 0.0, "mode": 1.0, "high": 2.0}, 0.125, 0.5),
            ("weibull_min", {"c": 1.0, "scale": 2.0}, 1 - np.exp(-1), 2.0),
        ],
    )
    def test_quantiles(self, kind, values, share, quantile):
        assert named_distribution(kind, values).ppf(share) == pytest.approx(quantile, rel=1e-12)

    def test_units_with_prefixes(self):
        assert unit_factor("MN/m", "N/m", "K") == 1e6
        assert unit_factor("kg", "kg", "M") == 1.0 and unit_factor("g", "kg", "M") == 1e-3
        assert unit_factor("mm", "m", "y") == 1e-3 and unit_factor("m", "m", "y") == 1.0
        assert Scaled(stats.uniform(1, 2), 1e6).ppf(0.5) == 2e6
        with pytest.raises(hb.ModelError, match="allowed is its own, 'N/m'"):
            unit_factor("N", "N/m", "K")

    def test_grid_list_and_file(self, tmp_path):
        grid = studies.grid({"a": [1, 2], "b": [3, 4, 5]})
        assert [grid.point(i) for i in (0, 1, 3)] == [{"a": 1, "b": 3}, {"a": 1, "b": 4}, {"a": 2, "b": 3}]
        path = tmp_path / "points.csv"
        path.write_text("a [m],b\n1,3\n2,4\n")
        read = studies.from_csv(path)
        assert read.names == ("a", "b") and read.values.tolist() == [[1, 3], [2, 4]]
        path.write_text("a,b,a\n1,3,1\n")
        with pytest.raises(hb.ModelError, match="line 1: 'a' has more than one column"):
            studies.from_csv(path)
        path.write_text("a,b\n1,3\n2,x\n")
        with pytest.raises(hb.ModelError, match="line 3"):
            studies.from_csv(path)

    def test_units_in_the_header_of_a_file(self, folder, tmp_path):
        """N/m and N s/m are the parameters' own."""
        path = tmp_path / "points.csv"
        path.write_text("k [kN/m],c [mN s/m]\n0.003,500\n0.05,250\n")
        data = sweep(folder, "product", studies.from_csv(path))
        np.testing.assert_allclose(data["k"].values, [3.0, 50.0], rtol=1e-15)
        np.testing.assert_allclose(data["product"].values, [1.5, 12.5], rtol=1e-15)
        for header, message in (
            ("k [kg]", "got the unit 'kg'; allowed is its own, 'N/m'"),
            ("k [MN/m]", "from 0 to 100"),
        ):
            path.write_text(f"{header}\n1\n")
            with pytest.raises(hb.ModelError, match=message):
                sweep(folder, "product", studies.from_csv(path))

    def test_whole_numbers_given_as_floats(self):
        for make in (studies.random, studies.sobol, studies.latin_hypercube, studies.saltelli):
            ranges = {"a": (0.0, 1.0), "b": (0.0, 1.0)}
            np.testing.assert_array_equal(make(ranges, 16.0).values, make(ranges, 16).values)
            with pytest.raises(hb.ModelError, match="no parameter"):
                make({}, 4)
            with pytest.raises(hb.ModelError, match="at least 1"):
                make(ranges, 2.5)

    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda: studies.grid({}), "no parameter"),
            (lambda: studies.listed([{"a": 1}, {"b": 2}]), "point 1 names b"),
            (lambda: studies.random({"a": (2.0, 1.0)}, 5), "low < high"),
            (lambda: studies.sobol({"a": (0.0, 1.0)}, 0), "at least 1"),
            (lambda: studies.saltelli({"a": (0.0, 1.0)}, 6), "power of two"),
            (lambda: studies.sobol({"a": (0.0, 1.0)}, -4), "at least 1"),
            (lambda: studies.sobol({"a": (0.0, 1.0)}, "x"), "at least 1"),
            (lambda: studies.random({"a": (0.0, 1.0)}, 4, seed=-1), "seed = -1"),
            (lambda: studies.grid({"a": ["x", 1.0]}), "give a list of numbers"),
            (lambda: studies.grid({"a": [[1.0], [2.0, 3.0]]}), "give a list of numbers"),
            (lambda: studies.listed([{"a": "x"}]), "'a' is 'x'"),
            (lambda: studies.listed([{"a": None}]), "'a' is None"),
            (lambda: studies.listed([3]), "point 0 is 3"),
            (lambda: studies.around(hb.load_problem("bautin").SYSTEM(), -0.1), "above 0"),
            (lambda: named_distribution(3, {}), "distribution = 3; give a name"),
            (lambda: named_distribution("norml", {}), "Did you mean 'normal'"),
            (lambda: named_distribution("normal", {"mean": 1.0}), "give mean, deviation"),
            (lambda: named_distribution("normal", {"mean": 1.0, "deviation": -1.0}), "no finite quantiles"),
        ],
    )
    def test_wrong_points(self, make, message):
        with pytest.raises(hb.ModelError, match=message):
            make()

    def test_ranges_about_the_values_of_a_system(self, bogie):
        ranges = studies.around(bogie, 0.2)
        assert "W" not in ranges and ranges["K1"] == pytest.approx((2.4e6, 3.6e6))


class TestSweep:
    def test_result_is_labelled(self, folder):
        data = sweep(folder, "product", {"k": [1.0, 2.0], "c": [3.0, 4.0]})
        np.testing.assert_array_equal(data["product"].values, [3, 4, 6, 8])
        assert data["product"].attrs["units"] == "N2 s/m2" and data["k"].attrs == {
            "units": "N/m",
            "long_name": "stiffness",
        }
        assert data["status"].values.tolist() == ["multiplied"] * 4 and not data["failed"].values.any()
        assert json.loads(data.attrs["nominal_outputs"])["product"] == 2.0
        assert {"numpy", "casadi", "hbbogie"} <= set(json.loads(data.attrs["versions"]))
        assert len(data.attrs["problem_hash"]) == 16

    def test_failures_are_rows(self, folder):
        data = sweep(folder, "picky", [{"k": 1.0, "c": 1.0}, {"k": 4.0, "c": 1.0}, {"k": 1.0, "c": 4.0}])
        assert data["failed"].values.tolist() == [False, True, True]
        assert data["status"].values.tolist() == ["done", "ValueError: too stiff", "undecided"]
        np.testing.assert_array_equal(data["y"].values, [np.nan, np.nan, 1.0])

    def test_every_executor_gives_the_same_in_any_order(self, folder):
        points = [{"k": 1 + 0.1 * i, "c": 2.0} for i in range(12)]
        here = sweep(folder, "product", points)
        names = ["product", "third", "name", "status"]
        with cf.ThreadPoolExecutor(2) as threads:
            other = sweep(folder, "product", points[::-1], workers=None, executor=threads)
        assert here[names].equals(other[names].isel(point=slice(None, None, -1)).assign_coords(point=here["point"]))
        pool = sweep(folder, "product", points, workers=2)
        assert here[names].equals(pool[names])
        assert len(set(pool["worker"].values)) <= 2 and pool["worker"].values[0] != here["worker"].values[0]

    def test_a_point_that_kills_its_worker_is_a_failed_row(self, folder):
        data = sweep(folder, "deadly", {"k": [1.0, 2.0, 3.0, 4.0, 5.0]}, workers=2)
        assert data["failed"].values.tolist() == [False, False, True, False, False]
        assert "the worker process died" in str(data["status"].values[2])
        np.testing.assert_array_equal(data["y"].values, [1, 2, np.nan, 4, 5])

    @pytest.mark.slow
    def test_many_points_that_kill_their_workers_in_a_row(self, folder):
        k = [1.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 2.0]
        data = sweep(folder, "deadlier", {"k": k}, workers=2)
        assert data["failed"].values.tolist() == [v > 3 for v in k]

    @pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such timer")
    @pytest.mark.parametrize("workers", [0, 2])
    def test_a_job_that_hangs_is_a_failed_row(self, folder, workers):
        data = sweep(folder, "hanging", {"k": [1.0, 3.0, 4.0, 3.0, 5.0]}, workers=workers, limit=1.0)
        assert data["failed"].values.tolist() == [False, True, False, True, False]
        assert str(data["status"].values[1]) == "the time limit of 1 s for a point is over"
        data = sweep(folder, "stubborn", {"k": [1.0]}, workers=workers, limit=0.2)
        assert str(data["status"].values[0]) == "the time limit of 0.2 s for a point is over"
        with pytest.raises(hb.ModelError, match="limit: got -1"):
            sweep(folder, "hanging", {"k": [1.0]}, limit=-1)

    @pytest.mark.parametrize("workers", [0, 1])
    def test_a_job_that_exits_is_a_failed_row(self, folder, workers):
        k = [1.0, 3.0] if workers == 0 else [1.0, 3.0, 4.0]  # in this process KeyboardInterrupt is Ctrl-C
        data = sweep(folder, "leaving", {"k": k}, workers=workers)
        assert data["failed"].values.tolist() == [False, True, True][: len(k)]
        assert data["status"].values[1] == "SystemExit: enough"

    @pytest.mark.parametrize(
        ("name", "value", "message"),
        [
            *[(n, 1.0, f"output '{n}', which is the name of what") for n in ("point", "seconds", "finished", "worker")],
            ("k", 1.0, "output 'k', which is the name of an input"),
            ("status", 1.0, "status is a sentence"),
            ("failed", "yes", "give True or False"),
            ("y", [1.0], "of type list; return numbers"),
            (3, 1.0, "an output named 3"),
            *[(n, 1.0, "which NetCDF cannot hold") for n in ("peak/left", "", ".", "a\nb", "\udcff")],
        ],
    )
    def test_invalid_outputs_are_refused_at_once(self, folder, tmp_path, name, value, message):
        options = {"name": name, "value": value}
        with pytest.raises(hb.ModelError, match=message):
            sweep(folder, "named", {"k": [1.0]}, options=options, store=tmp_path / "s.db")
        assert not (tmp_path / "s.db").exists()
        with pytest.raises(hb.ModelError, match="returned NoneType; return a dict"):
            sweep(folder, "nothing", {"k": [1.0]})

    @pytest.mark.parametrize(
        ("job", "options", "message"),
        [
            ("product", {"wiat": 0.0}, "unknown option 'wiat'. Did you mean 'wait'"),
            ("linear", {"a": 1}, r"unknown option 'a'. Allowed: \(none\)"),
            ("needy", {}, "job needy needs the option 'share'"),
            ("alone", {}, "job alone takes no system"),
        ],
    )
    def test_options_are_checked(self, folder, job, options, message):
        with pytest.raises(hb.ModelError, match=message):
            sweep(folder, job, {"k": [1.0]}, options=options)

    def test_options_of_a_shipped_job_are_checked_before_it_starts(self, tmp_path):
        with pytest.raises(
            hb.ModelError, match=r"got 'exct'; give one of 'auto', 'exact', 'mhb', 'collocation', 'batch'"
        ):
            options, store = {"method": "exct"}, tmp_path / "s.db"
            hb.sweep("critical", {"a": [1.0]}, problem="bautin", options=options, store=store, workers=0)
        assert not (tmp_path / "s.db").exists()

    def test_script_without_a_main_guard_is_refused(self, folder, tmp_path):
        """Workers import the script; one that sweeps again when it is imported would never end."""
        call = (
            f"hb.sweep({str(folder / 'jobs.py') + ':product'!r}, {{'k': [1.0]}}, problem={str(folder / 'spring.py')!r})"
        )
        (tmp_path / "script.py").write_text(f"import hbbogie as hb\nprint({call}['product'].values)\n")
        run = process("script", cwd=tmp_path)
        out, err = run.communicate(timeout=60)
        assert (
            run.returncode == 1 and out == "" and 'In a script, put the call below: if __name__ == "__main__":' in err
        )
        own = "class A:\n    pass\ndef f(system, a=A, b={'c': {'d', 'e', 'f'}}):\n    return {'product': a.__name__}\n"
        text = f"import hbbogie as hb\n{own}if __name__ == '__main__':\n    print({call}['product'].values)\n"
        (tmp_path / "script.py").write_text(text.replace(repr(str(folder / "jobs.py") + ":product"), "f"))
        out, err = process("script", cwd=tmp_path).communicate(timeout=60)
        assert out == "['A']\n", err
        text = f"import hbbogie as hb\nif __name__ == '__main__':\n    print({call}['product'].values)\n"
        (tmp_path / "script.py").write_text(text)
        out, err = process("script", cwd=tmp_path).communicate(timeout=60)
        assert out == "[1.]\n", err

    @pytest.mark.parametrize("has_cloudpickle", [True, False])
    def test_a_function_that_is_in_no_file(self, folder, has_cloudpickle):
        """Typed in: worker processes cannot import it; it is sent by value, or refused before anything runs."""
        if has_cloudpickle:
            pytest.importorskip("cloudpickle")
        code = f"""
import importlib.util
import hbbogie as hb
def twice(system):
    return {{"y": 2 * system.values["k"]}}
if not {has_cloudpickle}:
    find = importlib.util.find_spec
    importlib.util.find_spec = lambda name, *more: None if name == "cloudpickle" else find(name, *more)
try:
    print(hb.sweep(twice, {{"k": [1.0, 4.0]}}, problem={str(folder / "spring.py")!r}, workers=1)["y"].values.tolist())
except hb.ModelError as error:
    print(error)
"""
        out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        expected = "[2.0, 8.0]" if has_cloudpickle else "at the top level of a file, or run with workers=0"
        assert expected in out.stdout, out.stderr

    @pytest.mark.parametrize(
        ("job", "points", "message"),
        [
            ("product", {"kk": [1.0]}, "unknown parameter 'kk'"),
            ("product", {"k": [200.0]}, "from 0 to 100"),
            ("produkt", {"k": [1.0]}, "Did you mean 'product'"),
        ],
    )
    def test_wrong_input(self, folder, job, points, message):
        with pytest.raises(hb.ModelError, match=message):
            sweep(folder, job, points)

    @pytest.mark.parametrize(
        ("points", "keywords", "message"),
        [
            (5, {}, "points: got 5"),
            (None, {}, "points: got None"),
            ({"k": [1.0]}, {"workers": -1}, "workers .*got -1;"),
            ({"k": [1.0]}, {"workers": 1.5}, "workers .*got 1.5;"),
            ({"k": [1.0]}, {"workers": None, "executor": 3}, "executor = 3"),
        ],
    )
    def test_wrong_arguments(self, folder, points, keywords, message):
        with pytest.raises(hb.ModelError, match=message):
            sweep(folder, "product", points, **keywords)

    def test_an_executor_that_was_shut_down(self, folder):
        finished, broken = cf.ThreadPoolExecutor(1), cf.ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
        finished.shutdown()
        with pytest.raises(cf.BrokenExecutor):
            broken.submit(os._exit, 1).result()
        for executor in (finished, broken):
            with pytest.raises(hb.ModelError, match="the executor was shut down or lost its workers"):
                sweep(folder, "product", {"k": [1.0]}, workers=None, executor=executor)

    def test_no_function(self, folder):
        for job in (functools.partial(_root), 3):
            with pytest.raises(hb.ModelError, match=r"of type (partial|int); give a"):
                hb.sweep(job, {"k": [1.0]}, problem=str(folder / "spring.py"), workers=0)

    def test_unknown_jobs(self, folder):
        for job, message in (("critcal", "Did you mean 'critical'"), ("nofile.py:f", "no file")):
            with pytest.raises(hb.ModelError, match=message):
                hb.sweep(job, {"k": [1.0]}, problem=str(folder / "spring.py"), workers=0)

    def test_a_function_and_a_system(self):
        """Without a file: a system made in the script and a function of it."""
        x, k = hb.Coordinate("x", "m"), hb.Parameter("k", 2.0, "N/m")
        data = hb.sweep(_root, {"k": [4.0, 9.0]}, problem=hb.System("spring", [x], [k], [x.ddot + k * x]), workers=0)
        np.testing.assert_allclose(data["omega"].values, [2.0, 3.0], rtol=1e-15)


def _root(system):
    return {"omega": float(np.sqrt(system.values["k"]))}


class TestStatistics:
    def test_sobol_indices_of_the_ishigami_function(self):
        """Closed form for sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 over (-pi, pi)^3."""
        names = [hb.Parameter(n, 0.0) for n in ("x1", "x2", "x3")]
        x = hb.Coordinate("x")
        system = hb.System("three numbers", [x], names, [x.ddot + x + sum(names)])
        span = (-np.pi, np.pi)
        points = studies.saltelli({"x1": span, "x2": span, "x3": span}, 512, seed=1)
        data = hb.sweep(_ishigami, points, problem=system, workers=0)
        found, again = sobol_indices(data, "y"), sobol_indices(data, "y")
        np.testing.assert_array_equal(found.total_error, again.total_error)  # the same at every report
        assert found.unsettled == ("x3",)  # which does nothing alone, so that its first index is 0
        a, b = 7.0, 0.1
        v1, v2, v13 = (1 + b * np.pi**4 / 5) ** 2 / 2, a**2 / 8, 8 * b**2 * np.pi**8 / 225
        total = v1 + v2 + v13
        # the errors are half widths at 95 %; three of them is twelve standard deviations over two
        assert (np.abs(found.first - np.array([v1, v2, 0]) / total) <= 3 * found.first_error + 1e-12).all()
        assert (np.abs(found.total - np.array([v1 + v13, v2, v13]) / total) <= 3 * found.total_error).all()
        assert found.used == 512 and found.dropped == 0 and (found.first_error < 0.15).all()

    def test_confidence_interval_covers(self):
        """Exact: the chance that the interval holds the true probability is at least its level."""
        for n, p in ((20, 0.05), (50, 0.3), (200, 0.01)):
            covered = 0.0
            for k in range(n + 1):
                e = exceedance(np.r_[np.ones(k), np.zeros(n - k)], 0.5, confidence=0.9)
                covered += stats.binom.pmf(k, n, p) * (e.low <= p <= e.high)
            assert covered >= 0.9

    def test_independent_points_of_saltelli(self):
        """Two points of a block differ in every input; any other has something in common with one of the two."""
        x, parameters = hb.Coordinate("x"), [hb.Parameter(n, 0.0) for n in "abc"]
        system = hb.System("three numbers", [x], parameters, [x.ddot + x + sum(parameters)])
        points = studies.saltelli(dict.fromkeys("abc", (0.0, 1.0)), 8, seed=1)
        result = hb.sweep(_ishigami, points, problem=system, workers=0)
        chosen = points.values[independent(result)]
        assert len(chosen) == 16 and all(len(np.unique(column)) == 16 for column in chosen.T)
        assert all(len(np.unique(column)) == 16 for column in points.values.T)

    def test_exceedance_counts(self):
        below = exceedance([1.0, 2.0, 3.0, np.nan], 2.5, above=False)
        assert (below.count, below.total, below.probability) == (2, 3, 2 / 3)
        infinite = exceedance([1.0, np.inf, -np.inf, np.inf, np.nan], 2.5)
        assert (infinite.count, infinite.total) == (2, 4)
        with pytest.raises(hb.ModelError, match="no value"):
            exceedance([np.nan], 0.0)

    def test_gradient_predicts_a_linear_job_exactly(self, folder):
        data = sweep(folder, "linear", studies.random({"k": (1.0, 9.0), "c": (0.0, 5.0)}, 30, seed=1))
        p = prediction(data, "y")
        assert p.nominal == 5.0 and p.worst < 1e-12 and p.explained == pytest.approx(1.0, abs=1e-12)

    def test_indices_need_their_points(self, folder):
        data = sweep(folder, "linear", {"k": [1.0, 2.0]})
        with pytest.raises(hb.ModelError, match="saltelli"):
            sobol_indices(data, "y")
        with pytest.raises(hb.ModelError, match=r"Did you mean 'dy_dk'|unknown output"):
            prediction(data, "dy_dkk")


def _ishigami(system):
    x1, x2, x3 = system.values.values()
    return {"y": np.sin(x1) + 7 * np.sin(x2) ** 2 + 0.1 * x3**4 * np.sin(x1)}


class TestCritical:
    def test_random_bogies_against_the_exact_branch(self, bogie):
        """Two methods and two walks along the whole branch; the error of the fold is a bound."""
        names = [n for n in bogie.values if n != "V"]
        points = studies.latin_hypercube(studies.around(bogie, 0.3, names), 4, seed=8)
        for i in range(4):
            system = bogie.with_parameters(**points.point(i))
            row = smallest_critical(system, interval=(30.0, 160.0))
            (first, *_) = hb.hopf_points(system, "V", (30.0, 160.0))
            walk = follow(at_grazing(system, first), (30.0, 160.0))
            lowest = min([first.value, *(point.value for point in walk.marked("fold"))])
            assert not row["failed"] and row["complete"] == 1
            assert abs(row["critical"] - lowest) <= row.get("fold_error", 1e-9 * lowest)

    def test_cycles_in_closed_form_give_the_same_rows(self, bogie):
        """Two independent methods; the rows of one are those of the other but for the harmonics left out."""
        points = studies.latin_hypercube(studies.around(bogie, 0.2, ["lam", "K2", "f11", "Mw"]), 4, seed=3)
        options = {"interval": [40.0, 160.0]}
        data = {
            method: hb.sweep("critical", points, problem="yang1995", options=options | more, workers=0)
            for method, more in (("mhb", {"harmonics": 31}), ("batch", {"method": "batch"}))
        }
        assert set(data["mhb"]) - set(data["batch"]) == {"hopfs"} and set(data["batch"]) <= set(data["mhb"])
        assert not data["batch"]["failed"].any()
        for name, tolerance in (("critical", 1e-5), ("hopf", 1e-9), ("fold_omega", 1e-5), ("fold_q1", 1e-4)):
            np.testing.assert_allclose(data["batch"][name], data["mhb"][name], rtol=tolerance)
        for name in ("kind", "folds"):
            assert (data["batch"][name] == data["mhb"][name]).all()
        np.testing.assert_allclose(data["batch"]["dhopf_dlam"], data["mhb"]["dhopf_dlam"], rtol=1e-7)
        np.testing.assert_allclose(data["batch"]["dfold_dlam"], data["mhb"]["dfold_dlam"], rtol=1e-3)
        assert data["batch"]["dfold_dlam"].attrs["units"] == data["mhb"]["dfold_dlam"].attrs["units"]

    def test_no_fold_and_no_hopf_point_are_answers_of_a_batch(self, bogie):
        options = {"interval": [40.0, 160.0], "method": "batch"}
        points = [{"lam": 1e-4}, {"lam": 0.05}]
        rows = hb.sweep("critical", points, problem="yang1995", options=options, workers=0)
        assert not rows["failed"].any() and rows["kind"].values.tolist() == ["", "fold"]
        assert "no Hopf point from 40 to 160" in rows["status"].values[0]
        # at the default parameters there is none: the point is its own beginning
        exact, longer = (
            hb.sweep(
                "critical", [{"lam": 0.15}], problem="yang1995", options={"interval": [20.0, 70.0]} | more, workers=0
            )
            for more in ({"method": "batch"}, {})
        )
        np.testing.assert_allclose(exact["critical"], longer["critical"], rtol=1e-4)

    def test_an_exact_method_needs_straight_lines(self):
        smooth = hb.load_problem("bautin").bautin()
        none = "nothing that switches"
        for method, message in (("exct", "Did you mean 'exact'"), ("exact", none), ("batch", none)):
            with pytest.raises(ModelError, match=message):
                smallest_critical(smooth, "mu", (-2.0, 0.5), method=method)

    def test_bautin_in_closed_form(self):
        data = hb.sweep(
            "critical", {"a": [0.5, 1.0, 2.0]}, problem="bautin", options={"interval": [-2.0, 0.5]}, workers=0
        )
        a = data["a"].values
        np.testing.assert_allclose(data["fold"].values, -(a**2) / 4, rtol=1e-9)
        np.testing.assert_allclose(data["dfold_da"].values, -a / 2, rtol=1e-8)
        np.testing.assert_allclose(data["hopf"].values, 0.0, atol=1e-12)
        assert data["fold"].attrs["units"] == "1/s" and data["dfold_da"].attrs["units"] == "(1/s)/(1/s)"

    def test_no_fold_and_no_hopf_point_are_answers(self):
        options = {"interval": [-0.5, 0.5]}
        none = hb.sweep("critical", [{"a": -1.0}], problem="bautin", options=options, workers=0)
        assert not none["failed"].item() and none["kind"].item() == "hopf"
        assert "no fold from -0.5 to the Hopf point" in none["status"].item() and "fold" not in none
        stable = hb.sweep("critical", [{"a": 1.0}], problem="bautin", options={"interval": [-2.0, -1.0]}, workers=0)
        assert not stable["failed"].item() and "no Hopf point from -2 to -1" in stable["status"].item()

    def test_other_jobs(self):
        """Bautin: radii in closed form, at given mu and along the branch."""
        problem = hb.load_problem("bautin")
        cycles = hb.sweep("cycles", {"mu": [-0.3, -0.1, 0.1]}, problem="bautin", options={"harmonics": 3}, workers=0)
        assert cycles["cycles"].values.tolist() == [0, 2, 1]
        np.testing.assert_allclose(
            cycles["peak_x_1"].values[1:], [problem.radii(mu)[0] for mu in (-0.1, 0.1)], rtol=1e-9
        )
        assert cycles["stability_2"].values.tolist() == ["", "stable", ""]
        options = {"at": [0.1], "harmonics": 3}
        branch = hb.sweep("branch", {"a": [1.0, 0.8]}, problem="bautin", options=options, workers=0)
        np.testing.assert_allclose(
            branch["peak_x_at_0.1"].values, [problem.radii(0.1, a)[-1] for a in (1.0, 0.8)], rtol=1e-9
        )
        np.testing.assert_allclose(branch["fold_1"].values, [-0.25, -0.16], rtol=1e-6)

    def test_comparison_of_a_circle_is_exact(self):
        options = {"methods": ["mhb1"], "truth": "mhb3", "values": [0.1]}
        data = hb.sweep("compare", [{"a": 1.0}], problem="bautin", options=options, workers=0)
        assert data["omega_error_mhb1"].item() < 1e-8 and data["fold_mhb1"].item() == pytest.approx(-0.25, abs=1e-6)


@pytest.fixture(scope="module")
def data():
    points = studies.saltelli({"a": (0.5, 2.0), "w0": (0.5, 2.0)}, 16, seed=1)
    return hb.sweep("critical", points, problem="bautin", options={"interval": [-2.0, 0.5]}, workers=0)


class TestReport:
    def test_html_holds_everything(self, data, tmp_path):
        figures = [
            {"kind": "distribution", "output": "fold", "below": [-0.5]},
            {"kind": "sensitivity", "output": "fold"},
            {"kind": "scatter", "x": "a", "y": "fold", "colour": "w0"},
            {"kind": "parallel", "output": "fold"},
            {"kind": "prediction", "output": "critical"},
            {"kind": "map", "x": "a", "y": "w0", "output": "fold"},
            {"kind": "map", "x": "a", "y": "w0", "output": "nothing"},
        ]
        report = report_of(data, "Bautin & <folds>", (), figures)
        text = write_html(report, tmp_path / "report.html").read_text("utf-8")
        assert text.count("data:image/png;base64,") == 6 and "Bautin &amp; &lt;folds&gt;" in text
        assert "unknown output 'nothing'" in html.unescape(text)
        for link in ("http://", "https://", 'src="/', "<script", "<link"):
            assert link not in text

    def test_infinite_values_are_reported(self, folder):
        data = sweep(folder, "named", {"k": [1.0, 2.0]}, options={"name": "y", "value": float("inf")})
        report = report_of(data, "Infinite")
        (table,) = (t for t in report.tables if t.name == "summary")
        assert "y: 2 infinite values, left out here." in table.notes
        json.dumps(report.as_dict(), allow_nan=False)

    def test_a_figure_that_cannot_be_drawn_leaves_the_rest_of_the_report(self, data, tmp_path):
        figures = [
            {"kind": "scatter", "x": "a", "y": "kind"},  # text
            {"kind": "map", "x": "a", "y": "a", "output": "fold"},  # all on a line
            {"kind": "scatter", "x": "a", "y": "fold"},
        ]
        report = report_of(data, "Bautin", ("fold", "flod"), figures)
        text = write_html(report, tmp_path / "report.html").read_text("utf-8")
        assert text.count("data:image/png;base64,") >= 2 and "unknown output 'flod'" in html.unescape(text)
        assert len(report.write(tmp_path)) >= 2

    def test_sensitivity_of_a_function_of_one_input(self, data):
        """The fold is -a^2 / 4, whatever the frequency."""
        found = sobol_indices(data, "fold")
        assert found.total[1] == pytest.approx(0.0, abs=1e-12) and found.total[0] == pytest.approx(1.0, abs=0.35)

    def test_figures_of_large_forces(self):
        """The distribution stays in the unit that its thresholds are in."""
        data = xr.Dataset({"F": ("point", np.array([1.0, 2.0, 3.0]) * 1e6, {"units": "N"})})
        ax = plot.distribution(data, "F", [(2e6, "allowed")])
        assert ax.get_xlabel() == "F [N]" and ax.get_xlim()[0] < 2e6 < ax.get_xlim()[1]
        assert plot.sample_scatter(data, "F", "F").get_xlabel() == "F [MN]"

    def test_rank_correlation_with_ties_is_by_mid_ranks(self):
        """Spearman's definition: the correlation of ranks, of equal values the mean of the ranks they share."""

        def mid_ranks(u):
            return np.array([np.sum(u < x) + (np.sum(u == x) + 1) / 2 for x in u])

        y = np.repeat([0.0, 1.0], 5)
        inputs = {
            "same": np.ones(10),
            "mixed": np.array([0, 1, 2, 3, 5, 4, 6, 7, 8, 9.0]),  # in order but for two points
            "apart": np.array([4, 3, 2, 1, 0, 9, 8, 7, 6, 5.0]),  # every 0 below every 1
        }
        rho = {name: np.corrcoef(mid_ranks(inputs[name]), mid_ranks(y))[0, 1] for name in ("apart", "mixed")}
        assert rho["apart"] == pytest.approx(np.sqrt(25 / 33)) and rho["mixed"] < rho["apart"]
        columns = {name: ("point", u) for name, u in {**inputs, "y": y}.items()}
        data = xr.Dataset(columns, attrs={"inputs": json.dumps(list(inputs)), "outputs": json.dumps(["y"])})
        assert _most_correlated(data, "y") == ["apart", "mixed", "same"]

    def test_map_of_a_grid_keeps_the_places(self):
        data = hb.sweep(
            "critical",
            {"a": [0.5, 1.0, 2.0], "w0": [0.5, 1.0]},
            problem="bautin",
            options={"interval": [-2.0, 0.5]},
            workers=0,
        )
        ax = plot.parameter_map(data, "a", "w0", "fold")
        assert ax.get_xlim() == pytest.approx((0.5, 2.0)) and "a [1/s]" in ax.get_xlabel()
        assert plot.drawing(ax.figure).startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def points(bogie):
    return studies.random(studies.around(bogie, 0.3, ["lam", "K1", "K2", "D2"]), 12, seed=5)


def exactly(points, **keywords):
    options = {"method": "batch", "interval": [40.0, 160.0]}
    return hb.sweep("critical", points, problem="yang1995", options=options, workers=0, **keywords)


@pytest.fixture(scope="module")
def together(points):
    return exactly(points, batch=5)


class TestBatches:
    def test_points_done_together_and_one_by_one_are_the_same(self, points, together):
        """SOLVER: whatever the batch, and in the function as in the job."""
        alone = exactly(points, batch=1)
        for name in ("critical", "fold", "hopf", "complete", "failed", "fold_q1", "dfold_dlam", "dhopf_dK2"):
            np.testing.assert_allclose(together[name].values, alone[name].values, rtol=1e-8)
        columns = dict(zip(points.names, points.values.T, strict=True))
        system = hb.load_problem("yang1995").bogie()
        found = hb.critical_speeds_of(system, columns, interval=(40.0, 160.0))
        np.testing.assert_allclose(together["critical"].values, found.critical, rtol=1e-9)
        assert (together["complete"].values == found.complete).all()

    def test_a_batch_gives_what_following_the_branches_gives(self, points, together):
        """SOLVER: the folds, their gradients and peaks are those of exact cycles found on the branch."""
        options = {"interval": [40.0, 160.0]}
        rows = hb.sweep("critical", points, problem="yang1995", options=options, workers=0)
        assert rows["complete"].values.all() and rows["fold_error"].values.max() < 1e-6
        for name in ("critical", "fold_q1", "fold_q3", "fold_omega", "hopf", "dfold_dlam", "dfold_dK2", "dhopf_dK1"):
            np.testing.assert_allclose(together[name].values, rows[name].values, rtol=1e-7)

    def test_a_batch_that_fails_is_done_one_by_one(self, points, together, monkeypatch):
        def failing(system, points, **options):
            raise ZeroDivisionError

        monkeypatch.setattr("hbbogie.studies.jobs.BATCHES", {studies.smallest_critical: failing})
        monkeypatch.setattr("hbbogie.studies.tasks.BATCHES", {studies.smallest_critical: failing})
        again = exactly(points, batch=5)
        np.testing.assert_allclose(again["critical"].values, together["critical"].values, rtol=1e-9)

    def test_the_size_of_a_batch_is_a_whole_number(self, points):
        for batch in (0, -1, 1.5, "many", True, np.nan):
            with pytest.raises(hb.ModelError, match="batch"):
                exactly(points, batch=batch)
