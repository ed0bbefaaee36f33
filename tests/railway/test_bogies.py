"""The problems of one wheelset and of one bogie against closed forms, published and independently computed numbers."""

import numpy as np
import pytest

import hbbogie as hb
from hbbogie.branches import crossings
from hbbogie.collocation import Collocation


def largest(equations, branch, V, coordinate):
    return max(crossings(equations, branch, V), key=lambda orbit: orbit.amplitude(coordinate))


# --- one wheelset -----------------------------------------------------------------------------

WHEELSET = hb.load_problem("wheelset")


def test_klingel_wavelength_of_wheelset_and_rigid_bogie():
    assert WHEELSET.klingel_wavelength(0.75, 0.46, 0.2) == pytest.approx(8.252288796, abs=5e-10)
    assert WHEELSET.klingel_wavelength(0.75, 0.46, 0.2, lb=1.28) == pytest.approx(16.32350099, abs=5e-9)


def test_weakly_held_wheelset_hunts_at_klingels_frequency():
    soft = WHEELSET.wheelset(ky=1e3, kpsi=1e3)
    (hopf,) = hb.hopf_points(soft, "V", (0.5, 20.0))
    wavelength = WHEELSET.klingel_wavelength(*(soft.values[name] for name in ("a", "r0", "lam")))
    assert hopf.omega == pytest.approx(2 * np.pi * hopf.value / wavelength, rel=1e-3)


@pytest.mark.parametrize("point", WHEELSET.POINTS[:2])
def test_critical_speed_of_a_wheelset_in_closed_form(point):
    system = WHEELSET.wheelset(**point.parameters)
    (hopf,) = hb.hopf_points(system, "V", (20.0, 100.0))
    V, omega = WHEELSET.critical_speed(system.values)
    assert (V, omega) == pytest.approx((point.V, point.omega), abs=5e-9)
    assert (hopf.value, hopf.omega) == pytest.approx((V, omega), rel=1e-9)


def test_branch_of_one_harmonic_in_closed_form():
    system = WHEELSET.wheelset()
    (hopf,) = hb.hopf_points(system, "V", (20.0, 100.0))
    balance = hb.HarmonicBalance(1).equations(system)
    branch = hb.trace(balance, hopf, "V", (30.0, 80.0), stability=False)
    for point in WHEELSET.POINTS[2:]:
        assert WHEELSET.first_harmonic_cycle(system.values, point.Y) == pytest.approx((point.V, point.omega), abs=5e-9)
        (cycle,) = crossings(balance, branch, point.V)
        assert (cycle.amplitude("y"), cycle.omega) == pytest.approx((point.Y, point.omega), rel=1e-8)


def test_wheelset_on_profiles_by_two_methods():
    """S1002 on UIC60 with Polach's law: harmonic balance and shooting agree, and a motion stays on the cycle.

    Between two stable cycles of a family that the amplitude orders there must be an unstable one.
    """
    system = WHEELSET.wheelset_on_profiles(V=45.0)
    small, between, large = hb.find_cycles(system, V=45.0)
    assert [cycle.verdict for cycle in (small, between, large)] == ["stable", "unstable", "stable"]
    assert large.amplitude("y") > system.values["y0"] > small.amplitude("y")
    balanced = hb.solve(hb.HarmonicBalance(63).equations(system), small, method="newton", V=45.0)
    assert balanced.omega == pytest.approx(small.omega, rel=1e-5)
    assert balanced.amplitude("y") == pytest.approx(small.amplitude("y"), rel=1e-5)


def test_wheelset_on_smooth_profiles_by_two_methods():
    """The radius difference as a spline: harmonic balance and collocation agree, second derivatives are exact."""
    system = WHEELSET.wheelset_on_profiles(difference="spline", V=45.0)
    small = min(hb.find_cycles(system, V=45.0), key=lambda cycle: cycle.amplitude("y"))
    balance, mesh = hb.HarmonicBalance(63).equations(system), Collocation().equations(system)
    harmonics, pieces = hb.solve(balance, small, method="newton", V=45.0), hb.solve(mesh, small, V=45.0)
    assert harmonics.omega == pytest.approx(pieces.omega, rel=1e-7)
    assert harmonics.amplitude("y") == pytest.approx(pieces.amplitude("y"), rel=1e-7)
    equations = hb.HarmonicBalance(9).equations(system)
    cycle = hb.solve(equations, small, method="newton", V=45.0)
    z, p, weights = equations.encode(cycle), system.vector(V=45.0), np.linspace(-1, 1, equations.size)
    step = 1e-6 * np.abs(z) * np.cos(np.arange(len(z)))
    slopes = [weights @ equations.derivatives(())(z + s * step, p)[1].full() for s in (1, -1)]
    second = equations.hessian(())(z, p, weights).full()
    np.testing.assert_allclose(second @ step, (slopes[0] - slopes[1]) / 2, atol=1e-7 * np.abs(second @ step).max())


