"""Equilibria over an interval and their Hopf points, against closed forms and published values."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

import hbbogie as hb
from hbbogie.equilibria import eigenpairs, matched
from hbbogie.model import poles, singular_terms, without_poles

C, P = hb.Coordinate, hb.Parameter
POSITIVE = (0.0, np.inf)


def oscillator(x, growth):
    """Return the equation of an oscillator of frequency 1 whose equilibrium loses its stability where growth > 0."""
    return x.ddot - growth * x.dot + x.dot**3 + x


def values(points):
    return [p.value for p in points]


def kinds(branch):
    return {(s.kind, round(s.value, 9)) for s in branch.special}


def brusselator(x, y, B, A=1.0):
    return A - (B + 1) * x + x**2 * y, B * x - x**2 * y


def hodgkin_huxley(unit=1.0):
    """Return Hodgkin and Huxley's equations with the voltage in units of ``unit`` mV."""
    x, m, h, n, current = C("V"), C("m"), C("h"), C("n"), P("I", 8.5)
    V, e = unit * x, ca.exp
    am, bm = 0.1 * (25 - V) / (e((25 - V) / 10) - 1), 4 * e(-V / 18)
    ah, bh = 0.07 * e(-V / 20), 1 / (e((30 - V) / 10) + 1)
    an, bn = 0.01 * (10 - V) / (e((10 - V) / 10) - 1), 0.125 * e(-V / 80)
    flow = current - 120 * m**3 * h * (V - 115) - 36 * n**4 * (V + 12) - 0.3 * (V - 10.599)
    rates = [am * (1 - m) - bm * m, ah * (1 - h) - bh * h, an * (1 - n) - bn * n]
    equations = [unit * x.dot - flow, *(c.dot - r for c, r in zip((m, h, n), rates, strict=True))]
    return hb.System("Hodgkin-Huxley", [x, m, h, n], [current], equations)


