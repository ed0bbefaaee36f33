"""Vector fields that jump: the law, harmonic balance, multipliers with jump matrices, shooting, motion in time."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import hbbogie as hb
from hbbogie import fourier
from hbbogie.errors import ModelError
from hbbogie.results import ConvergenceError
from hbbogie.stability import Waveforms, hill, passages_of
from hbbogie.stability.verification import _closed

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def relay(zeta, F, law=hb.model.CoulombFriction):
    """x'' + 2 zeta x' + x = F sign(x'): a clock."""
    x, z, f = hb.Coordinate("x"), hb.Parameter("zeta", zeta), hb.Parameter("F", F)
    kick = hb.Element("kick", law(f), x.dot)
    return hb.System("relay", [x], [z, f], [x.ddot + 2 * z * x.dot + x - kick], [kick])


def relay_cycle(zeta, F):
    """Period, peak and multiplier of the half-period map, in closed form.

    From rest at -A the mass swings about F, and in half a damped period A + F shrinks by q: A = F + (A + F) q. The
    map A -> F + (A + F) q has the slope q.
    """
    frequency = np.sqrt(1 - zeta**2)
    q = np.exp(-zeta * np.pi / frequency)
    return 2 * np.pi / frequency, F * (1 + q) / (1 - q), q


def belt(F, law=hb.model.CoulombFriction):
    """Van der Pol's oscillator rubbing on a belt that runs at half the unit of speed."""
    x, f, v = hb.Coordinate("x"), hb.Parameter("F", F), hb.Parameter("v", 0.5)
    dry = hb.Element("dry", law(f), x.dot - v)
    return hb.System("belt", [x], [f, v], [x.ddot - (1 - x**2) * x.dot + x + dry], [dry])


def wave(system, amplitude, omega=1.0):
    """A cosine as the guess of a cycle of one coordinate."""
    c = np.array([[0.0], [amplitude], [0.0]])
    return hb.Orbit(system.name, system.coordinate_names, ("",), c, omega, dict(system.values))


@pytest.fixture(scope="module")
def piecewise():
    module = hb.load_problem("piecewise")
    system = module.piecewise()
    settled = hb.motion.settle(system, {"x": 1.0})
    assert settled.kind == "cycle"
    guess = hb.motion.last_orbit(system, settled.trajectory, 63)
    orbits = [hb.solve(hb.HarmonicBalance(H).equations(system), guess) for H in (15, 31, 63)]
    return module.PUBLISHED[0], system, orbits, settled


class TestLaws:
    def test_step(self):
        """IDENTITY: 0 below the threshold, the height above, half of it there."""
        force = ca.Function("f", [u := ca.SX.sym("u")], [hb.model.Step(3.0, 0.5).force(u)])
        assert [float(force(s)) for s in (-1.0, 0.4, 0.5, 0.6, 9.0)] == [0.0, 0.0, 1.5, 3.0, 3.0]

    @pytest.mark.parametrize("law", [hb.model.Step(2.0, 0.7), hb.model.Step(2.0, -0.7), hb.model.CoulombFriction(3.0)])
    def test_describing_function(self, law):
        """SOLVER: the closed form is the first harmonic by quadrature."""
        for Y in (0.5, 0.8, 3.0):
            values = [hb.methods.describing_function(law, Y, method=m) for m in ("closed", "quadrature")]
            assert values[0] == pytest.approx(values[1], abs=1e-11)

    def test_second_order(self):
        """IDENTITY: eq-describing-feedback with the harmonics 2 h sin(n t)/(pi n) of a pulse of the angle t."""
        h, g, Y, k = 2.0, 0.7, 1.3, 5.0
        t, dt = np.arccos(g / Y), g / (Y * np.sqrt(Y**2 - g**2))
        n = np.arange(2, 202)
        f, slope = 2 * h * np.sin(n * t) / (np.pi * n), 2 * h * np.cos(n * t) * dt / np.pi
        fed_back = -2 * (h * t / np.pi) * (h * dt / np.pi) + np.sum(f * slope / (n**2 - 1))
        expected = 2 * h * np.sin(t) / (np.pi * Y) + fed_back / (k * Y)
        law = hb.model.Step(h, g)
        assert hb.methods.describing_function(law, Y, order=2, reference=k) == pytest.approx(expected, rel=1e-12)
        with pytest.raises(ModelError, match="quadrature at order 2 does not see how the jumps"):
            hb.methods.describing_function(law, Y, order=2, reference=k, method="quadrature")

    def test_an_argument_that_itself_jumps_is_refused(self):
        x, y, c = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("c", 1.0)
        kick = hb.Element("kick", hb.model.Step(), x.dot)
        system = hb.System("circular", [x, y], [c], [x.dot - y + 0.1 * kick, y.dot + c * x], [kick])
        orbit = hb.Orbit("circular", ("x", "y"), ("", ""), np.eye(3)[:, 1:], 1.0, dict(system.values))
        with pytest.raises(ModelError, match="contains a rate that itself jumps"):
            hb.floquet(system, orbit)