def test_wheelset_on_profiles_names_what_there_is():
    with pytest.raises(hb.ModelError, match="give one of lines, spline"):
        WHEELSET.wheelset_on_profiles(difference="cubic")


# --- the simple bogie -------------------------------------------------------------------------

SIMPLE = hb.load_problem("simple_bogie")


@pytest.fixture(scope="module")
def simple():
    """Return equations and branch, with and without flange."""
    found = {}
    for flange in (True, False):
        system = SIMPLE.simple_bogie(flange=flange)
        (hopf,) = hb.hopf_points(system, "V", SIMPLE.RANGE)
        balance = hb.HarmonicBalance(31).equations(system)
        found[flange] = balance, hb.trace(balance, hopf, "V", (50.0, 142.0), stability=False)
    return found


def test_simple_bogie_hopf_point():
    (hopf,) = hb.hopf_points(SIMPLE.simple_bogie(), "V", SIMPLE.RANGE)
    assert (hopf.value, hopf.omega) == pytest.approx(SIMPLE.HOPF, abs=5e-5)


def test_simple_bogie_flange_is_smooth_and_odd():
    law = SIMPLE.SmoothFlange(14.6e6)
    at = [float(law.force(u)) for u in (0.0, law.b1 - 1e-12, law.b1 + 1e-12, -0.0092)]
    assert at[0] == pytest.approx(0.0, abs=1e-9)
    assert at[1] == pytest.approx(at[2], abs=1e-4)  # slopes of 14.6 MN/m over 2e-12 m
    assert at[3] == pytest.approx(-14.6e6 * 0.0001)


def test_simple_bogie_cycles(simple):
    for flange, cycles in ((True, SIMPLE.CYCLES), (False, SIMPLE.FLANGELESS_CYCLES)):
        for known in cycles:
            cycle = largest(*simple[flange], known.V, "q1")
            assert cycle.amplitude("q1") == pytest.approx(known.q1, abs=7e-7)
            assert cycle.omega == pytest.approx(known.omega, abs=6e-4)


def test_simple_bogie_folds(simple):
    with_flange, without = (simple[flange][1].folds()[0] for flange in (True, False))
    assert with_flange.value == pytest.approx(SIMPLE.FOLD.V, abs=0.002)
    # at a fold amplitude and frequency go with the root of the error of the speed
    assert with_flange.orbit.amplitude("q1") == pytest.approx(SIMPLE.FOLD.q1, abs=2e-5)
    assert with_flange.omega == pytest.approx(SIMPLE.FOLD.omega, abs=5e-3)
    assert without.value == pytest.approx(SIMPLE.FLANGELESS_FOLD, abs=0.01)


def test_simple_bogie_cycle_is_stable(simple):
    balance, branch = simple[True]
    upper, lower = sorted(crossings(balance, branch, 65.0), key=lambda o: -o.amplitude("q1"))
    assert hb.floquet(balance.system, upper).verdict == "stable"
    assert hb.floquet(balance.system, lower).verdict == "unstable"


# --- Kaas-Petersen's bogie --------------------------------------------------------------------

KAAS = hb.load_problem("kaas_petersen1986")


@pytest.fixture(scope="module")
def flanged():
    """Return the bogie, its equations and branch with 21 harmonics and the equations with 47."""
    system = KAAS.bogie()
    (hopf,) = hb.hopf_points(system, "V", KAAS.RANGE)
    balance = hb.HarmonicBalance(21).equations(system)
    branch = hb.trace(balance, hopf, "V", (60.0, 142.0), stability=False)
    return system, balance, branch, hb.HarmonicBalance(47).equations(system)


def test_kaas_petersen_hopf_point():
    (hopf,) = hb.hopf_points(KAAS.bogie(), "V", KAAS.RANGE)
    assert (hopf.value, hopf.omega) == pytest.approx(KAAS.HOPF, abs=5e-6)