class TestEquilibria:
    def test_an_s_shaped_curve_with_its_folds(self):
        """lam = z^3 - z turns at z = -+1 / sqrt(3), lam = +-2 / (3 sqrt(3)); stable on the outer parts."""
        z, lam = C("z"), P("lam", 0.0)
        found = hb.find_equilibria(hb.System("s", [z], [lam], [z.dot - (lam + z - z**3)]), "lam", (-1.0, 1.0))
        (branch,) = found
        fold = 2 / (3 * np.sqrt(3))
        assert values(found.special("fold")) == pytest.approx([-fold, fold], abs=1e-11)
        for orbit in branch.orbits:
            x, stable = orbit.coefficients[0, 0], orbit.stability.verdict == "stable"
            assert orbit.H == 0 and orbit.omega == 0
            assert x**3 - x == pytest.approx(orbit.parameters["lam"], abs=1e-11)
            assert stable == (3 * x**2 > 1)

    def test_a_transcritical_point(self):
        x, z, p = C("x"), C("z"), P("p", 0.3)
        system = hb.System("s", [x, z], [p], [oscillator(x, z - 0.4), z.dot - (p * z - z**2)])
        found = hb.find_equilibria(system, "p", (-1.0, 1.0))
        assert len(found) == 2 and all(("branch point", 0.0) in kinds(b) for b in found)
        assert values(found.special("hopf")) == pytest.approx([0.4], abs=1e-11)

    def test_a_pitchfork_with_a_hopf_point_on_both_arms(self):
        x, z, p = C("x"), C("z"), P("p", 0.3)
        system = hb.System("s", [x, z], [p], [oscillator(x, z**2 - 0.5), z.dot - (p * z - z**3)])
        found = hb.find_equilibria(system, "p", (-1.0, 1.0))
        assert len(found) == 2
        assert kinds(found[0]) == {("branch point", 0.0)}
        assert kinds(found[1]) == {("branch point", 0.0), ("hopf", 0.5)}
        arms = sorted(h.orbit.coefficients[0, 1] for h in found.special("hopf"))
        assert arms == pytest.approx([-np.sqrt(0.5), np.sqrt(0.5)], abs=1e-11)

    @pytest.mark.parametrize("radius", [0.2, 0.01])
    def test_a_closed_curve_apart_from_everything(self, radius):
        """(z - 2)^2 + (p - 0.37)^2 = radius^2: folds at its ends, Hopf points where z - 2 is half the radius."""
        x, z, p = C("x"), C("z"), P("p", 0.0)
        curve = radius**2 - (p - 0.37) ** 2 - (z - 2) ** 2
        system = hb.System("s", [x, z], [p], [oscillator(x, z - 2 - radius / 2), z.dot - curve])
        found = hb.find_equilibria(system, "p", (-1.0, 1.0))
        (branch,) = found
        assert "closes" in str(branch.ends[0])
        assert values(found.special("fold")) == pytest.approx([0.37 - radius, 0.37 + radius], abs=1e-10)
        half = radius * np.sqrt(0.75)
        assert values(found.special("hopf")) == pytest.approx([0.37 - half, 0.37 + half], abs=1e-10)

    def test_a_branch_point_at_the_end_of_the_interval(self):
        """The circuit of Freire and others: its pitchfork lies at v = -0.5, where the interval ends."""
        module = hb.load_problem("circuit")
        points = hb.hopf_points(module.circuit(**module.SYMMETRIC), "v", (-0.7, -0.5))
        assert len(points) == 1
        assert len(hb.find_equilibria(module.circuit(**module.SYMMETRIC), "v", (-0.7, -0.5))) == 2

    def test_one_turn_of_an_angle(self):
        """A pendulum under a constant torque p = sin(x): one fold at p = 1, not one for every turn."""
        x, p = C("x", "rad"), P("p", 0.3)
        found = hb.find_equilibria(hb.System("s", [x], [p], [x.ddot + 0.1 * x.dot + ca.sin(x) - p]), "p", (-0.9, 2.0))
        assert len(found) == 1 and values(found.special("fold")) == pytest.approx([1.0], abs=1e-10)
        assert any("angle" in sentence for sentence in found.evidence)

    def test_bounds_are_respected_and_reported(self):
        """Predator and prey: the predator dies out below K = 8 / 17; negative numbers of it have no meaning."""
        found = hb.find_equilibria(predator_prey(POSITIVE), "K", (0.2, 20.0))
        assert min(o.coefficients.min() for b in found for o in b.orbits) >= 0
        assert values(found.special("branch point")) == pytest.approx([8 / 17, 8 / 17], abs=1e-9)
        assert any(end.what == "q reaches its bound 0" for b in found for end in b.ends)

    def test_starts_choose_one_branch(self):
        x, z, p = C("x"), C("z"), P("p", 0.3)
        system = hb.System("s", [x, z], [p], [oscillator(x, z - 0.4), z.dot - (p * z - z**2)])
        for start in ([0.0, 0.3], {"z": 0.3}, np.array([0.0, 0.3, 0.0])):
            (branch,) = hb.find_equilibria(system, "p", (0.1, 1.0), start=start)
            assert branch.orbits[0].coefficients[0, 1] == pytest.approx(branch.values[0], abs=1e-10)
        (again,) = hb.find_equilibria(system, "p", (0.1, 1.0), start=branch.orbits[3])
        assert again.orbits[0].coefficients[0, 1] == pytest.approx(again.values[0], abs=1e-10)
        assert values(hb.hopf_points(system, "p", (0.1, 1.0), start={"z": 0.0})) == []

    @pytest.mark.parametrize("start", [[1.0], [np.nan, 0.0], {"w": 1.0}, "here"])
    def test_starts_that_are_none(self, start):
        x, y, p = C("x"), C("y"), P("p", 0.3)
        system = hb.System("s", [x, y], [p], [x.dot - y, y.dot + p * x + y])
        with pytest.raises(hb.ModelError, match="start"):
            hb.find_equilibria(system, "p", (0.1, 1.0), start=start)

    def test_the_result_is_a_value(self, tmp_path):
        found = hb.find_equilibria(predator_prey(), "K", (1.0, 5.0))
        assert len(pickle.loads(pickle.dumps(found))) == len(found) and len(repr(found)) < 2000
        found[0].save(tmp_path / "rest.nc")
        again = hb.Branch.load(tmp_path / "rest.nc")
        np.testing.assert_array_equal(again.values, found[0].values)
        assert again.verdicts == found[0].verdicts
        points = pickle.loads(pickle.dumps(hb.hopf_points(predator_prey(), "K", (1.0, 5.0))))
        assert points.evidence and len(points) == 1 and len(repr(points)) < 1200


