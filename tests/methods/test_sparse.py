"""Systems of many coordinates: a sparse balance and sparse transition matrices give what full ones give."""

from __future__ import annotations

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import cycle_after

BALANCE = hb.HarmonicBalance(5)
V = 65.0


def train(n):
    return hb.load_problem("train").train(n, V=V)


@pytest.fixture(scope="module")
def pair():
    return train(2)


@pytest.fixture
def full(monkeypatch):
    """Take full matrices whatever the size."""
    monkeypatch.setattr("hbbogie.methods.size.MANY", 10**6)
    monkeypatch.setattr("hbbogie.methods.size.MANY_STATES", 10**6)


@pytest.fixture(scope="module")
def cycle(pair):
    """The front bogie of the first vehicle hunts."""
    return cycle_after(pair, {"y1_1": 0.01, "y2_1": 0.01})


class TestBalance:
    def test_only_many_coordinates_take_it(self, pair):
        sparse, small = BALANCE.equations(pair), BALANCE.equations(train(1))
        assert not sparse.derivatives(()).sparsity_out(1).is_dense()
        assert small.derivatives(()).sparsity_out(1).is_dense()

    @pytest.mark.parametrize("odd", [True, False])
    def test_derivatives_are_those_of_the_full_one(self, pair, full, odd):
        """With flanges in contact, dampers beyond blow-off and creep that saturates."""
        balance = hb.HarmonicBalance(3, odd=odd, condense=False)
        whole = balance.equations(train(2))
        z = np.random.default_rng(0).standard_normal(whole.size) * 3e-3
        z[-1], free = 22.0, (0, pair.parameter_names.index("y0"))
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("hbbogie.methods.size.MANY", 20)
            sparse = balance.equations(train(2))
        assert sparse.derivatives(free).nnz_out(1) < 0.2 * whole.size**2
        for mine, theirs in zip(
            sparse.derivatives(free)(z, pair.vector()), whole.derivatives(free)(z, pair.vector()), strict=True
        ):
            mine, theirs = mine.full(), theirs.full()
            np.testing.assert_allclose(mine, theirs, atol=1e-12 * np.abs(theirs).max())
        np.testing.assert_array_equal(sparse.coefficients(z, pair.vector()), whole.coefficients(z, pair.vector()))

    def test_cycle_and_branch_are_those_of_the_condensed_one(self, cycle, full):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("hbbogie.methods.size.MANY", 20)
            sparse = BALANCE.equations(train(2))
        condensed = BALANCE.equations(train(2))
        assert condensed.size < sparse.size
        orbits = [hb.solve(e, cycle, method="newton", V=V) for e in (sparse, condensed)]
        assert orbits[0].omega == pytest.approx(orbits[1].omega, rel=1e-10)
        np.testing.assert_allclose(orbits[0].coefficients, orbits[1].coefficients, atol=1e-10 * 0.01)
        ends = [
            hb.trace(e, o, "V", (64.5, 65.5), stability=False).orbits[-1].omega
            for e, o in zip((sparse, condensed), orbits, strict=True)
        ]
        assert ends[0] == pytest.approx(ends[1], rel=1e-9)


class TestCycle:
    def test_train_of_two_meets_shooting(self, cycle):
        """Polished by multiple shooting to 1e-12: omega 21.966501669, multipliers .73768 + .28959i, .71528."""
        assert cycle.verdict == "stable"
        assert abs(cycle.omega - 21.96650166927) <= cycle.errors["omega"] < 5e-3
        m = cycle.stability.multipliers
        assert abs(m[1] - (0.73768 + 0.28959j)) < 1e-3

    def test_train_of_four_meets_an_integration(self):
        """By an integrator of order 8 and Newton's method, closed to 1e-8: 21.96636829 rad/s."""
        found = cycle_after(train(4), {"y1_1": 0.01, "y2_1": 0.01})
        assert abs(found.omega - 21.96636829) <= found.errors["omega"] < 5e-3
        peaks = (0.01006910865, 0.008641328665, 0.001845737026, 0.001333694868)
        for k, peak in enumerate(peaks, 1):
            assert found.amplitude(f"y{k}_1") == pytest.approx(peak, abs=3e-6)
        assert found.verdict == "stable"
        assert abs(found.stability.multipliers[1] - (0.7377029162 + 0.289501604j)) < 1e-3

    def test_multipliers_are_those_of_full_matrices(self, cycle, full):
        whole = hb.floquet(train(2), cycle)
        mine = cycle.stability
        np.testing.assert_allclose(mine.multipliers[:8], whole.multipliers[:8], atol=1e-6)
        assert mine.trivial_error == pytest.approx(whole.trivial_error, rel=1e-3)


def test_hopf_points_of_neighbouring_pairs_are_all_found():
    """Each of the vehicle's two splits into one for every vehicle; none is taken for its neighbour."""
    expected = [79.61484911, 79.85301954, 80.15150398, 80.23892976, 86.11615696, 86.30092415, 86.49285122, 86.54317071]
    for interval in ((60.0, 110.0), (1.0, 292.0)):
        found = [point.value for point in hb.hopf_points(train(4), "V", interval)]
        np.testing.assert_allclose(found, expected, rtol=1e-9)
