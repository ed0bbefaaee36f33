"""Cycles in which an angle runs on by whole turns: closed forms, shooting by SciPy, two methods that agree."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import hbbogie as hb
from hbbogie import plot
from hbbogie.attraction import measure_attraction
from hbbogie.collocation import Collocation
from hbbogie.errors import ModelError
from hbbogie.model import Coordinate, Parameter, System
from hbbogie.results import Branch, Orbit
from hbbogie.stability import hill

TURN = 2 * np.pi


@pytest.fixture(scope="module")
def pendulum():
    phi, d, e, M = Coordinate("phi", "rad", turn=TURN), Parameter("d", 0.2), Parameter("e", 0.0), Parameter("M", 0.8)
    return System("pendulum", [phi], [d, e, M], [phi.ddot + (d + e * ca.cos(phi)) * phi.dot + ca.sin(phi) - M])


@pytest.fixture(scope="module")
def running(pendulum):
    (cycle,) = hb.find_cycles(pendulum, parameter="M", M=0.8)
    return cycle


@pytest.fixture(scope="module")
def overdamped():
    phi, M = Coordinate("phi", "rad", turn=TURN), Parameter("M", 1.5)
    return System("overdamped pendulum", [phi], [M], [phi.dot + ca.sin(phi) - M])


def uniform(system, omega, advance, H=1):
    """A rotation at constant speed, a first guess."""
    return Orbit(
        system.name,
        system.coordinate_names,
        tuple(c.unit for c in system.coordinates),
        np.zeros((2 * H + 1, system.n)),
        omega,
        dict(system.values),
        advance=advance,
    )


class TestOverdamped:
    """phi' = M - sin phi runs on with the period 2 pi / sqrt(M^2 - 1)."""

    @pytest.mark.parametrize("M", [1.01, 1.5, -2.0])
    def test_found_with_the_period_in_closed_form(self, overdamped, M):
        (cycle,) = hb.find_cycles(overdamped, M=M)
        assert cycle.period == pytest.approx(TURN / np.sqrt(M**2 - 1), rel=1e-9)
        assert cycle.advance == (np.copysign(TURN, M),) and cycle.verdict == "stable"
        assert cycle.mean_speed("phi") == pytest.approx(np.sign(M) * np.sqrt(M**2 - 1), rel=1e-9)

    def test_harmonic_balance_and_collocation(self, overdamped):
        guess = uniform(overdamped, 1.0, (TURN,))
        for method in (hb.HarmonicBalance(31), Collocation()):
            cycle = hb.solve(method.equations(overdamped), guess)
            assert cycle.omega == pytest.approx(np.sqrt(1.25), rel=1e-8)
            assert hb.floquet(overdamped, cycle).trivial_error < 1e-6

    def test_none_where_it_comes_to_rest(self, overdamped):
        cycles = hb.find_cycles(overdamped, M=0.9)
        assert not cycles and cycles.complete