def predator_prey(bounds=(-np.inf, np.inf)):
    """Return predator q and prey n in a habitat of capacity K: Hopf point K = 33 / 17 at n = 8 / 17."""
    n, q, K = C("n", bounds=bounds), C("q", bounds=bounds), P("K", 3.0)
    g = 2.5 * n * q / (n + 1)
    return hb.System("s", [n, q], [K], [n.dot - (0.8 * n * (1 - n / K) - g), q.dot - (0.5 * g - 0.4 * q)])


class TestHopfPoints:
    """Each system with its own closed form, to 1e-9."""

    def test_a_mode_that_turns_from_focus_to_node_is_no_hopf_point(self):
        x, y, mu = C("x"), C("y"), P("mu", 1.0)
        passive = y.ddot + 0.2 * y.dot + 4 * y + 0.1 * x
        system = hb.System("s", [x, y], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x, passive])
        assert values(hb.hopf_points(system, "mu", (0.5, 3.0))) == []

    def test_beyond_a_fold(self):
        x, z, lam = C("x"), C("z"), P("lam", 0.0)
        system = hb.System("s", [x, z], [lam], [oscillator(x, z - 0.8), z.dot - (lam + z - z**3)])
        assert values(hb.hopf_points(system, "lam", (-1.0, 1.0))) == pytest.approx([0.512 - 0.8], abs=1e-10)

    @pytest.mark.parametrize("bounds", [(-np.inf, np.inf), POSITIVE])
    def test_away_from_zero(self, bounds):
        assert values(hb.hopf_points(predator_prey(bounds), "K", (1.0, 20.0))) == pytest.approx([33 / 17], abs=1e-10)

    @pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
    def test_lorenz_in_any_unit(self, unit):
        x, y, z, r = C("x"), C("y"), C("z"), P("r", 20.0)
        equations = [
            x.dot - 10 * (y - x),
            y.dot - (r * x - y - x * z / unit),
            z.dot - (x * y / unit - 8 / 3 * z),
        ]
        points = hb.hopf_points(hb.System("Lorenz", [x, y, z], [r], equations), "r", (10.0, 30.0))
        assert values(points) == pytest.approx([470 / 19] * 2, rel=1e-11)
        assert sorted(np.sign(h.orbit.coefficients[0, 0]) for h in points) == [-1, 1]

    @pytest.mark.parametrize("unit", [1.0, 50.0, 1e-3])
    def test_hodgkin_huxley_in_any_unit(self, unit):
        """PUBLISHED digits: 9.779637995 and 154.526633666; rest moves by 50 mV, two rates have a removable pole."""
        points = hb.hopf_points(hodgkin_huxley(unit), "I", (0.0, 200.0))
        assert values(points) == pytest.approx([9.779637995, 154.526633666], abs=6e-10)

    def test_morris_lecar(self):
        """PUBLISHED digits: 93.857618 and 212.018816."""
        V, w, current = C("V", "mV"), C("w"), P("I", 90.0)
        m, winf = (1 + ca.tanh((V + 1.2) / 18)) / 2, (1 + ca.tanh((V - 2) / 30)) / 2
        flow = current - 2 * (V + 60) - 8 * w * (V + 84) - 4.4 * m * (V - 120)
        rate = w.dot - 0.04 * (winf - w) * ca.cosh((V - 2) / 60)
        system = hb.System("Morris-Lecar", [V, w], [current], [20 * V.dot - flow, rate])
        assert values(hb.hopf_points(system, "I", (0.0, 300.0))) == pytest.approx([93.857618, 212.018816], abs=6e-7)

    def test_fitzhugh_nagumo(self):
        """v^2 = 1 - 0.064 at the Hopf points, I = (v + 0.7) / 0.8 - v + v^3 / 3."""
        v, w, current = C("v"), C("w"), P("I", 0.5)
        system = hb.System(
            "s", [v, w], [current], [v.dot - (v - v**3 / 3 - w + current), w.dot - 0.08 * (v + 0.7 - 0.8 * w)]
        )
        at = np.array([-1, 1]) * np.sqrt(1 - 0.064)
        truth = (at + 0.7) / 0.8 - at + at**3 / 3
        assert values(hb.hopf_points(system, "I", (0.0, 2.0))) == pytest.approx(list(truth), abs=1e-11)

    def test_a_double_pair_is_one_point(self):
        """A ring of three Stuart-Landau oscillators: a double pair at m = -0.6, a single one at m = 0."""
        points = hb.hopf_points(ring(3), "m", (-1.0, 1.0))
        assert values(points) == pytest.approx([-0.6, 0.0], abs=1e-11)
        assert "double" in points[0].status and "2 pairs" in points[0].status and "pairs" not in points[1].status

    def test_three_pairs_at_once(self):
        m, q = P("m", 0.5), [C(f"{a}{i}") for i in range(3) for a in "xy"]
        equations = [
            e
            for x, y in zip(q[::2], q[1::2], strict=True)
            for e in (x.dot - (m * x - y - x**3), y.dot - (m * y + x - y**3))
        ]
        (point,) = hb.hopf_points(hb.System("s", q, [m], equations), "m", (-1.0, 2.0))
        assert point.value == pytest.approx(0.0, abs=1e-11) and "3 pairs" in point.status

    def test_pairs_of_two_frequencies_are_two_points_that_name_each_other(self):
        x, y, p = C("x"), C("y"), P("p", 0.1)
        system = hb.System("s", [x, y], [p], [oscillator(x, p), y.ddot - p * y.dot + 4 * y + y**3])
        points = hb.hopf_points(system, "p", (-1.0, 1.5))
        assert sorted(h.omega for h in points) == pytest.approx([1.0, 2.0], abs=1e-11)
        assert all("another pair" in h.status for h in points)

    @pytest.mark.parametrize("rate", [1e4, 1e7, 1e10, 1e14])
    def test_stiffness_loses_nothing(self, rate):
        """Brusselator with a fast filter that acts back on it: the Hopf point moves by about 1 / rate."""
        x, y, z, B = C("x"), C("y"), C("z"), P("B", 2.5)
        f, g = brusselator(x, y, B)
        system = hb.System("s", [x, y, z], [B], [x.dot - f - 0.3 * (z - x), y.dot - g, z.dot + rate * (z - x)])
        (point,) = hb.hopf_points(system, "B", (1.0, 4.0))
        assert point.value == pytest.approx(2.0, abs=1e-9 + 2 / rate)

    @pytest.mark.parametrize("width", [1e-2, 1e-3, 1e-4, 3e-5])
    def test_across_and_back_within_one_step(self, width):
        x, m = C("x"), P("m", 0.3)
        system = hb.System("s", [x], [m], [x.ddot + ((m - 0.5) ** 2 - width**2) * x.dot + x + x**3])
        points = hb.hopf_points(system, "m", (0.0, 1.03))
        assert values(points) == pytest.approx([0.5 - width, 0.5 + width], abs=1e-9)
        assert "gains" in points[0].status and "loses" in points[1].status

    def test_eigenvalues_that_touch_the_axis_are_no_hopf_point(self):
        x, m = C("x"), P("m", 0.3)
        system = hb.System("s", [x], [m], [x.ddot + (m - 0.5) ** 2 * x.dot + x + x**3])
        points = hb.hopf_points(system, "m", (0.0, 1.03))
        assert points == [] and any("imaginary axis" in s for s in points.evidence)

    def test_at_the_end_of_the_interval(self):
        x, p = C("x"), P("p", 0.1)
        (point,) = hb.hopf_points(hb.System("s", [x], [p], [oscillator(x, p)]), "p", (0.0, 1.0))
        assert point.value == 0.0

    @pytest.mark.parametrize("b", [1e-2, 1e-4])
    def test_beside_a_bogdanov_takens_point(self, b):
        """x' = y, y' = p - b x + x^2 - x y: Hopf point p = 0, omega = sqrt(b), fold p = b^2 / 4 close by."""
        x, y, p = C("x"), C("y"), P("p", 0.0)
        system = hb.System("s", [x, y], [p], [x.dot - y, y.dot - (p - b * x + x**2 - x * y)])
        (point,) = hb.hopf_points(system, "p", (-(b**2), b**2))
        assert point.value == pytest.approx(0.0, abs=1e-12) and point.omega == pytest.approx(np.sqrt(b), rel=1e-9)

    def test_two_real_eigenvalues_of_opposite_sign_are_no_hopf_point(self):
        """A saddle whose eigenvalues 1 and p - 1 add up to nothing at p = 0."""
        x, y, p = C("x"), C("y"), P("p", 0.1)
        system = hb.System("s", [x, y], [p], [x.dot - x + y**2, y.dot - (p - 1) * y])
        assert values(hb.hopf_points(system, "p", (-0.9, 0.9))) == []

    def test_a_double_zero_is_none(self):
        """x'' = p x: the eigenvalues meet at zero and part along the axis."""
        x, p = C("x"), P("p", 0.1)
        points = hb.hopf_points(hb.System("s", [x], [p], [x.ddot - p * x + x**3 + 0.1 * x.dot**3]), "p", (-1.0, 1.0))
        assert values(points) == []

    def test_eigenvalues_on_the_axis_are_reported_once(self):
        x, y, k = C("x"), C("y"), P("k", 1.0)
        for equations in ([x.dot + k * y, y.dot - x], [x.dot - x * (k - y), y.dot - y * (x - 1)]):
            points = hb.hopf_points(hb.System("s", [x, y], [k], equations), "k", (0.5, 2.0))
            assert points == [] and sum("imaginary axis" in sentence for sentence in points.evidence) == 1

    def test_weak_damping_is_not_called_neutral(self):
        """Twenty coupled oscillators damped by 1e-6: all eigenvalues left of the axis, by 5e-7."""
        x, p = [C(f"x{i}") for i in range(20)], P("p", 0.0)
        sides = [[*x[:i][-1:], *x[i + 1 :][:1]] for i in range(20)]
        equations = [q.ddot + 1e-6 * (1 + p) * q.dot + 2 * q - sum(side) for q, side in zip(x, sides, strict=True)]
        points = hb.hopf_points(hb.System("s", x, [p], equations), "p", (0.0, 1.0))
        assert points == [] and not any("axis" in sentence for sentence in points.evidence)

    @pytest.mark.parametrize("n", [12, 55])
    def test_brusselator_on_a_line(self, n):
        """Ends held: of the k-th wave, trace zero at L^2 = 0.012 * 4 n^2 sin(k pi / (2 n))^2 / (B - 1 - A^2)."""
        A, B, L = 2.0, 5.45, P("L", 0.6)
        x, y = [C(f"x{i}") for i in range(n)], [C(f"y{i}") for i in range(n)]

        def spread(u, end, i):
            left, right = u[i - 1] if i else 2 * end - u[0], u[i + 1] if i < n - 1 else 2 * end - u[-1]
            return (left - 2 * u[i] + right) * n**2 / L**2

        equations = []
        for i in range(n):
            f, g = brusselator(x[i], y[i], B, A)
            equations += [x[i].dot - f - 0.008 * spread(x, A, i), y[i].dot - g - 0.004 * spread(y, B / A, i)]
        q = [c for pair in zip(x, y, strict=True) for c in pair]
        points = hb.hopf_points(hb.System("line", q, [L], equations), "L", (0.4, 1.7))
        waves = 2 * n * np.sin(np.arange(1, 4) * np.pi / (2 * n))
        assert values(points) == pytest.approx(waves * np.sqrt(0.012 / (B - 1 - A**2)), rel=1e-9)


