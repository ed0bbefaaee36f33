"""The engine that follows curves: curves in closed form, branches that pass close by, endings as data."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr

import hbbogie as hb
from hbbogie import Coordinate, HarmonicBalance, Parameter, System
from hbbogie.results import Ending
from hbbogie.solving import Dense, Point, landing, located, point_at, walk


@dataclass
class Plane:
    """A curve g(x, y) = 0 in the plane, by g and its gradient."""

    equation: object
    window: dict = field(default_factory=dict)
    scale: np.ndarray = field(default_factory=lambda: np.ones(2))
    weights: np.ndarray = field(default_factory=lambda: np.ones(2))
    tolerance: float = 1e-10

    def linearise(self, u):
        g, gradient = self.equation(*u)
        return Dense(np.array([g]), np.array([gradient]) * self.scale)

    def settle(self, u):
        pass

    def leaves(self, points, there):
        return None

    def at(self, index, value):
        return Ending("interval", f"{'xy'[index]} = {value:g}")

    def where(self, u):
        return f"x = {u[0]:g}"


class ByBordering:
    """One equation with its gradient, bordered and solved by Cramer's rule: no matrix."""

    def __init__(self, g, gradient):
        self.residual, self.gradient = np.array([g]), gradient

    def solve(self, plane, right):
        (a, b), (c, d) = self.gradient, plane
        det = a * d - b * c
        if det == 0:
            raise np.linalg.LinAlgError
        return np.array([d * right[0] - b * right[1], a * right[1] - c * right[0]]) / det, float(np.sign(det))


class CircleWithoutMatrix(Plane):
    def linearise(self, u):
        g, gradient = self.equation(*u)
        return ByBordering(g, np.array(gradient) * self.scale)


def circle(x, y):
    return x**2 + y**2 - 1, (2 * x, 2 * y)


@pytest.mark.parametrize("kind", [Plane, CircleWithoutMatrix])
def test_a_circle_closes(kind):
    """By a full matrix and by a solver of its own; the points lie on it, in the order of their angle."""
    curve = kind(circle, scale=np.array([1.0, 0.5]))
    first = point_at(curve, np.array([1.0, 0.0]), np.array([0.0, 1.0]))
    points, end = walk(curve, first)
    assert end.kind == "closed" and points[-1] is points[0]
    u = np.array([p.u for p in points[:-1]])
    np.testing.assert_allclose(np.hypot(*u.T), 1, atol=1e-14)
    assert (np.diff(np.unwrap(np.arctan2(u[:, 1], u[:, 0]))) > 0).all()
    assert {p.orientation for p in points} == {first.orientation} and first.turned().orientation == -first.orientation


def test_lengths_are_measured_by_the_weights():
    """Where y does not count as distance, a step of 0.1 is one of 0.1 in x, however steep the curve."""
    curve = Plane(lambda x, y: (y - 50 * x, (-50.0, 1.0)), window={0: (0.0, 1.0)}, weights=np.array([1.0, 0.0]))
    points, end = walk(curve, point_at(curve, np.zeros(2), np.array([1.0, 0.0])), step=0.1)
    assert end == Ending("interval", "x = 1") and str(end) == "x = 1"
    np.testing.assert_allclose(np.diff([p.u[0] for p in points]), 0.1, atol=1e-12)


def test_where_an_unknown_has_a_value_and_a_function_changes_its_sign():
    curve = Plane(circle)
    a, b = (point_at(curve, np.array([np.cos(t), np.sin(t)]), np.array([-np.sin(t), np.cos(t)])) for t in (0.2, 0.5))
    there = landing(curve, a, b, 0, np.cos(0.3))
    np.testing.assert_allclose(there.u, [np.cos(0.3), np.sin(0.3)], rtol=1e-14)
    point, error = located(curve, a, b, lambda p: p.u[1] - np.sin(0.4))
    np.testing.assert_allclose(point.u, [np.cos(0.4), np.sin(0.4)], rtol=1e-12)
    assert error < 1e-12


def crossed(gap):
    """Two straight lines, y = 0 and y = x, that cross at 0; with a gap two hyperbolas that pass each other there."""
    return lambda x, y: (y * (y - x) - gap, (-y, 2 * y - x))


def test_a_branch_point_is_crossed():
    """Along y = 0 the orientation changes at 0, and only there; no step across it is long."""
    curve = Plane(crossed(0.0), window={0: (-1.0, 1.0)})
    points, end = walk(curve, point_at(curve, np.array([-1.0, 0.0]), np.array([1.0, 0.0])), longest=0.3)
    assert end.kind == "interval" and points[-1].u == pytest.approx([1.0, 0.0], abs=1e-12)
    assert max(abs(p.u[1]) for p in points) < 1e-12
    ((a, b),) = [(a.u[0], b.u[0]) for a, b in pairwise(points) if a.orientation * b.orientation < 0]
    assert a < 0 < b and b - a < 1e-3


@pytest.mark.parametrize("gap", [1e-2, 1e-4, 1e-6])
def test_a_curve_that_passes_close_by_is_not_jumped_to(gap):
    """y (y - x) = gap: from the left close to y = 0, then along y = x, never on the other hyperbola, where y < 0."""
    curve = Plane(crossed(gap), window={0: (-1.0, 1.0)})
    start = np.array([-1.0, (-1 + np.sqrt(1 + 4 * gap)) / 2])
    points, end = walk(curve, point_at(curve, start, np.array([1.0, 0.0])), longest=0.3)
    assert end.kind == "interval" and min(p.u[1] for p in points) > 0
    assert points[-1].u[1] == pytest.approx((1 + np.sqrt(1 + 4 * gap)) / 2, rel=1e-12)