class TestPendulum:
    def test_advances_by_a_turn(self, pendulum, running):
        t = np.linspace(0, 3, 7)
        assert running.advance == (TURN,)
        np.testing.assert_allclose(running.q(t + running.period) - running.q(t), TURN, rtol=1e-12)
        np.testing.assert_allclose(running.v(t + running.period), running.v(t), rtol=1e-12)

    def test_satisfies_the_balance_of_power(self, running):
        v = running.v(running.period * np.arange(512) / 512)[:, 0]
        assert 0.2 * (v**2).mean() == pytest.approx(0.8 * running.mean_speed("phi"), rel=1e-9)

    def test_multipliers_have_the_product_of_liouville(self, pendulum, running):
        for judged in (running.stability, hb.floquet(pendulum, running), hill(pendulum, running)):
            product = np.prod(judged.multipliers).real
            assert product == pytest.approx(np.exp(-0.2 * running.period), rel=1e-6)
            assert judged.verdict == "stable"

    def test_methods_agree(self, pendulum, running):
        balance = hb.solve(hb.HarmonicBalance(15).equations(pendulum), running)
        collocated = Collocation().equations(pendulum).cycle(running)
        t = np.linspace(-1, 5, 50)
        assert balance.omega == pytest.approx(running.omega, rel=1e-9)
        assert collocated.omega == pytest.approx(running.omega, rel=1e-8)
        for other in (balance, collocated, collocated.orbit()):
            start = other.q(0.0)[0, 0]  # where time begins is free
            late = brentq(lambda s, at: running.q(s)[0, 0] - at, -10, 10, args=(start,))
            np.testing.assert_allclose(other.q(t), running.q(t + late), atol=1e-7)
            np.testing.assert_allclose(other.v(t), running.v(t + late), atol=1e-6)

    def test_runs_on_the_other_way(self, pendulum, running):
        cycle = hb.solve(hb.HarmonicBalance(15).equations(pendulum), uniform(pendulum, 4.0, (-TURN,)), M=-0.8)
        assert cycle.mean_speed("phi") == pytest.approx(-running.mean_speed("phi"), rel=1e-9)
        assert cycle.amplitude("phi") == pytest.approx(running.amplitude("phi"), rel=1e-6)

    def test_a_disturbance_decays_at_the_rate_of_the_multiplier(self, pendulum, running):
        measured = measure_attraction(pendulum, running)
        assert measured.measured == pytest.approx(np.exp(-0.2 * running.period), rel=1e-4)

    def test_save_and_load(self, running, tmp_path: Path):
        running.save(tmp_path / "running.nc")
        again = Orbit.load(tmp_path / "running.nc")
        assert again.advance == running.advance
        np.testing.assert_array_equal(again.q([0.3, 9.0]), running.q([0.3, 9.0]))

    def test_expressions_know_the_mean_speed(self, pendulum, running):
        """The power of the torque is a force law of the velocity."""
        phi, M = Coordinate("phi", "rad", turn=TURN), Parameter("M", 0.8)
        brake = hb.model.Element("brake", hb.model.Polynomial([0, 0.2]), phi.dot)
        system = System("pendulum", [phi], [M], [phi.ddot + brake + ca.sin(phi) - M], [brake])
        equations = hb.HarmonicBalance(15).equations(system)
        cycle = hb.solve(equations, running.replace(parameters={"M": 0.8}))
        found = hb.solve(equations, cycle, free=["M"], minimise=lambda c: (c.force("brake") - 0.9)[0] ** 2)
        assert found.orbit.v(0.0)[0, 0] == pytest.approx(4.5, rel=1e-4)


def arrival(M: float, d: float, e: float) -> float:
    """Speed with which the pendulum arrives at the saddle it left a turn ago, less what would lead into it."""
    saddle = np.pi - np.arcsin(M)
    trace, determinant = -(d + e * np.cos(saddle)), np.cos(saddle)
    rates = [0.5 * (trace + s * np.sqrt(trace**2 - 4 * determinant)) for s in (1, -1)]
    near = 1e-6

    def slope(phi, v):
        return (M - np.sin(phi)) / v - d - e * np.cos(phi)

    span = (saddle + near, saddle + TURN - near)
    out = solve_ivp(slope, span, [rates[0] * near], rtol=1e-11, atol=1e-13, events=_stops)
    if out.status == 1:
        return out.t[-1] - span[1] - near  # it has turned back before
    return out.y[0, -1] + rates[1] * near


def _stops(phi, v):
    return v[0] - 1e-9


_stops.terminal = True


