"""Linear algebra with one thread inside, and as many as before after."""

from __future__ import annotations

import threading

import pytest
from threadpoolctl import ThreadpoolController

import hbbogie as hb
from hbbogie import studies
from hbbogie.threads import one_blas_thread


def counts() -> set[int]:
    import scipy.linalg  # noqa: F401  # both libraries are loaded

    return {library.num_threads for library in ThreadpoolController().select(user_api="blas").lib_controllers}


def threads_of(system: hb.System) -> dict[str, float]:
    """A job: the largest number of threads seen inside."""
    return {"threads": max(counts())}


@pytest.fixture
def two():
    """The user's own choice: two threads."""
    counts()
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        if counts() != {2}:
            pytest.skip("linear algebra here has one thread in any case")
        yield


def test_one_inside_and_the_users_number_after(two):
    with one_blas_thread():
        assert counts() == {1}
        with one_blas_thread():
            assert counts() == {1}
        assert counts() == {1}
    assert counts() == {2}


def test_an_error_restores_the_users_number(two):
    with pytest.raises(hb.ModelError):
        hb.hopf_points(hb.load_problem("bautin").bautin(), "mue", (-1.0, 1.0))
    assert counts() == {2}


def test_blocks_of_several_threads_may_overlap(two):
    entered, leave = threading.Event(), threading.Event()

    def other() -> None:
        with one_blas_thread():
            entered.set()
            leave.wait(10.0)

    thread = threading.Thread(target=other)
    with one_blas_thread():
        thread.start()
        assert entered.wait(10.0)
    assert counts() == {2}  # the other goes on
    leave.set()
    thread.join()
    assert counts() == {2}


@pytest.mark.parametrize("workers", [0, 1])
def test_jobs_of_a_study_have_one(two, workers):
    found = hb.sweep(threads_of, studies.listed([{"a": 1.0}]), problem="bautin", workers=workers)
    assert found["threads"].values.tolist() == [1.0] and counts() == {2}


def test_verbs_have_one(two):
    """Seen from inside a trace, by its own progress."""
    system, seen = hb.load_problem("bautin").bautin(), []
    (hopf,) = hb.hopf_points(system, "mu", (-1.0, 0.5))
    equations = hb.HarmonicBalance(3).equations(system)
    hb.trace(equations, hopf, "mu", (-1.0, 0.5), stability=False, progress=lambda value: seen.append(counts()))
    assert seen and all(c == {1} for c in seen) and counts() == {2}
