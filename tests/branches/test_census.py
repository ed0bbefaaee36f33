"""The census of cycles: closed forms, and shooting by an independent integrator (DOP853, relative tolerance 1e-11)."""

import casadi as ca
import numpy as np
import pytest
from scipy.special import ellipk

import hbbogie as hb
from hbbogie.branches import of_prime_period

C, P = hb.Coordinate, hb.Parameter


def pairs(cycles):
    return sorted((o.period, o.stability.verdict) for o in cycles)


def predator_prey():
    n, q, K = C("n"), C("q"), P("K", 3.0)
    g = 2.5 * n * q / (n + 1)
    return hb.System("prey", [n, q], [K], [n.dot - (0.8 * n * (1 - n / K) - g), q.dot - (0.5 * g - 0.4 * q)])


def beside_a_slow_focus():
    """r' = r (r^2 - 0.64)(k - r^2) / 50, and 10 rad/s."""
    x, y, k = C("x"), C("y"), P("k", 1.0)
    r2 = x**2 + y**2
    g = (r2 - 0.64) * (k - r2) / 50
    return hb.System("focus", [x, y], [k], [x.dot - (x * g - 10 * y), y.dot - (y * g + 10 * x)])


class TestWhatIsFound:
    def test_a_motion_beside_a_barely_stable_focus_decays(self):
        """Damping 0.0128 at 10 rad/s: circles of radius 0.8, unstable, and 1."""
        found = hb.find_cycles(beside_a_slow_focus(), k=1.0, backwards=False)
        assert [o.amplitude("x") for o in found] == pytest.approx([0.8, 1.0], rel=1e-9)
        assert [o.stability.verdict for o in found] == ["unstable", "stable"]
        assert found.complete and not any("undecided" in said for said in found.evidence)
        assert any("decays to rest" in said for said in found.evidence)

    def test_a_motion_beside_a_weak_centre_does_not(self):
        """x'' + x'^3 + x = 0 decays more slowly than any exponential: no eigenvalue decides."""
        x, c = C("x"), P("c", 0.01)
        found = hb.find_cycles(hb.System("cubic", [x], [c], [x.ddot + c * x.dot**3 + x]), c=0.01)
        assert not found and not any("decays to rest as its linear motion" in said for said in found.evidence)

    def test_a_coordinate_at_rest_does_not_hide_the_period(self):
        """The circle at a height of 0.94, to which every motion comes: once, not with 5 or 12 of its periods."""
        x, y, z, k = C("x"), C("y"), C("z"), P("k", 1.0)
        r2 = x**2 + y**2
        equations = [x.dot - (x * (1 - r2) - k * y), y.dot - (y * (1 - r2) + k * x), z.dot + z**3 - 0.94**3]
        found = hb.find_cycles(hb.System("heights", [x, y, z], [k], equations), k=1.0)
        assert [o.period for o in found] == pytest.approx([2 * np.pi], rel=1e-12)

    def test_an_equilibrium_away_from_zero(self):
        (cycle,) = hb.find_cycles(predator_prey(), K=3.0)
        assert cycle.period == pytest.approx(20.3446, rel=1e-5) and cycle.stability.verdict == "stable"

    def test_two_attractors_of_one_system(self):
        """Two coupled oscillators, in opposite phase and in phase."""
        x = [C(f"x{i}") for i in range(2)]
        mu = P("mu", 0.3, "1", "", (-10, 10))
        equations = [
            x[i].ddot
            - mu * (1 - x[i] ** 2) * x[i].dot
            + x[i]
            - 0.1 * (x[1 - i] - x[i])
            - 0.05 * (x[1 - i].dot - x[i].dot)
            for i in range(2)
        ]
        found = pairs(hb.find_cycles(hb.System("pair", x, [mu], equations), mu=0.3))
        assert [v for _, v in found] == ["stable", "stable"]
        assert [T for T, _ in found] == pytest.approx([5.74767619, 6.31844320], rel=1e-6)

    def test_no_root_at_rest(self):
        """r' = r (r^2 - 3 r + 1), in closed form; the root has no slope at zero."""
        x, y, k = C("x"), C("y"), P("k", 1.0)
        r = ca.sqrt(x**2 + y**2)
        g = r**2 - 3 * r + k
        found = hb.find_cycles(hb.System("root", [x, y], [k], [x.dot - (x * g - y), y.dot - (y * g + x)]), k=1.0)
        radii = (3 - 5**0.5) / 2, (3 + 5**0.5) / 2
        assert [o.amplitude("x") for o in found] == pytest.approx(radii, rel=1e-6)
        assert [o.stability.verdict for o in found] == ["stable", "unstable"]

    def test_odd_system_about_two_wells(self):
        """Takens and Bogdanov with symmetry: the wells at +-1 lose their stability at m = 1, subcritically."""
        x, m = C("x"), P("m", 0.97)
        system = hb.System("wells", [x], [m], [x.ddot - (m - x**2) * x.dot - x + x**3])
        points = hb.hopf_points(system, "m", (0.9, 1.1))
        assert [s.value for s in points] == pytest.approx([1.0, 1.0], abs=1e-11)
        found = hb.find_cycles(system, m=0.97, interval=(0.9, 1.1))
        small = [o for o in found if o.coefficients[0, 0] ** 2 > 0.01]
        assert [np.sign(o.coefficients[0, 0]) for o in small] in ([1, -1], [-1, 1])
        assert {o.stability.verdict for o in small} == {"unstable"}
        assert small[0].omega == pytest.approx(small[1].omega, rel=1e-9)

    def test_motions_with_contact_come_back(self):
        """Where the flange is met, a motion between samples is no straight line; it settles on the larger cycle."""
        bogie = hb.load_problem("yang1995").bogie()
        found = hb.find_cycles(bogie, V=90.0)
        assert [o.stability.verdict for o in found] == ["unstable", "stable"]
        assert any("came to a cycle found already" in sentence for sentence in found.evidence)
        assert any("was followed in closed form" in sentence for sentence in found.evidence)
        for cycle in found:  # two methods agree
            assert hb.verify(bogie, cycle).orbit.omega == pytest.approx(cycle.omega, rel=1e-9)

    def test_a_cycle_run_through_several_times_is_one(self):
        """Three periods of x = cos t + sin 2 t."""
        c = np.zeros((19, 1))
        c[5, 0], c[12, 0] = 1.0, 1.0
        thrice = hb.Orbit("s", ("x",), ("",), c, 1 / 3, {})
        once = of_prime_period(thrice)
        t = np.linspace(0, 7, 50)
        assert once.omega == pytest.approx(1.0) and of_prime_period(once) is once
        np.testing.assert_allclose(once.q(t), thrice.q(t), atol=1e-14)
        np.testing.assert_allclose(once.q(t)[:, 0], np.cos(t) + np.sin(2 * t), atol=1e-14)

    @pytest.mark.slow
    def test_spurious_cycles_of_harmonic_balance_are_not_listed(self):
        """FitzHugh and Nagumo's equations, where an unstable and a stable cycle coexist."""
        x, y, i = C("x"), C("y"), P("I", 0.5505)
        system = hb.System("fhn", [x, y], [i], [x.dot - (x - x**3 / 3 - y + i), y.dot - 0.08 * (x - 0.8 * y)])
        found = pairs(hb.find_cycles(system, I=0.5505, interval=(0.4, 0.7)))
        assert [v for _, v in found] == ["unstable", "stable"]
        assert [T for T, _ in found] == pytest.approx([32.6892, 52.9807], rel=1e-5)

    def test_mirror_images_are_two_cycles(self):
        """Circles of radius sqrt(k) in the planes z = 1 and z = -1, in closed form; the one in z = 0 is unstable."""
        x, y, z, k = C("x"), C("y"), C("z"), P("k", 0.25)
        g = k - (x**2 + y**2)
        equations = [x.dot - g * x + y, y.dot - g * y - x, z.dot - (z - z**3)]
        found = hb.find_cycles(hb.System("mirror", [x, y, z], [k], equations), k=0.25)
        stable = [o for o in found if o.stability.verdict == "stable"]
        assert sorted(o.coefficients[0, 2] for o in stable) == pytest.approx([-1.0, 1.0])
        assert all(o.amplitude("x") == pytest.approx(0.5, rel=1e-8) for o in found)