def test_kaas_petersen_cycles_and_fold(flanged):
    _, coarse, branch, exact = flanged
    (fold,) = [f for f in branch.folds() if f.extremum == "minimum" and f.value < 70]
    assert fold.value == pytest.approx(KAAS.FOLD[0], abs=1e-3)
    assert fold.omega == pytest.approx(KAAS.FOLD[1], abs=2e-3)
    for known in KAAS.CYCLES:
        start = min(crossings(coarse, branch, known.V), key=lambda o: abs(o.omega - known.omega))
        cycle = hb.solve(exact, start, method="newton", V=known.V)
        found = (cycle.amplitude("q1"), cycle.amplitude("q3"))
        assert found == pytest.approx((known.q1, known.q3), abs=5e-6)
        assert cycle.omega == pytest.approx(known.omega, abs=5e-4)


def test_kaas_petersen_pitchfork_with_few_harmonics(flanged):
    """Where 21 harmonics give multipliers that are not trusted, those of twice as many locate the upper pitchfork."""
    _, coarse, branch, _ = flanged
    beside = hb.trace(coarse, branch.orbits[-1], "V", (127.0, 142.0))
    (fork,) = beside.special
    low, high = fork.interval
    assert fork.kind == "pitchfork" and fork.value == pytest.approx(KAAS.POINTS["pitchforks"][1], abs=0.01)
    assert low < KAAS.POINTS["pitchforks"][1] < high and high - low < 1.0


@pytest.mark.slow
def test_kaas_petersen_symmetric_folds(flanged):
    """The two folds of symmetric cycles, with 47 harmonics, whose tails are 1e-5."""
    _, _, branch, exact = flanged
    known = (KAAS.POINTS["fold of the stable symmetric branch"], KAAS.POINTS["fold of another symmetric branch"])
    for fold, V in zip(sorted(branch.folds(), key=lambda f: -f.value), known, strict=False):
        assert hb.fold(exact, fold).value == pytest.approx(V, abs=6e-3)


def test_kaas_petersen_without_flange():
    system = KAAS.bogie(flange=False)
    (hopf,) = hb.hopf_points(system, "V", KAAS.RANGE)
    balance = hb.HarmonicBalance(31).equations(system)
    branch = hb.trace(balance, hopf, "V", (45.0, 152.0), stability=False)
    V, q1, omega = KAAS.FLANGELESS_FOLD
    (fold,) = branch.folds()
    assert fold.value == pytest.approx(V, abs=5e-3)
    assert fold.orbit.amplitude("q1") == pytest.approx(q1, abs=1e-4)
    assert fold.omega == pytest.approx(omega, abs=5e-3)
    for known in KAAS.FLANGELESS:
        cycle = largest(balance, branch, known.V, "q1")
        assert (cycle.amplitude("q1"), cycle.amplitude("q3")) == pytest.approx((known.q1, known.q3), abs=1.5e-5)
        assert cycle.omega == pytest.approx(known.omega, abs=6e-4)
    beside = hb.trace(balance, hb.solve(balance, cycle, V=155.0), "V", (154.9, 157.0))
    (fork,) = [s for s in beside.special if s.kind == "pitchfork"]
    low, high = KAAS.FLANGELESS_PITCHFORK  # to one digit after the point
    assert low - 0.05 < fork.value < high + 0.05
    for V, sign in ((fork.value - 0.02, -1), (fork.value + 0.02, 1)):  # shooting agrees on where the symmetry breaks
        polished = hb.verify(system, hb.solve(balance, fork.orbit, V=V)).orbit
        assert sign * (polished.stability.largest() - 1) > 0


@pytest.mark.slow
def test_kaas_petersen_asymmetric_cycle_without_flange():
    known = KAAS.FLANGELESS_ASYMMETRIC
    system = KAAS.bogie(flange=False, V=known["V"])
    cycle = next(o for o in hb.find_cycles(system, V=known["V"]) if o.verdict == "stable")
    for name in ("q1", "q3"):
        low, high = (end[cycle.index(name)] for end in cycle.extremes)
        mirrored = (-high, -low)
        found = min((low, high), mirrored, key=lambda ends: abs(ends[1] - known[name][1]))
        assert found == pytest.approx(known[name], abs=1.5e-4)
    assert cycle.omega == pytest.approx(known["omega"], abs=1e-3)


