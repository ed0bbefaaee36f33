"""Basins and diagrams that tell attractors apart by the bodies that move in them."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest

import hbbogie as hb
from hbbogie import plot
from hbbogie.attraction import find_basin
from hbbogie.reports import by_mode
from hbbogie.results import Basin

matplotlib.use("Agg")


@pytest.fixture(scope="module")
def pair():
    """Two oscillators that do not feel each other: each rests, or moves on a circle, r^2 = 1 + sqrt(1 + mu)."""
    mu = hb.Parameter("mu", -0.5)
    coordinates, equations = [], []
    for side, omega in (("left", 1.0), ("right", 1.3)):
        x = hb.Coordinate(f"x_{side}", "m", group=f"{side} body")
        square = x**2 + (x.dot / omega) ** 2
        coordinates.append(x)
        equations.append(x.ddot - (mu + 2 * square - square**2) * x.dot + omega**2 * x)
    return hb.System("pair", coordinates, [mu], equations)


@pytest.fixture(scope="module")
def scan(pair):
    balance = hb.HarmonicBalance(3).equations(pair)
    hopf = hb.hopf_points(pair, "mu", (-1.2, 0.5))
    branches = [hb.trace(balance, point, "mu", (-1.2, 0.5), stability=False) for point in hopf]
    along = {"x_left": 1.0, "x_right": 0.3}
    return branches, find_basin(pair, "mu", [-0.5], [0.2, 1.2], along=along, branches=branches)


def test_motions_end_on_the_attractor_of_the_body_that_was_moved(scan):
    _, found = scan
    assert found.ends.tolist() == [["rest", "left body"]]
    assert found.outcome.tolist() == [["rest", "cycle"]]
    assert found.kinds == ["rest", "left body", "cycle", "undecided"]
    assert "1 left body" in repr(found)


def test_files_and_legend_name_the_attractor(scan, tmp_path):
    branches, found = scan
    found.save(tmp_path / "basin.nc")
    assert Basin.load(tmp_path / "basin.nc").ends.tolist() == found.ends.tolist()
    ax = plot.basin(found, branches)
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert "settles on a cycle: left body" in texts and "comes to rest" in texts


def test_a_branch_is_cut_where_other_bodies_begin_to_move(pair, scan):
    """Stretches of one cycle each after the other: neighbours share a cycle, and none is left out."""
    branches, _ = scan
    left, right = (next(b for b in branches if b[0].first_harmonic(q) > 0) for q in ("x_left", "x_right"))
    mixed = left.with_orbits([*left.orbits[:3], *right.orbits[:2], *left.orbits[3:5]])
    parts, names = by_mode(pair, [mixed])
    assert names == ["left body", "right body", "left body"]
    assert [len(part) for part in parts] == [3, 3, 3]
    assert np.array_equal(np.concatenate([parts[0].values, *(p.values[1:] for p in parts[1:])]), mixed.values)