class TestEvidence:
    def test_an_empty_result_gives_the_reason(self):
        """Below K = 33/17 the equilibrium is stable."""
        none = hb.find_cycles(predator_prey(), K=1.5)
        assert none == [] and "1.94117647" in none.evidence[0] and "eigenvalues" in none.evidence[0]
        assert none.evidence[0] in repr(none)

    def test_what_was_looked_at(self):
        found = hb.find_cycles(predator_prey(), K=3.0)
        text = " ".join(found.evidence)
        assert "branch from the Hopf point at K = 1.94117647" in text and "motions" in text
        assert len(repr(found)) < 400

    def test_a_start_restricts_the_search_to_one_equilibrium(self):
        found = hb.find_cycles(predator_prey(), K=3.0, start={"n": 0.5, "q": 0.4})
        assert [o.period for o in found] == pytest.approx([20.3446], rel=1e-5)
        assert sum("equilibrium n =" in s for s in found.evidence) == 1


class TestConserved:
    def selkov(self):
        x, y, w, b = C("x"), C("y"), C("w"), P("b", 0.6)
        f = -x + 0.08 * y + x**2 * y
        small = hb.System("small", [x, y], [b], [x.dot - f, y.dot - (b - 0.08 * y - x**2 * y)])
        whole = hb.System("whole", [x, y, w], [b], [x.dot - f, y.dot - (b - 0.08 * y - x**2 * y), w.dot + f])
        return small, whole

    @pytest.mark.parametrize("H", [9, 15])
    def test_judged_within_the_level(self, H):
        """The product of the reaction kept: its multipliers are those of the reaction alone, and a 1."""
        small, whole = self.selkov()
        (o,) = hb.find_cycles(small, b=0.6, harmonics=H, stability=False)
        c = np.c_[o.coefficients, -o.coefficients[:, 0]]
        c[0, 2] = 0
        o3 = o.replace(system="whole", coordinates=("x", "y", "w"), units=("",) * 3, coefficients=c)
        found, alone = hb.floquet(whole, o3), hb.floquet(small, o)
        assert found.verdict == "stable" and "x + w is conserved" in found.reason
        assert found.critical == pytest.approx(alone.critical, rel=1e-6)
        assert np.sum(np.abs(found.multipliers - 1) < 1e-2) == 2

    def test_a_branch_within_the_level(self):
        """Brusselator with its waste kept, x + y + w constant: the branch of the Brusselator alone."""
        x, y, w, B = C("x"), C("y"), C("w"), P("B", 2.5)
        f, g = 1 - (B + 1) * x + x**2 * y, B * x - x**2 * y
        whole = hb.System("whole", [x, y, w], [B], [x.dot - f, y.dot - g, w.dot + (1 - x)])
        small = hb.System("small", [x, y], [B], [x.dot - f, y.dot - g])
        balance = hb.HarmonicBalance(9)
        omegas = []
        for system in (whole, small):
            (hopf,) = hb.hopf_points(system, "B", (1.0, 4.0))
            branch = hb.trace(balance.equations(system), hopf, "B", (1.0, 2.2), stability=False)
            assert branch.values.max() == pytest.approx(2.2)
            (at,) = hb.branches.crossings(balance.equations(system), branch, 2.1)
            omegas.append(at.omega)
            level = [o.coefficients[0].sum() for o in branch.orbits]
            assert system is small or np.ptp(level) < 1e-9
        assert omegas[0] == pytest.approx(omegas[1], rel=1e-8)