class TestHarmonicBalance:
    @pytest.mark.parametrize("odd", [True, False])
    def test_derivatives(self, odd):
        """SOLVER: first and second derivatives agree with central differences, jumps and all."""
        system = relay(0.1, 1.0)
        equations = hb.HarmonicBalance(5, odd=odd).equations(system)
        orbit = hb.solve(equations, wave(system, 6.0))
        z, p = equations.encode(orbit), system.vector()
        # 192 samples: no jump comes so close to the end of its sample that a difference steps over it
        z = z + 1e-2 * np.random.default_rng(3).standard_normal(len(z))
        pull = np.random.default_rng(4).standard_normal(equations.residual(z, p).shape[0])
        derivatives, y = equations.derivatives((1,)), np.r_[z, p[1]]

        def values(y):
            F, J = (m.full() for m in derivatives(y[:-1], [p[0], y[-1]]))
            return F.ravel(), pull @ J

        h, J = 1e-6, derivatives(z, p)[1].full()
        pairs = [[values(y + s * h * e) for s in (1, -1)] for e in np.eye(len(y))]
        np.testing.assert_allclose(J, np.array([(a[0] - b[0]) / (2 * h) for a, b in pairs]).T, atol=1e-7)
        H = equations.hessian((1,))(z, p, pull).full()
        expected = np.array([(a[1] - b[1]) / (2 * h) for a, b in pairs])
        np.testing.assert_allclose(H, expected, atol=1e-6 * np.abs(expected).max())

    def test_sampling_converges_at_second_order(self):
        """ORDER: the first harmonic of F sign(x') over a cosine is 4 F/pi; spread over a sample the error is N^-2."""
        system, errors = relay(0.1, 1.0), []
        tilted = wave(system, 1.0).replace(coefficients=np.array([[0.3], [0.8], [0.6], [0.1], [-0.05]]))
        for N in (64, 128, 256, 16384):
            equations = hb.HarmonicBalance(2, samples=N, odd=False).equations(system)
            errors.append(equations.residual(equations.encode(tilted), system.vector()).full().ravel())
        sizes = [np.abs(e - errors[-1]).max() for e in errors[:3]]
        assert np.log2(sizes[0] / sizes[2]) / 2 == pytest.approx(2.0, abs=0.3)

    def test_cycles_converge_at_first_order(self, piecewise):
        """ORDER: the rates jump, coefficients decay like h^-2, and the period's error like 1/H."""
        published, _, orbits, _ = piecewise
        errors = [abs(o.period - published.period) for o in orbits]
        assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(1.0, abs=0.1)

    def test_one_harmonic_is_the_describing_function(self):
        """SOLVER: but for the sampling, N^-2, which 4096 samples make small."""
        system = relay(0.1, 1.0)
        one = hb.solve(hb.HarmonicBalance(1, samples=4096).equations(system), wave(system, 6.0))
        first = hb.solve(hb.DescribingFunction().equations(system), wave(system, 6.0))
        assert first.amplitude("x") == pytest.approx(4 / (np.pi * 0.2), rel=1e-9)
        assert one.amplitude("x") == pytest.approx(first.amplitude("x"), rel=1e-6)