@pytest.mark.slow
def test_kaas_petersen_asymmetric_attractor_is_found():
    """At 110 m/s a pitchfork has left an asymmetric attractor, and its mirror image, beside the symmetric one."""
    found = [cycle for cycle in hb.find_cycles(KAAS.bogie(), V=110.0) if cycle.verdict == "stable"]
    symmetric = [cycle for cycle in found if cycle.is_odd(1e-6)]
    broken = [cycle for cycle in found if not cycle.is_odd(1e-6)]
    assert len(symmetric) == 1 and len(broken) == 2
    for cycle in broken:
        assert cycle.amplitude("q1") == pytest.approx(KAAS.ASYMMETRIC[110.0], abs=6e-6)
        assert cycle.omega == pytest.approx(27.43719, abs=1e-4)  # by a script of its own, DOP853 and shooting


@pytest.mark.slow
def test_kaas_petersen_symmetry_breaks_and_a_torus(flanged):
    """Pitchforks and the Neimark-Sacker point of the asymmetric branch, and two attractors between 102 and 110."""
    system, _, branch, exact = flanged
    start = hb.solve(exact, branch.orbits[-1], method="newton", V=140.0)
    symmetric = hb.trace(exact, start, "V", (98.0, 141.0))
    forks = sorted((s for s in symmetric.special if s.kind == "pitchfork"), key=lambda s: s.value)
    assert [f.value for f in forks] == pytest.approx(KAAS.POINTS["pitchforks"], abs=2e-3)
    asymmetric = hb.HarmonicBalance(47, odd=False).equations(system)
    broken = hb.trace(asymmetric, forks[0], "V", (98.0, 141.0), stability=False)
    for V, q1 in KAAS.ASYMMETRIC.items():
        cycle = crossings(asymmetric, broken, V)[0]
        assert cycle.amplitude("q1") == pytest.approx(q1, abs=5e-6)
        assert hb.floquet(system, cycle).verdict == "stable"
    torus = KAAS.POINTS["Neimark-Sacker"]
    for V, verdict in ((torus - 0.03, "unstable"), (torus + 0.03, "stable")):
        cycle = hb.verify(system, crossings(asymmetric, broken, V)[0]).orbit
        assert cycle.stability.verdict == verdict
        assert abs(cycle.stability.critical.imag) > 0.1


# --- outputs ----------------------------------------------------------------------------------


def test_outputs_of_the_wheelset_balance():
    """Guiding forces hold mass and spring; the wear number is that of both creepages."""
    system = WHEELSET.wheelset()
    cycle = hb.find_cycles(system, V=46.0, parameter="V", interval=(30.0, 80.0))[-1]
    t = np.linspace(0.0, cycle.period, 50)
    q, p = cycle.q(t), cycle.parameters
    at = {name: cycle.output(name).at(t) for name in system.output_names}
    left = p["m"] * at["axle acceleration"] + p["ky"] * q[:, 0] + at["guiding forces"]
    assert np.abs(left).max() < 1e-9 * np.abs(at["guiding forces"]).max()
    lateral = (at["guiding forces"] - at["flange force"]) / (2 * p["f22"])
    along = p["a"] * cycle.v(t)[:, 1] / p["V"] + p["lam"] * q[:, 0] / p["r0"]
    worn = 2 * (p["f11"] * along**2 + p["f22"] * lateral**2)
    assert at["wear number"] == pytest.approx(worn, rel=1e-9)


def test_outputs_of_the_simple_bogie_balance():
    simple = hb.load_problem("simple_bogie").simple_bogie()
    cycle = hb.find_cycles(simple, V=70.0, parameter="V", interval=(50.0, 140.0))[-1]
    t = np.linspace(0.0, cycle.period, 50)
    q, v, p = cycle.q(t), cycle.v(t), cycle.parameters
    at = {name: cycle.output(name).at(t) for name in simple.output_names}
    both = at["guiding forces, front"] + at["guiding forces, rear"]
    left = p["m"] * at["frame acceleration"] + 2 * p["D2"] * v[:, 0] + 2 * p["k4"] * q[:, 0] + both
    assert np.abs(left).max() < 1e-9 * np.abs(both).max()
    turning = at["frame acceleration, front"] - at["frame acceleration, rear"]
    assert 2 * at["frame acceleration"] + turning == pytest.approx(2 * at["frame acceleration, front"], rel=1e-12)
    assert cycle.output("flange force, rear").peak > 0 and cycle.mean("wear number, front") > 0
    assert "flange force, front" not in hb.load_problem("simple_bogie").simple_bogie(flange=False).output_names