def ring(n):
    m, q = P("m", 0.5), [C(f"{a}{i}") for i in range(n) for a in "xy"]
    equations = []
    for i in range(n):
        x, y = q[2 * i], q[2 * i + 1]
        s, lx, ly = x * x + y * y, sum(q[::2]) - n * x, sum(q[1::2]) - n * y
        equations += [x.dot - (m * x - y - s * x - 0.2 * lx), y.dot - (m * y + x - s * y - 0.2 * ly)]
    return hb.System("ring", q, [m], equations)


class TestConserved:
    def test_a_total(self):
        """Brusselator with its waste kept: x + y + w is constant; Hopf point B = 2 on every level."""
        x, y, w, B = C("x"), C("y"), C("w"), P("B", 2.5)
        f, g = brusselator(x, y, B)
        system = hb.System("s", [x, y, w], [B], [x.dot - f, y.dot - g, w.dot + (1 - x)])
        points = hb.hopf_points(system, "B", (1.0, 4.0))
        assert values(points) == pytest.approx([2.0], abs=1e-11)
        assert any("x + y + w is conserved" in sentence for sentence in points.evidence)
        (branch,) = hb.find_equilibria(system, "B", (1.0, 4.0), start=[1.0, 2.0, 4.0])
        totals = [o.coefficients[0].sum() for o in branch.orbits]
        np.testing.assert_allclose(totals, 7.0, atol=1e-10)
        assert {*branch.verdicts} == {"stable", "unstable"}

    def test_a_weighted_total(self):
        """Two of a make one b: a + 2 b is conserved, a^2 p = b."""
        a, b, p = C("a", bounds=POSITIVE), C("b", bounds=POSITIVE), P("p", 1.0)
        rate = p * a**2 - b
        system = hb.System("s", [a, b], [p], [a.dot + 2 * rate, b.dot - rate])
        found = hb.find_equilibria(system, "p", (0.5, 2.0), start={"a": 3.0})
        assert any("a + 2 b is conserved" in s and "held at 3" in s for s in found.evidence)
        for orbit in found[0].orbits:
            at, p_at = orbit.coefficients[0], orbit.parameters["p"]
            root = (np.sqrt(1 + 24 * p_at) - 1) / (4 * p_at)
            assert at == pytest.approx([root, (3 - root) / 2], abs=1e-10)

    def test_bodies_that_are_free_to_move(self):
        """Two masses on a spring and nothing else: the pair loses its damping at p = 0, omega^2 = 1 + 1 / 2."""
        x, y, p = C("x", "m"), C("y", "m"), P("p", 0.1)
        force = (x - y) + (x - y) ** 3 - p * (x.dot - y.dot)
        system = hb.System("s", [x, y], [p], [x.ddot + force, 2 * y.ddot - force])
        (point,) = hb.hopf_points(system, "p", (-0.5, 0.6))
        assert point.value == pytest.approx(0.0, abs=1e-12) and point.omega == pytest.approx(np.sqrt(1.5), rel=1e-11)

    def test_a_family_at_one_value_of_the_parameter(self):
        """x'' = -p x with a growing y: at p = 0 every x rests; that is no branch and holds no Hopf point."""
        x, y, p = C("x"), C("y"), P("p", 0.5)
        system = hb.System("s", [x, y], [p], [x.ddot + 0.5 * x.dot + p * (x + x**3), oscillator(y, p - 0.3)])
        found = hb.find_equilibria(system, "p", (-1.0, 1.0))
        assert values(found.special("hopf")) == pytest.approx([0.3], abs=1e-11)
        assert len(found) == 1 and np.ptp(found[0].values) == 2.0

    def test_a_circle_of_equilibria_is_named(self):
        """z' = (p - |z|^2) z has a circle of equilibria for every p > 0."""
        x, y, p = C("x"), C("y"), P("p", 0.5)
        growth = p - x**2 - y**2
        found = hb.find_equilibria(hb.System("s", [x, y], [p], [x.dot - growth * x, y.dot - growth * y]), "p", (-1, 1))
        assert any("families" in sentence for sentence in found.evidence) and found.special("hopf") == []

    def test_a_family_that_no_linear_quantity_makes(self):
        """Epidemic without births: every (S, 0, R) rests; the one at the start loses its stability at b S = 1."""
        S, sick, R, b = C("S"), C("I"), C("R"), P("b", 2.0)
        system = hb.System("s", [S, sick, R], [b], [S.dot + b * S * sick, sick.dot - b * S * sick + sick, R.dot - sick])
        found = hb.find_equilibria(system, "b", (0.5, 3.1), start=[1.0, 0.0, 0.0])
        assert any("family" in sentence for sentence in found.evidence)
        for orbit in found[0].orbits:
            assert orbit.coefficients[0, 0] == pytest.approx(1.0, abs=1e-10)
            assert orbit.stability.verdict == ("unstable" if orbit.parameters["b"] > 1 else "stable")