class TestBranch:
    def test_ends_at_the_homoclinic_orbit(self, pendulum, running):
        low = hb.solve(hb.HarmonicBalance(15).equations(pendulum), running, M=0.3)
        branch = hb.trace(Collocation(tolerance=1e-7).equations(pendulum), low, "M", (0.1, 0.3), longest=5.0)
        value = brentq(lambda M: arrival(M, 0.2, 0.0), 0.24, 0.27, xtol=1e-12)
        (lower,) = [end for end in branch.ends if end.kind == "homoclinic"]
        assert branch.values.min() == pytest.approx(value, abs=1e-6)
        assert "homoclinic" in str(lower)
        assert all(o.verdict != "unstable" for o in branch)

    def test_harmonics_end_there_too(self, pendulum, running):
        """Below there are no rotations, and none are given."""
        branch = hb.trace(hb.HarmonicBalance(15).equations(pendulum), running, "M", (0.01, 1.5), stability=False)
        value = brentq(lambda M: arrival(M, 0.2, 0.0), 0.24, 0.27, xtol=1e-12)
        (lower,) = [end for end in branch.ends if end.kind == "homoclinic"]
        assert branch.values.min() == pytest.approx(value, abs=1e-5)
        assert "phi = " in str(lower) and lower.complete

    def test_fold_is_that_of_the_map_of_a_turn(self):
        """Rotations of a junction with a conductance that depends on the phase turn back where the map is tangent."""
        phi, M = Coordinate("phi", "rad", turn=TURN), Parameter("M", 0.8)
        system = System("junction", [phi], [M], [phi.ddot + (0.1 + 0.6 * ca.cos(phi)) * phi.dot + ca.sin(phi) - M])
        guess = hb.solve(hb.HarmonicBalance(15).equations(system), uniform(system, 8.0, (TURN,)))
        branch = hb.trace(hb.HarmonicBalance(31).equations(system), guess, "M", (0.345, 0.8), stability=False)
        near = branch[0] if branch.values[0] < 0.5 else branch[-1]
        fold = hb.fold(hb.HarmonicBalance(31).equations(system), near, "M")
        other = hb.fold(Collocation().equations(system), fold.orbit, "M")

        def gained(v, M):
            out = solve_ivp(
                lambda phi, v: (M - np.sin(phi)) / v - 0.1 - 0.6 * np.cos(phi), (0, TURN), [v], rtol=1e-10, atol=1e-12
            )
            return out.y[0, -1] - v

        t = np.linspace(0, fold.orbit.period, 4000)
        q, rate = fold.orbit.q(t)[:, 0], fold.orbit.v(t)[:, 0]
        v = float(np.interp(0.0, (q + np.pi) % TURN - np.pi, rate, period=TURN))
        h = 1e-3
        slope = (gained(v + h, fold.value) - gained(v - h, fold.value)) / (2 * h)
        bend = (gained(v + h, fold.value) + gained(v - h, fold.value) - 2 * gained(v, fold.value)) / h**2
        on_M = (gained(v, fold.value + 1e-6) - gained(v, fold.value - 1e-6)) / 2e-6
        tangent = fold.value - (gained(v, fold.value) - slope**2 / (2 * bend)) / on_M
        assert fold.value == pytest.approx(tangent, abs=1e-7)
        assert other.value == pytest.approx(fold.value, abs=1e-8)
        assert fold.orbit.advance == (TURN,)

    def test_drawn_and_saved(self, pendulum, running, tmp_path: Path):
        branch = hb.trace(hb.HarmonicBalance(15).equations(pendulum), running, "M", (0.5, 1.0), stability=False)
        branch.save(tmp_path / "branch.nc")
        again = Branch.load(tmp_path / "branch.nc")
        assert all(o.advance == (TURN,) for o in again)
        (line,) = [c for c in plot.branch(again, quantity="mean speed").lines if len(c.get_xdata()) > 2]
        np.testing.assert_allclose(line.get_ydata()[0], again[0].omega)
        across = plot.orbit(running).lines[0].get_xdata()
        assert np.nanmax(np.abs(across)) <= np.pi + 1e-9 and np.isnan(across).any()
        plot.animate(running, tmp_path / "running.gif", frames=3)