def test_a_curve_that_stops_says_where_and_why():
    """y = sqrt(-x) - 1 does not exist beyond x = 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        curve = Plane(lambda x, y: (y + 1 - np.sqrt(-x), (0.5 / np.sqrt(-x), 1.0)))
        points, end = walk(curve, point_at(curve, np.array([-1.0, 0.0]), np.array([1.0, 0.0])))
    assert end.kind == "stuck" and curve.where(points[-1].u) in str(end)
    assert abs(points[-1].u[0]) < 1e-3


@pytest.mark.parametrize("span", [(-0.5, 4.0), (-4.0, 4.0)])
@pytest.mark.parametrize("d", [1e-4, 1e-3, 1e-2])
def test_weakly_damped_van_der_pol(span, d):
    """To first order mu (1 - a^2 / 4) = d: for mu > d amplitudes up to 2, and larger ones on a branch with mu < 0."""
    x, mu = Coordinate("x"), Parameter("mu", 1.0, "1", "", (-100, 100))
    system = System("damped", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + d * x.dot + x])
    hopf = min(hb.hopf_points(system, "mu", span), key=lambda h: abs(h.value - d))
    branch = hb.trace(HarmonicBalance(15).equations(system), hopf, "mu", span, max_points=300, stability=False)
    assert branch.ends[1].kind == "interval" and branch.values[-1] == 4.0
    assert (branch.values > d * (1 - 1e-9)).all() and not branch.folds()
    mu = branch.values[branch.values < 0.1]
    np.testing.assert_allclose(branch.amplitude("x")[: len(mu)], 2 * np.sqrt(np.maximum(0, 1 - d / mu)), atol=0.02)


@pytest.mark.parametrize("off", [0.0, 0.01, 0.02, -0.01])
def test_a_pitchfork_that_is_located_roughly_is_left(off):
    """The mean of z is 0, or +-sqrt(mu) for mu > 0: the branch is left also from a start at another mu."""
    x, y, z, mu = (*(Coordinate(n) for n in "xyz"), Parameter("mu", -0.5))
    s = 1 - x**2 - y**2
    system = System("broken", [x, y, z], [mu], [x.dot - s * x + y, y.dot - s * y - x, z.dot - mu * z + z**3])
    wave = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    start = hb.Orbit("broken", ("x", "y", "z"), ("", "", ""), wave, 1.0, {"mu": -0.5})
    branch = hb.trace(HarmonicBalance(3).equations(system), start, "mu", (-1.0, 2.0))
    (fork,) = branch.special
    assert fork.kind == "pitchfork" and fork.value == pytest.approx(0, abs=1e-9)
    at = {"mu": fork.value + off}
    guess = fork.onward.replace(parameters=at)
    rough = replace(fork, value=at["mu"], orbit=fork.orbit.replace(parameters=at), onward=guess)
    found = hb.trace(HarmonicBalance(3, odd=False).equations(system), rough, "mu", (-1.0, 2.0), stability=False)
    assert [end.kind for end in found.ends] == ["interval", "interval"]
    means = np.array([o.coefficients[0, 2] for o in found.orbits])
    assert means[0] * means[-1] == pytest.approx(-2.0, rel=1e-9)
    beyond = np.abs(means) > 1e-6
    np.testing.assert_allclose(means[beyond] ** 2, found.values[beyond], atol=1e-9)


@pytest.fixture(scope="module")
def bautin():
    system = hb.load_problem("bautin").bautin()
    hopf = hb.hopf_points(system, "mu", (-0.9, 0.5))[0]
    return hb.trace(HarmonicBalance(3).equations(system), hopf, "mu", (-0.9, 0.5), stability=False, max_points=8)


class TestEndings:
    def test_kinds_and_advice(self, bautin):
        assert [end.kind for end in bautin.ends] == ["began", "points"]
        assert "max_points" in bautin.ends[1].advice and bautin.ends[1].advice not in bautin.ends[1].what

    def test_they_are_saved(self, bautin, tmp_path):
        bautin.save(tmp_path / "b.nc")
        assert hb.Branch.load(tmp_path / "b.nc").ends == bautin.ends

    def test_files_with_sentences_only_are_read(self, bautin):
        old = bautin.to_dataset().assign_attrs(ends=json.dumps([str(end) for end in bautin.ends]))
        assert isinstance(old, xr.Dataset)
        ends = hb.Branch.from_dataset(old).ends
        assert [str(end) for end in ends] == [str(end) for end in bautin.ends] and ends[0].kind == ""

    def test_which_extremum_a_fold_is(self):
        system = hb.load_problem("bautin").bautin(a=1.3)
        hopf = hb.hopf_points(system, "mu", (-0.9, 0.5))[0]
        branch = hb.trace(HarmonicBalance(3).equations(system), hopf, "mu", (-0.9, 0.5))
        (fold,) = branch.folds()
        assert fold.extremum == "minimum" and fold.value == pytest.approx(branch.values.min(), rel=1e-12)
        assert hb.Branch.from_dataset(branch.to_dataset()).folds()[0].extremum == "minimum"


def test_a_point_knows_its_largest_residual():
    assert Point(np.zeros(2), np.ones(2), np.array([1e-12, -3e-12])).error == 3e-12