class TestPublished:
    def test_verify(self, piecewise):
        """PUBLISHED: Dankowicz and Schilder (2013), all digits of period and multiplier."""
        published, system, orbits, _ = piecewise
        for orbit in orbits:
            checked = hb.verify(system, orbit)
            assert checked.orbit.period == pytest.approx(published.period, abs=0.5e-12)
            assert abs(checked.multipliers[0] - 1) < 1e-9
            assert checked.multipliers[1] == pytest.approx(published.multiplier, abs=0.5e-8)
            assert checked.orbit.stability.verdict == "stable"

    def test_floquet(self, piecewise):
        """ORDER: multipliers along the series are as good as the orbit, 1/H."""
        published, system, orbits, _ = piecewise
        found = [hb.floquet(system, orbit) for orbit in orbits]
        assert found[-1].verdict == "stable"
        errors = np.array([abs(s.multipliers[1] - published.multiplier) for s in found])
        assert errors[-1] < 0.02 * published.multiplier
        assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(1.0, abs=0.1)

    def test_find_cycles(self, piecewise):
        published, system, _, _ = piecewise
        (cycle,) = hb.find_cycles(system, harmonics=31)
        assert cycle.stability.verdict == "stable"
        assert cycle.errors["omega"] == pytest.approx(abs(cycle.omega - 2 * np.pi / published.period), abs=1e-11)

    def test_motion_in_time(self, piecewise):
        """ORDER: steps are divided at the jumps, and Runge-Kutta keeps its order, 4."""
        published, system, _, settled = piecewise
        assert 2 * np.pi / settled.omega == pytest.approx(published.period, abs=1e-9)
        radius = 1.9341470031896355  # where the cycle crosses x = 0, from a solver that stops there
        ends = [
            hb.simulate(system, {"x": -1e-14, "y": radius}, published.period, step=h).q[-1] for h in (0.1, 0.05, 0.025)
        ]
        errors = [np.abs(q - [0, radius]).max() for q in ends]
        assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx(4.0, abs=0.2)