class TestNotSmooth:
    def test_a_root_at_rest_that_does_no_harm(self):
        """r' = r (r^2 - 3 r + k): the derivative at zero exists as a limit, the formula for it does not."""
        x, y, k = C("x"), C("y"), P("k", 1.0)
        r = ca.sqrt(x**2 + y**2)
        growth = r**2 - 3 * r + k
        system = hb.System("s", [x, y], [k], [x.dot - (x * growth - y), y.dot - (y * growth + x)])
        points = hb.hopf_points(system, "k", (-1.0, 2.0))
        assert values(points) == pytest.approx([0.0], abs=1e-9)
        assert any("root of" in s and "equation 1" in s for s in points.evidence)
        np.testing.assert_allclose(system.state_matrix(np.zeros(2), system.vector()), [[1, -1], [1, 1]], atol=1e-9)

    def test_a_root_at_rest_with_an_infinite_slope(self):
        """The slope of sqrt(|x|) at zero is infinite: another equilibrium is found, x = k^2, and zero is named."""
        x, k = C("x"), P("k", 1.0)
        system = hb.System("s", [x], [k], [x.dot - (k * ca.sqrt(ca.fabs(x)) - x)])
        found = hb.find_equilibria(system, "k", (0.5, 2.0))
        assert any("not finite" in s and "root" in s for s in found.evidence)
        away = [b for b in found if b.orbits[0].coefficients[0, 0] > 0.1]
        assert len(away) == 1
        for orbit in away[0].orbits:
            assert orbit.coefficients[0, 0] == pytest.approx(orbit.parameters["k"] ** 2, abs=1e-10)
        with pytest.raises(hb.ConvergenceError, match="no derivative"):
            system.state_matrix(np.zeros(1), system.vector())

    def test_a_pole_of_the_parameter_divides_the_interval(self):
        x, y, z, mu = C("x"), C("y"), C("z"), P("mu", 1.0)
        equations = [x.dot - y, y.dot + x / mu - (z - 0.5) * y + y**3, z.dot + z - mu]
        system = hb.System("s", [x, y, z], [mu], equations)
        points = hb.hopf_points(system, "mu", (-1.0, 2.0))
        assert values(points) == pytest.approx([0.5], abs=1e-11)
        assert any("mu = 0" in s and "equation 2 divides by mu" in s for s in points.evidence)

    def test_a_default_interval_ends_at_a_pole(self):
        x, y, mu = C("x"), C("y"), P("mu", 0.05)
        system = hb.System("s", [x, y], [mu], [x.dot - mu * (y - x**3 / 3 + x), y.dot + x / mu])
        low, high = without_poles(system, "mu", (-1.0, 1.0))
        assert 0 < low < 1e-5 and high == 1.0
        with pytest.raises(hb.ModelError, match="divides by mu"):
            hb.find_cycles(system, mu=0.0)

    def test_what_may_not_vanish(self):
        x, k, d = C("x"), P("k", 1.0), P("d", 1.0)
        system = hb.System("s", [x], [k, d], [x.dot + x / (k - 0.5) ** 2 + ca.log(x + 2) + ca.sqrt(d)])
        labels = " ".join(singular_terms(system).labels)
        assert "divides by" in labels and "logarithm of" in labels and "root of d" in labels
        assert [*poles(system, "k", (0.0, 1.0))] == pytest.approx([0.5], abs=1e-6)
        assert poles(system, "k", (0.6, 1.0)) == {}