def test_advice_for_a_family_keeps_the_value():
    """A pendulum at g = 1, whatever its default: T = 4 K(sin^2(peak/2)); damping is determined by its cycles, too."""
    x, g, d = C("x"), P("g", 2.0), P("d", 0.0)
    system = hb.System("pendulum", [x], [g, d], [x.ddot + d * x.dot + g * ca.sin(x)])
    with pytest.raises(hb.ModelError, match=r"parameters\(g=1\).*solve\(.*amplitude={'x': size}, g=1\)"):
        hb.find_cycles(system, g=1.0)
    c = np.array([[0.0], [1.0], [0.0]])
    guess = hb.Orbit("pendulum", ("x",), ("",), c, 1.0, {"g": 1.0, "d": 0.0})
    equations = hb.HarmonicBalance(15).equations(system.with_parameters(g=1.0))
    for free in ({"free": "d"}, {"g": 1.0}):
        cycle = hb.solve(equations, guess, amplitude={"x": 1.0}, **free)
        assert cycle.parameters["g"] == 1.0 and abs(cycle.parameters["d"]) < 1e-9
        assert cycle.period == pytest.approx(4 * ellipk(np.sin(cycle.amplitude("x") / 2) ** 2), rel=1e-9)


def test_a_family_without_a_parameter_that_ends_it():
    """Lotka and Volterra's cycles about (1, 1) are a family for every a: said, and not an empty list."""
    x, y, a = C("x"), C("y"), P("a", 1.0)
    system = hb.System("prey", [x, y], [a], [x.dot - x * (a - y), y.dot + y * (1 - x)])
    with pytest.raises(hb.ModelError, match=r"continuous family.*solve\(equations, guess, amplitude="):
        hb.find_cycles(system, a=1.0)