class TestRelay:
    @pytest.mark.parametrize(("zeta", "F", "verdict"), [(0.1, 1.0, "stable"), (-0.1, -1.0, "unstable")])
    def test_closed_form(self, zeta, F, verdict):
        """SOLVER: a stable clock, and an unstable balance of dry friction and negative damping."""
        system, (period, peak, q) = relay(zeta, F), relay_cycle(zeta, F)
        orbit = hb.solve(hb.HarmonicBalance(15).equations(system), wave(system, peak))
        checked = hb.verify(system, orbit)
        assert checked.orbit.period == pytest.approx(period, rel=1e-10)
        assert checked.amplitudes["x"] == pytest.approx(peak, rel=1e-10)
        others = np.delete(checked.multipliers, np.argmin(np.abs(checked.multipliers - 1)))
        assert others == pytest.approx(q**2, rel=1e-9)
        assert checked.orbit.stability.verdict == verdict
        found = hb.floquet(system, orbit)
        assert found.verdict == verdict
        assert np.abs(found.multipliers - q**2).min() < 1e-3 * q**2
        assert np.abs(found.half_multipliers - q).min() < 1e-3 * q

    def test_no_phase_is_special(self):
        """SOLVER: wherever the time origin is, at a jump too, whole and half a period give the same multipliers."""
        system, (_, peak, _) = relay(0.1, 1.0), relay_cycle(0.1, 1.0)
        orbit = hb.solve(hb.HarmonicBalance(7).equations(system), wave(system, peak))
        at_jump = Waveforms(system, [orbit], system.vector()[None]).switchings()[0][0]
        expected = hb.floquet(system, orbit, steps=4096).multipliers
        for angle in (at_jump, at_jump + np.pi, at_jump + 3e-10, at_jump - 3e-10, 0.3, 2.0):
            moved = orbit.replace(coefficients=fourier.shift(orbit.coefficients, angle))
            for half in (True, False):
                found = hb.floquet(system, moved, half=half, steps=4096)
                assert found.multipliers == pytest.approx(expected, rel=1e-7)
            assert hb.verify(system, moved).orbit.omega == pytest.approx(np.sqrt(0.99), rel=1e-10)

    def test_simultaneous_jumps_have_no_jump_matrix(self):
        """Two clocks that strike at the same time: which comes first makes a difference of first order."""
        x, y, z = hb.Coordinate("x"), hb.Coordinate("y"), hb.Parameter("zeta", 0.1)
        kicks = [hb.Element(f"kick {c.name}", hb.model.CoulombFriction(1.0), c.dot) for c in (x, y)]
        equations = [c.ddot + 2 * z * c.dot + c - k for c, k in zip((x, y), kicks, strict=True)]
        pair, one = hb.System("pair", [x, y], [z], equations, kicks), relay(0.1, 1.0)
        orbit = hb.solve(hb.HarmonicBalance(15).equations(one), wave(one, 6.0))
        both = hb.Orbit("pair", ("x", "y"), ("", ""), np.tile(orbit.coefficients, 2), orbit.omega, {"zeta": 0.1})
        found = hb.floquet(pair, both)
        assert found.verdict == "unknown"
        assert "jump at the same time" in found.reason

    def test_hill_refuses(self):
        system = relay(0.1, 1.0)
        with pytest.raises(ModelError, match="does not see jumps of the vector field \\(kick\\)"):
            hill(system, wave(system, 6.0))


class TestRelayFeedback:
    """Three lags of one second in a loop with a relay, all of first order.

    Half a period h later the state is its mirror image, x(h) = -x(0), and just before the relay switches the rate is w.
    The multipliers over half a period are the eigenvalues of -(I - w C/(C w)) exp(A h), and 1 (K. J. Astrom,
    Oscillations in systems with relay feedback, in Adaptive Control, Filtering, and Signal Processing, Springer 1995).
    """

    def closed_form(self):
        A, B, C = np.array([[-1.0, 1, 0], [0, -1, 1], [0, 0, -1]]), np.array([0.0, 0, 1]), np.array([1.0, 0, 0])

        def start(h):
            flow = expm(A * h)
            return np.linalg.solve(flow + np.eye(3), np.linalg.solve(A, (flow - np.eye(3)) @ B))

        h = brentq(lambda h: C @ start(h), 1.0, 3.0, xtol=1e-15)
        w = -A @ start(h) - B
        others = np.linalg.eigvals(-(np.eye(3) - np.outer(w, C) / (C @ w)) @ expm(A * h))
        return h, sorted(others[np.abs(others) > 1e-12].real)

    def system(self):
        x, k = [hb.Coordinate(f"x{i}") for i in (1, 2, 3)], hb.Parameter("k", 1.0)
        relay = hb.Element("relay", hb.model.CoulombFriction(k), x[0])
        lags = [x[0].dot + x[0] - x[1], x[1].dot + x[1] - x[2], x[2].dot + x[2] + relay]
        return hb.System("relay feedback", x, [k], lags, [relay])

    def test_found_without_a_guess(self):
        """SOLVER: found by simulation, closed by shooting; ORDER: multipliers along the series converge."""
        system, (h, halves) = self.system(), self.closed_form()
        (cycle,) = hb.find_cycles(system, harmonics=31)
        checked = hb.verify(system, cycle)
        assert checked.orbit.period == pytest.approx(2 * h, rel=1e-11)
        assert checked.multipliers == pytest.approx([1.0, halves[1] ** 2, halves[0] ** 2], rel=1e-8)
        assert cycle.stability.verdict == "stable"
        assert cycle.stability.half_multipliers[1:] == pytest.approx(halves[::-1], rel=1e-3)

    def test_settles(self):
        """SOLVER: on a period to which the samples, 1 ms apart, do not limit it."""
        settled = hb.motion.settle(self.system(), {"x1": 1.0})
        assert np.pi / settled.omega == pytest.approx(self.closed_form()[0], rel=1e-8)
        assert np.pi / hb.motion.last_orbit(self.system(), settled.trajectory, 9).omega == pytest.approx(
            self.closed_form()[0], rel=1e-3
        )