class TestEigenvalues:
    def test_slow_eigenvalues_beside_fast_ones(self):
        """A block of size 1 with the eigenvalues -1 +- 2 i, coupled to rates of 1e13 that leave it nearly alone."""
        A = np.array([[-1.0, -2.0, 0.0], [2.0, -1.0, 0.0], [3e13, 0.0, -1e13]])
        found = eigenpairs(A)[0]
        slow = found[np.abs(found) < 10]
        assert sorted(slow, key=lambda z: z.imag) == pytest.approx([-1 - 2j, -1 + 2j], abs=1e-12)

    def test_matching_is_not_by_order(self):
        a = np.array([-1.0 + 3j, -1.1 + 1j, -1e9])
        b = np.array([-1e9 + 5, -1.12 + 3j, -0.9 + 1j])
        assert [*matched(a, b)] == [2, 0, 1]


class TestBounds:
    def test_they_travel_with_the_coordinate(self):
        x = pickle.loads(pickle.dumps(C("x", "mol", "a concentration", bounds=(0, 2))))
        assert x.bounds == (0.0, 2.0) and x.unit == "mol"
        assert C("y").bounds == (-np.inf, np.inf)

    def test_wrong_ones(self):
        with pytest.raises(hb.ModelError, match="low < high"):
            C("x", bounds=(1.0, 0.0))


def test_a_family_at_one_value_does_not_hide_the_others():
    """Chua's circuit with a cubic: at alpha = 0 any x will do; beside zero x^2 = 8/3 rests at every alpha.

    There alpha^2 + 3 alpha = 63 at the Hopf points, by the Hurwitz determinant.
    """
    x, y, z = (hb.Coordinate(name) for name in "xyz")
    alpha = hb.Parameter("alpha", 9.0)
    equations = [x.dot - alpha * (y - (x**3 / 16 - x / 6)), y.dot - (x - y + z), z.dot + 14 * y]
    found = hb.find_equilibria(hb.System("Chua", [x, y, z], [alpha], equations), "alpha", (-24.0, 40.0))
    assert len(found) == 3
    values = sorted(s.value for s in found.special("hopf"))
    root = 261**0.5
    assert values == pytest.approx(sorted([(-3 - root) / 2, (-3 + root) / 2] * 2), rel=1e-9)