def test_a_branch_from_a_state():
    """A motion of the predator and its prey comes to the cycle, which begins at K = 33/17; from rest there is none."""
    system = predator_prey()
    equations = hb.HarmonicBalance(15).equations(system.with_parameters(K=2.2))
    options = {"stability": False, "max_points": 40}
    for start in ({"n": 0.5, "q": 0.5}, np.array([0.5, 0.5])):
        branch = hb.trace(equations, start, "K", (1.5, 2.3), **options)
        assert branch.values.min() == pytest.approx(33 / 17, abs=1e-3)
    with pytest.raises(hb.ConvergenceError, match="comes to rest"):
        hb.trace(hb.HarmonicBalance(5).equations(system.with_parameters(K=1.5)), np.array([0.5, 0.5]), "K", (1.0, 2.3))


def test_critical_values_and_studies_carry_the_evidence():
    system = predator_prey()
    found = hb.critical_speeds(system, "K", (1.0, 3.0), harmonics=5)
    assert [c.kind for c in found] == ["hopf"]
    assert any("branch from the Hopf point at K = 1.94117647" in sentence for sentence in found.evidence)
    rows = hb.sweep("cycles", {"K": [1.5]}, problem=system, options={"parameter": "K", "harmonics": 5}, workers=0)
    assert "no cycle was found at K = 1.5" in str(rows["evidence"].values[0])


def test_what_one_cycle_lets_expect():
    """Roessler's equations beyond the period doubling: the cycle that goes round once, by shooting with DOP853."""
    x, y, z, c = C("x"), C("y"), C("z"), P("c", 3.2)
    system = hb.System("Roessler", [x, y, z], [c], [x.dot + y + z, y.dot - x - 0.2 * y, z.dot - 0.2 - z * (x - c)])
    found = pairs(hb.find_cycles(system, c=3.2))
    assert [v for _, v in found] == ["unstable", "stable"]
    assert [T for T, _ in found] == pytest.approx([5.78971557, 11.53108104], rel=1e-7)


def ring(N: int, m: float) -> hb.System:
    """z' = z (m + 1 i - (1 - 1 i / 2) s) + 0.2 L z of N oscillators: L z is -N z for a wave, 0 in phase."""
    m, q = P("m", m), [C(f"{a}{i}") for i in range(N) for a in "xy"]
    equations = []
    for i in range(N):
        x, y = q[2 * i], q[2 * i + 1]
        s, lx, ly = x * x + y * y, sum(q[::2]) - N * x, sum(q[1::2]) - N * y
        equations += [
            x.dot - (m * x - y - s * (x + y / 2) - 0.2 * lx),
            y.dot - (m * y + x - s * (y - x / 2) - 0.2 * ly),
        ]
    return hb.System("ring", q, [m], equations)


def test_waves_in_both_directions():
    """A double pair at m = -0.6: waves with s = m + 0.6 run either way at 1 + s/2 rad/s; in phase s = m."""
    found = hb.find_cycles(ring(3, 0.4), m=0.4)
    waves = [o for o in found if abs(o.omega - 1.5) < 1e-6 and abs(o.amplitude("x0") - 1.0) < 1e-6]
    turns = {float(np.sign(np.linalg.det(o.coefficients[1:3][:, [0, 2]]))) for o in waves}
    assert len(waves) == 2 and turns == {-1.0, 1.0}
    (together,) = (o for o in found if abs(o.amplitude("x0") - 0.4**0.5) < 1e-6)
    assert together.omega == pytest.approx(1.2, rel=1e-9) and together.stability.verdict == "unstable"


def test_branches_about_another_equilibrium_of_an_odd_system():
    """Chua's circuit with a cubic, alpha^2 + 3 alpha = 63 at its Hopf points: mirror images with a mean."""
    x, y, z, alpha = C("x"), C("y"), C("z"), P("alpha", 7.0)
    system = hb.System(
        "Chua", [x, y, z], [alpha], [x.dot - alpha * (y - (x**3 / 16 - x / 6)), y.dot - (x - y + z), z.dot + 14 * y]
    )
    found = hb.find_cycles(system, alpha=7.0, interval=(6.0, 8.0))
    assert sum("from the branch from the Hopf point at alpha = 6.57774721" in s for s in found.evidence) == 2
    one, other = (o.coefficients[0, 0] for o in found)
    assert one == pytest.approx(-other, rel=1e-6) and one != 0


def test_running_motions_are_named():
    """A pendulum with torque I and damping d has no rest for I > 1: it runs on at about I / d."""
    x, torque, d = C("x"), P("I", 1.5), P("d", 0.2)
    system = hb.System("pendulum", [x], [torque, d], [x.ddot + d * x.dot + ca.sin(x) - torque])
    none = hb.find_cycles(system, I=1.5)
    assert none == [] and "no equilibrium" in none.evidence[0]
    said = none.evidence[0].partition("x goes on by a turn every ")[2]
    assert float(said.split(" ")[0]) == pytest.approx(2 * np.pi * 0.2 / 1.5, rel=1e-2)