def test_jumps_and_contacts_together():
    """SOLVER: friction on a belt and stops behind a gap: shooting and motion in time agree."""
    x, f = hb.Coordinate("x"), hb.Parameter("F", 0.2)
    dry, stops = (
        hb.Element("dry", hb.model.CoulombFriction(f), x.dot - 0.5),
        hb.Element("stops", hb.model.DeadBand(5.0, 1.5), x),
    )
    equations = [x.ddot - (1 - x**2) * x.dot + x + dry + stops]
    system = hb.System("belt with stops", [x], [f], equations, [dry, stops])
    orbit = hb.solve(hb.HarmonicBalance(31).equations(system), wave(system, 1.8, 1.2))
    checked, settled = hb.verify(system, orbit), hb.motion.settle(system, {"x": 1.0})
    assert "with 6 contact(s) located" in checked.status
    assert checked.orbit.omega == pytest.approx(settled.omega, rel=1e-5)
    assert checked.amplitudes["x"] == pytest.approx(settled.amplitudes["x"], rel=1e-5)
    assert np.abs(hb.floquet(system, orbit).multipliers - checked.multipliers).max() < 1e-2


class TestJumpMatrix:
    def test_against_differences_of_the_flow(self, piecewise):
        """SOLVER: the flow across x = 0 is flow before, jump matrix, flow after."""
        _, system, orbits, _ = piecewise
        shooting, path, _ = _closed(system, orbits[0], 1e-10)
        passages = passages_of(shooting, path)
        assert len(passages.place) == 2
        scale, h, reach = shooting.scale, 1e-5, 0.2
        for k in range(2):
            x = path.x[passages.place[k]] * scale
            side = np.sign(passages.after[k])

            def one_sided(y, s):
                r = np.hypot(*y)
                growth, rotation = (2 - r, 3.5 - r) if s > 0 else (1 - r, 1.0)
                return [y[0] * growth - y[1] * rotation, y[1] * growth + y[0] * rotation]

            def flow(y, t, s):
                return solve_ivp(lambda _, y: one_sided(y, s), (0, t), y, **TIGHT).y[:, -1]

            def across(y, s=side):
                hit = lambda _, y: y[0]  # noqa: E731
                hit.terminal = True
                first = solve_ivp(lambda _, y: one_sided(y, -s), (0, 2 * reach), y, events=hit, **TIGHT)
                return flow(first.y[:, -1], 2 * reach - first.t[-1], s)

            def differences(f, y):
                return np.array([(f(y + h * e) - f(y - h * e)) / (2 * h) for e in np.eye(2)]).T

            start = flow(x, -reach, -side)
            before = differences(lambda y, s=side: flow(y, reach, -s), start)
            after = differences(lambda y, s=side: flow(y, reach, s), x)
            S = np.diag(scale) @ passages.matrices[k] @ np.diag(1 / scale)
            np.testing.assert_allclose(after @ S @ before, differences(across, start), atol=1e-6)
            assert np.linalg.det(S) == pytest.approx(passages.after[k] / passages.before[k], rel=1e-10)

    def test_no_jump_is_no_change(self):
        """SOLVER: a step of height zero leaves the cycle of van der Pol's oscillator as published."""
        published = hb.load_problem("van_der_pol").PUBLISHED[0]
        x, h = hb.Coordinate("x"), hb.Parameter("h", 0.0)
        step = hb.Element("step", hb.model.Step(h, 0.3), x)
        system = hb.System("step", [x], [h], [x.ddot - (1 - x**2) * x.dot + x + step], [step])
        orbit = hb.solve(hb.HarmonicBalance(31).equations(system), wave(system, 2.0))
        checked = hb.verify(system, orbit)
        assert checked.orbit.period == pytest.approx(published.period, rel=1e-10)
        assert checked.amplitudes["x"] == pytest.approx(published.peak, rel=1e-10)
        assert checked.multipliers[1] == pytest.approx(published.multiplier, rel=1e-8)
        assert hb.floquet(system, orbit).multipliers[1] == pytest.approx(published.multiplier, rel=1e-4)

    def test_a_jump_twice_half_as_high(self):
        """SOLVER: two elements at one place are one: their matrices multiply to that of the sum."""
        x, h = hb.Coordinate("x"), hb.Parameter("h", 0.5)
        results = []
        for parts in (1, 2):
            steps = [hb.Element(f"step {i}", hb.model.Step(h / parts, 0.3), x) for i in range(parts)]
            equations = [x.ddot - (1 - x**2) * x.dot + x + sum(steps)]
            system = hb.System("steps", [x], [h], equations, steps)
            orbit = hb.solve(hb.HarmonicBalance(15).equations(system), wave(system, 2.0))
            checked = hb.verify(system, orbit)
            results.append(
                [checked.orbit.omega, *checked.multipliers.real, *hb.floquet(system, orbit).multipliers.real]
            )
        np.testing.assert_allclose(results[1], results[0], rtol=1e-8)


