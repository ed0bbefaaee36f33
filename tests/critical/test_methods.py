"""One vocabulary of methods, exact, mhb, collocation and auto, wherever cycles or critical values are asked for."""

from __future__ import annotations

import pytest
from smooth_systems import fitzhugh_nagumo

import hbbogie as hb
from hbbogie.branches import bifurcation_diagram
from hbbogie.critical import chart
from hbbogie.model import DeadBand

V = 88.7641131943  # m/s, the fold of the bogie, by event-located shooting


@pytest.fixture(scope="module")
def bautin():
    return hb.load_problem("bautin").bautin(a=1.0)


@pytest.fixture(scope="module")
def van_der_pol():
    return hb.load_problem("van_der_pol").van_der_pol()


class TestCriticalValues:
    def test_of_the_bogie(self, bogie):
        """Auto is exact; harmonic balance agrees within its error, and so do the gradients of both."""
        exact, balance = (
            {c.kind: c for c in hb.critical_speeds(bogie, "V", (60.0, 190.0), method=m)} for m in ("auto", "mhb")
        )
        assert exact["fold"].value == pytest.approx(V, abs=5e-11)
        assert exact["fold"].orbit.method == "exact" and "closed form" in exact["fold"].status
        assert abs(balance["fold"].value - V) <= balance["fold"].error
        assert exact["hopf"].value == balance["hopf"].value
        for name, slope in balance["fold"].elasticities.items():
            assert exact["fold"].elasticities[name] == pytest.approx(slope, abs=1e-3)

    def test_by_collocation_in_closed_form(self, bautin):
        """The fold lies at mu = -a^2 / 4."""
        found = {c.kind: c for c in hb.critical_speeds(bautin, "mu", (-0.5, 0.5), method="collocation")}
        fold = found["fold"]
        assert fold.value == pytest.approx(-0.25, abs=1e-9) and abs(fold.value + 0.25) <= fold.error < 1e-8
        assert fold.gradient["a"] == pytest.approx(-0.5, abs=1e-7)
        assert fold.orbit.method.startswith("collocation")

    @pytest.mark.slow
    def test_of_a_system_with_contacts_by_collocation(self, bogie):
        """Two independent methods agree, from the Hopf point through the grazing and around the fold."""
        found, exact = (
            {c.kind: c for c in hb.critical_speeds(bogie, "V", (85.0, 100.0), method=method)}
            for method in ("collocation", "exact")
        )
        assert found["fold"].value == pytest.approx(exact["fold"].value, rel=1e-10)
        for name, slope in exact["fold"].elasticities.items():
            assert found["fold"].elasticities[name] == pytest.approx(slope, abs=1e-7)

    def test_of_a_canard_that_harmonics_do_not_resolve(self):
        """By collocation on 400 intervals the fold lies at 0.3241785225."""
        found = hb.critical_speeds(fitzhugh_nagumo(), "I", (0.3, 0.4))
        (fold,) = (c for c in found if c.kind == "fold")
        assert fold.value == pytest.approx(0.3241785225, abs=1e-8)
        assert fold.orbit.method.startswith("collocation") and fold.resolved
        assert any("do not resolve" in said for said in found.evidence) and found.complete


class TestCycles:
    def test_of_the_bogie(self, bogie):
        by = {m: hb.find_cycles(bogie, V=90.0, method=m) for m in ("auto", "exact", "mhb")}
        assert all("linear between switchings" in cycle.status for cycle in by["auto"])
        for exact, other in zip(by["exact"], by["mhb"], strict=True):
            assert exact.kept is None and other.kept == 15 and other.method.startswith("harmonic balance")
            assert other.omega == pytest.approx(exact.omega, rel=1e-4)
            assert abs(other.amplitude("q1") / exact.amplitude("q1") - 1) < 2 * other.errors["waveform"]

    def test_of_a_smooth_system(self, van_der_pol):
        """PUBLISHED periods."""
        (steep,) = hb.find_cycles(van_der_pol, mu=10.0)
        assert steep.method.startswith("collocation") and "harmonics" in steep.status
        assert steep.period == pytest.approx(19.0783695669390, rel=1e-9)
        (smooth,) = hb.find_cycles(van_der_pol, mu=1.0, method="mhb")
        assert smooth.period == pytest.approx(6.66328685932313, rel=1e-9) and smooth.kept == 15


def test_branches(bogie):
    found = bifurcation_diagram(bogie, "V", (85.0, 95.0), method="exact")
    (branch,) = found.branches.values()
    assert branch.folds()[0].value == pytest.approx(V, abs=5e-11)
    assert {cycle.method for cycle in (*branch.orbits, *found.cycles)} == {"exact"}


def test_comparison(bogie, bautin):
    assert set(hb.compare(bogie, ("mhb3", "auto"), (90.0,), parameter="V", truth="mhb9").methods) >= {"mhb3", "exact"}
    found = hb.compare(bautin, ("mhb", "auto"), (-0.1,), parameter="mu", interval=(-0.5, 0.5), truth="mhb3")
    assert {"mhb", "mhb63"} <= set(found.methods)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda s, b: hb.find_cycles(s, mu=1.0, method="exact"), "no cycle in closed form; use HarmonicBalance"),
        (lambda s, b: hb.critical_speeds(s, "mu", method="exact"), "no cycle in closed form; use HarmonicBalance"),
        (lambda s, b: hb.critical_speeds(b, "V", method="exakt"), "Did you mean 'exact'"),
        (lambda s, b: hb.find_cycles(b, V=90.0, method=7), "got 7 as method; give a name: auto, exact, mhb"),
        (lambda s, b: hb.find_cycles(b, V=90.0, method="exact", harmonics=5), "which has none; leave one of the two"),
        (lambda s, b: hb.critical_speeds(b, "V", method="exact", harmonics=5), "which has none; leave one of the two"),
        (lambda s, b: chart(hb.load_problem("circuit").SYSTEM(), "v", "b", method="exact"), "no cycle in closed form"),
        (lambda s, b: chart(s, "mu", "mu_2", method="collocation"), "no curve over two parameters"),
        (lambda s, b: bifurcation_diagram(s, "mu", (0.1, 2.0), method="exact"), "no cycle in closed form"),
    ],
)
def test_what_does_not_apply(ask, words, van_der_pol, bogie):
    with pytest.raises(hb.ModelError, match=words):
        ask(van_der_pol, bogie)


def test_contacts_beside_smooth_nonlinear_terms():
    """Neither exact nor smooth: polished by shooting, as harmonics, and by collocation where 63 are not enough."""
    x, mu = hb.Coordinate("x"), hb.Parameter("mu", 1.0)
    stop = hb.Element("stop", DeadBand(5.0, 1.5), x)
    system = hb.System("stopped", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x + stop], [stop])
    (round_one,) = hb.find_cycles(system, mu=1.0)
    assert round_one.method.startswith("multiple shooting") and round_one.kept is not None
    (steep,) = hb.find_cycles(system, mu=1.0, tolerance=1e-7)
    assert steep.method.startswith("collocation") and "63 harmonics leave" in steep.status
    assert steep.period == pytest.approx(round_one.period, rel=1e-8)