class TestSystems:
    def test_degrees(self, running):
        phi, M = Coordinate("phi", "deg", turn=360.0), Parameter("M", 0.8)
        r = np.pi / 180
        system = System("in degrees", [phi], [M], [r * phi.ddot + 0.2 * r * phi.dot + ca.sin(r * phi) - M])
        cycle = hb.solve(hb.HarmonicBalance(15).equations(system), uniform(system, 4.0, (360.0,)))
        assert cycle.period == pytest.approx(running.period, rel=1e-9)
        assert cycle.amplitude("phi") * r == pytest.approx(running.amplitude("phi"), rel=1e-9)

    def test_phase_locked_loop_slips_cycles(self):
        """Its mean slip frequency against SciPy's integration."""
        phi, u = Coordinate("phi", "rad", turn=TURN), Coordinate("u")
        w = Parameter("w", 1.2)
        system = System("loop", [phi, u], [w], [phi.dot - w + u, 2 * u.dot + u - ca.sin(phi)])
        (cycle,) = hb.find_cycles(system)
        run = solve_ivp(
            lambda t, x: [1.2 - x[1], (np.sin(x[0]) - x[1]) / 2],
            (0, 200),
            [0, 0],
            rtol=1e-10,
            atol=1e-10,
            events=lambda t, x: np.sin(x[0] / 2),
        )
        assert cycle.period == pytest.approx(np.diff(run.t_events[0])[-1], rel=1e-7)
        assert cycle.advance == (TURN, 0.0)

    def test_unbalanced_rotor_on_springs(self):
        """Sommerfeld's effect: one torque, a speed below resonance, one above, and an unstable one between them.

        The motor's power is lost in its own drag and in the foundation's damper.
        """
        x, phi = Coordinate("x", "m"), Coordinate("phi", "rad", turn=TURN)
        L, e = Parameter("L", 0.3), Parameter("e", 0.2)
        push = e * (phi.ddot * ca.sin(phi) + phi.dot**2 * ca.cos(phi))
        turning = phi.ddot + 0.2 * phi.dot - L - e * x.ddot * ca.sin(phi)
        system = System("rotor", [x, phi], [L, e], [x.ddot + 0.1 * x.dot + x - push, turning])
        cycles = sorted(hb.find_cycles(system), key=lambda cycle: cycle.omega)
        assert [cycle.verdict for cycle in cycles] == ["stable", "unstable", "stable"]
        for cycle in cycles:
            v = cycle.v(cycle.period * np.arange(512) / 512)
            assert cycle.advance == (0.0, TURN)
            lost = 0.1 * (v[:, 0] ** 2).mean() + 0.2 * (v[:, 1] ** 2).mean()
            assert lost == pytest.approx(0.3 * cycle.mean_speed("phi"), rel=1e-8)

    def test_coupled_angles_turn_together(self):
        a, b = (Coordinate(name, "rad", turn=TURN) for name in "ab")
        M, k = Parameter("M", 2.0), Parameter("k", 0.5)
        first = a.ddot + 0.2 * a.dot + ca.sin(a) + k * (a - b) - M
        system = System("pair", [a, b], [M, k], [first, b.ddot + 0.2 * b.dot + ca.sin(b) + k * (b - a)])
        balance = hb.HarmonicBalance(15).equations(system)
        cycle = hb.solve(balance, uniform(system, 5.0, (TURN, TURN)))
        v = cycle.v(cycle.period * np.arange(512) / 512)
        assert 0.2 * (v**2).mean(axis=0).sum() == pytest.approx(2.0 * cycle.mean_speed("a"), rel=1e-9)
        with pytest.raises(ModelError, match="turn together"):
            hb.solve(balance, uniform(system, 5.0, (TURN, 0.0)))


class TestRefused:
    def test_turn_that_changes_the_equations(self):
        phi, k = Coordinate("phi", turn=TURN), Parameter("k", 0.0)
        with pytest.raises(ModelError, match="changes equation 1"):
            System("spring", [phi], [k], [phi.ddot + ca.sin(phi) + k * phi])

    @pytest.mark.parametrize("turn", [0.0, -1.0, np.inf, "2 pi"])
    def test_turn_that_is_no_number_above_0(self, turn):
        with pytest.raises(ModelError, match="as turn; give a number above 0"):
            Coordinate("phi", turn=turn)

    def test_orbit_that_runs_on_where_none_can(self, overdamped, running):
        x = Coordinate("phi", "rad")
        system = System("undeclared", [x], [d := Parameter("d", 0.2)], [x.ddot + d * x.dot + ca.sin(x) - 0.8])
        with pytest.raises(ModelError, match="declare it"):
            hb.solve(hb.HarmonicBalance(5).equations(system), running)
        with pytest.raises(ModelError, match="whole turns"):
            hb.solve(hb.HarmonicBalance(5).equations(overdamped), uniform(overdamped, 1.0, (3.0,)))
        with pytest.raises(ModelError, match="all harmonics"):
            hb.solve(hb.HarmonicBalance(5, odd=True).equations(_odd()), uniform(_odd(), 1.0, (TURN,)))

    def test_undeclared_angle_is_named(self):
        x = Coordinate("phi", "rad")
        system = System("undeclared", [x], [M := Parameter("M", 0.8)], [x.ddot + 0.2 * x.dot + ca.sin(x) - M])
        assert 'Coordinate("phi", "rad", turn=2 * pi)' in str(hb.find_cycles(system).evidence)


def _odd():
    phi = Coordinate("phi", "rad", turn=TURN)
    return System("free", [phi], [d := Parameter("d", 0.2)], [phi.ddot + d * phi.dot + ca.sin(phi)])