class TestBelt:
    def test_slipping_both_ways(self):
        """SOLVER: period and multiplier are those of the return map, by a solver that stops at the jumps."""
        system = belt(0.2)
        orbit = hb.solve(hb.HarmonicBalance(15).equations(system), wave(system, 2.0))
        checked = hb.verify(system, orbit)

        def side(y, s):
            return [y[1], (1 - y[0] ** 2) * y[1] - y[0] - 0.2 * s]

        def returned(x):
            y, t = np.array([x, 0.5]), 0.0
            for s in (1, -1):  # faster than the belt, then slower
                hit = lambda _, y: y[1] - 0.5  # noqa: E731
                hit.terminal, hit.direction = True, -s
                run = solve_ivp(lambda _, y, s=s: side(y, s), (0, 9), y, events=hit, max_step=0.1, **TIGHT)
                y, t = run.y[:, -1], t + run.t[-1]
            return y[0], t

        x = -1.9
        for _ in range(4):  # contracts by 3e-3 a period
            x, period = returned(x)
        assert checked.orbit.period == pytest.approx(period, rel=1e-8)
        slope = (returned(x + 1e-4)[0] - returned(x - 1e-4)[0]) / 2e-4
        assert checked.multipliers[1] == pytest.approx(slope, rel=1e-5)
        assert hb.floquet(system, orbit).multipliers[1] == pytest.approx(slope, rel=1e-2)

    def test_sticking_is_reported(self):
        """With more friction the mass sticks to the belt: nothing is claimed."""
        regular = belt(0.8, lambda f: hb.model.Friction(f, 0.05))
        settled = hb.motion.settle(regular, {"x": 1.0}, step=1e-2)
        orbit = hb.motion.last_orbit(regular, settled.trajectory, 31)
        assert np.mean(np.abs(orbit.v(np.linspace(0, orbit.period, 200))[:, 0] - 0.5) < 0.05) > 0.1
        found = hb.floquet(belt(0.8), orbit)
        assert found.verdict == "unknown"
        assert "does not pass where element 'dry' jumps" in found.reason
        with pytest.raises(ConvergenceError, match=r"does not pass where element 'dry' jumps.*it sticks"):
            hb.verify(belt(0.8), orbit)
