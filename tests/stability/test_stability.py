"""Floquet multipliers: closed forms, Liouville, order of convergence, the bogie, honest verdicts."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from known_cycles import lure, radial

from hbbogie import (
    Coordinate,
    Element,
    HarmonicBalance,
    Parameter,
    System,
    find_cycles,
    fourier,
    hopf_points,
    solve,
    trace,
)
from hbbogie.branches import crossings
from hbbogie.errors import ModelError
from hbbogie.model import Cubic, DeadBand
from hbbogie.motion import last_orbit, settle, simulate
from hbbogie.results import Branch, Orbit
from hbbogie.stability import floquet, verify
from problems.yang1995 import bogie


def van_der_pol() -> System:
    x, mu = Coordinate("x"), Parameter("mu", 1.0)
    return System("van der Pol", [x], [mu], [x.ddot - mu * (1 - x**2) * x.dot + x])


def equilibrium(system: System, **parameters: float) -> Orbit:
    values = dict(system.with_parameters(**parameters).values)
    units = tuple(c.unit for c in system.coordinates)
    return Orbit(system.name, system.coordinate_names, units, np.zeros((1, system.n)), 0.0, values)


@pytest.fixture(scope="module")
def yang() -> System:
    return bogie()


@pytest.fixture(scope="module")
def hunting(yang: System) -> Orbit:
    motion = simulate(yang, {"q1": 0.03, "q3": 0.03}, 30.0, method="cvodes", V=90.0)
    return last_orbit(yang, motion, 45)


@pytest.mark.parametrize("rho", [0.01, 0.1, 0.5])
def test_radial_normal_form(rho: float) -> None:
    system, orbit = radial(rho)
    result = floquet(system, orbit)
    assert result.verdict == "stable" and result.unstable == 0
    assert result.multipliers[0] == pytest.approx(1.0, abs=1e-9)
    assert abs(result.multipliers[1]) == pytest.approx(np.exp(-4 * np.pi * rho), rel=1e-6)


def test_repelling_cycle_is_unstable() -> None:
    """Time reversed, the radial normal form repels with exp(+4 pi rho)."""
    x, y = Coordinate("x"), Coordinate("y")
    s = x**2 + y**2
    system = System("reversed", [x, y], [], [x.dot + (0.1 - s) * x - y, y.dot + (0.1 - s) * y + x])
    c = np.sqrt(0.1) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    result = floquet(system, Orbit(system.name, ("x", "y"), ("", ""), c, 1.0, {}))
    assert result.verdict == "unstable" and result.unstable == 1
    assert result.multipliers[0] == pytest.approx(np.exp(0.4 * np.pi), rel=1e-6)
    assert "1 multiplier(s) outside" in result.reason


def test_elements_converge_with_twice_as_many_orders_as_points() -> None:
    """Six Gauss points: order 12, and two digits beyond the tolerance where the elements choose themselves."""
    system, orbit = radial(3.0)
    exact = np.exp(-4 * np.pi * 3.0)
    errors = [abs(abs(floquet(system, orbit, steps=n).multipliers[1]) / exact - 1) for n in (16, 24, 32)]
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / np.log([24 / 16, 32 / 24])
    assert orders == pytest.approx([12.0, 12.0], abs=0.5)
    assert abs(floquet(system, orbit).multipliers[1]) == pytest.approx(exact, rel=1e-8)


def test_kinks_of_the_equations_are_resolved() -> None:
    """A force with a kink that is no element: x'' + x (1 + [x > 0]) has half a period of each frequency."""
    x, y = Coordinate("x"), Coordinate("y")
    rate = 2.0 + ca.fabs(x)  # y' = -(2 + |cos t|) y beside x = cos t: the multiplier is exp(-4 pi - 4)
    system = System("kinked", [x, y], [], [x.ddot + x, y.dot + rate * y])
    c = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    c = np.pad(c, [(0, 2), (0, 0)])  # with harmonic 2, so that no node of the first mesh is at a kink by chance
    orbit = Orbit(system.name, ("x", "y"), ("", ""), fourier.shift(c, 0.3), 1.0, {})
    smallest = np.abs(floquet(system, orbit).multipliers).min()
    assert smallest == pytest.approx(np.exp(-4 * np.pi - 4), rel=1e-6)


def test_van_der_pol_multiplier_and_liouville() -> None:
    system = van_der_pol()
    orbit = last_orbit(system, settle(system, {"x": 1.0}, step=2e-3).trajectory, 61)
    result = floquet(system, orbit)
    assert result.verdict == "stable" and result.trivial_error < 1e-7
    assert result.multipliers[1] == pytest.approx(8.596950636e-4, rel=1e-6)
    # Liouville by Parseval: the mean of the trace mu (1 - x^2) from the coefficients, no quadrature
    mean_square = orbit.coefficients[0, 0] ** 2 + 0.5 * (orbit.coefficients[1:, 0] ** 2).sum()
    assert np.prod(result.multipliers).real == pytest.approx(np.exp(orbit.period * (1 - mean_square)), rel=1e-6)


def test_van_der_pol_strongly_contracting_is_not_called_unstable() -> None:
    system = van_der_pol()
    orbit = last_orbit(system, settle(system, {"x": 1.0}, step=2e-3, mu=5.0).trajectory, 61)
    result = floquet(system, orbit)
    assert result.verdict == "stable" and abs(result.multipliers[1]) < 1e-9
    coarse = floquet(system, orbit, steps=20)
    assert coarse.verdict == "unknown" and "take more" in coarse.reason


def test_bogie_cycle_at_90_is_stable(yang: System, hunting: Orbit) -> None:
    result = floquet(yang, hunting)
    assert result.verdict == "stable" and result.trivial_error < 1e-4
    fine = floquet(yang, hunting, steps=6000)
    large = np.abs(fine.multipliers) > 1e-4
    assert large.sum() > 6
    assert np.abs(result.multipliers[large] / fine.multipliers[large] - 1).max() < 1e-6


def test_no_element_straddles_a_contact(yang: System, hunting: Orbit) -> None:
    """Round-off with few elements in spite of the kinks: only with the contact times in the mesh."""
    exact = floquet(yang, hunting).multipliers[1]
    assert floquet(yang, hunting, steps=40).multipliers[1] == pytest.approx(exact, rel=1e-10)


def test_multipliers_are_the_decay_of_a_disturbance(yang: System, hunting: Orbit) -> None:
    """Two motions, 1e-5 rad apart, integrated; their distance in the section q1 = 0 knows the multipliers."""
    motion = simulate(yang, hunting, 3.0, method="cvodes", V=90.0)
    names = yang.coordinate_names
    start = {n: float(x) for n, x in zip(names, motion.q[-1], strict=True)}
    start |= {f"{n}'": float(x) for n, x in zip(names, motion.v[-1], strict=True)}
    sections = []
    for state in (start, start | {"q6": start["q6"] + 1e-5}):
        m = simulate(yang, state, 10 * hunting.period, method="cvodes", step=5e-4, tolerance=1e-11, V=90.0)
        sections.append(m.at(m.crossings("q1", 0.0))[0])
    d = sections[1] - sections[0]
    # three multipliers govern d from the third crossing on: d[k + 3] = c2 d[k + 2] + c1 d[k + 1] + c0 d[k]
    rows = np.vstack([d[k : k + 4].T / np.abs(d[k + 3]).max() for k in range(2, 7)])
    c = np.linalg.lstsq(rows[:, :3], rows[:, 3], rcond=None)[0]
    seen = np.sort_complex(np.roots(np.r_[1.0, -c[::-1]]))
    # the disturbance is a thousandth of the motion, and contacts make its growth quadratic
    assert np.sort_complex(floquet(yang, hunting).multipliers[1:4]) == pytest.approx(seen, rel=2e-3)


def test_bogie_orbits_that_are_too_coarse_are_not_judged(yang: System, hunting: Orbit) -> None:
    rough = hunting.replace(coefficients=fourier.resize(hunting.coefficients, 1))
    result = floquet(yang, rough)
    assert result.verdict == "unknown" and "more harmonics" in result.reason
    assert result.trivial_error > 1e-3


@pytest.mark.parametrize(("V", "verdict", "count"), [(90.9, "stable", 0), (91.05, "unstable", 2)])
def test_bogie_at_rest(yang: System, V: float, verdict: str, count: int) -> None:
    """The linear critical speed is 90.974 m/s."""
    result = floquet(yang, equilibrium(yang, V=V))
    assert (result.verdict, result.unstable, result.trivial_error) == (verdict, count, 0.0)
    eigenvalues = np.linalg.eigvals(yang.ode_jacobian(0, yang.vector(V=V)).full())
    assert abs(result.multipliers[0]) == pytest.approx(np.exp(eigenvalues.real.max()), rel=1e-9)


def test_bogie_below_contact_is_neutral(yang: System) -> None:
    """On the vertical line of linear cycles at the linear critical speed two multipliers are 1."""
    from scipy.optimize import brentq

    def leading(V: float) -> complex:
        values = np.linalg.eigvals(yang.ode_jacobian(0, yang.vector(V=V)).full())
        return complex(values[np.argmax(values.real)])

    V = brentq(lambda V: leading(V).real, 90.5, 91.5, xtol=1e-12)
    values, vectors = np.linalg.eig(yang.ode_jacobian(0, yang.vector(V=V)).full())
    k = np.argmax(values.real)
    mode = vectors[:7, k] / vectors[0, k] * 0.008
    c = np.vstack([np.zeros(7), mode.real, -mode.imag])
    units = tuple(u.unit for u in yang.coordinates)
    parameters = dict(yang.values) | {"V": V}
    orbit = Orbit(yang.name, yang.coordinate_names, units, c, abs(values[k].imag), parameters)
    result = floquet(yang, orbit)
    assert result.verdict == "unknown" and "neutral" in result.reason
    assert np.abs(np.sort(np.abs(result.multipliers - 1))[:2]).max() < 1e-6


def test_conservative_cycles_are_neutral() -> None:
    x, gap = Coordinate("x", "m"), Parameter("delta", 1.0)
    cubic, spring = Element("cubic", Cubic(1.0, 1.0), x), Element("spring", DeadBand(1.0, gap), x)
    for system in (
        System("Duffing", [x], [], [x.ddot + cubic], [cubic]),
        System("free mass", [x], [gap], [x.ddot + spring], [spring]),
    ):
        motion = simulate(system, {"x": 2.0}, 30.0, method="cvodes", step=5e-3, tolerance=1e-11)
        result = floquet(system, last_orbit(system, motion, 45))
        assert result.verdict == "unknown" and "conservative" in result.reason
        assert np.abs(result.multipliers - 1).max() < 2e-2  # a double multiplier: the root of the orbit's error


def test_short_contact_between_grid_points_is_found() -> None:
    """Grazing: a contact of 2e-3 rad still changes the multipliers; closed form by two rotations."""
    x, k = Coordinate("x"), Parameter("k", 1e4)
    threshold = np.cos(1e-3)
    stop = Element("stop", DeadBand(k, threshold), x)
    system = System("stop", [x], [k], [x.ddot + x + stop], [stop])
    c = np.array([[0.0], [1.0], [0.0]])
    orbit = Orbit(system.name, ("x",), ("",), c, 1.0, {"k": 1e4})
    multipliers = floquet(system, orbit).multipliers

    def turn(w: float, t: float) -> np.ndarray:
        return np.array([[np.cos(w * t), np.sin(w * t) / w], [-w * np.sin(w * t), np.cos(w * t)]])

    half = turn(np.sqrt(1e4 + 1), 2e-3) @ turn(1.0, np.pi - 2e-3)
    exact = np.linalg.eigvals(half @ half)
    assert np.sort_complex(multipliers) == pytest.approx(np.sort_complex(exact), rel=1e-6)


def test_an_orbit_that_is_no_equilibrium_is_not_judged() -> None:
    x = Coordinate("x")
    system = System("well", [x], [], [x.ddot + x.dot + x - 1])
    assert floquet(system, equilibrium(system)).verdict == "unknown"
    at_rest = equilibrium(system).replace(coefficients=np.ones((1, 1)))
    assert floquet(system, at_rest).verdict == "stable"
    free = System("free", [x], [], [x.ddot + x])
    assert "imaginary axis" in floquet(free, equilibrium(free)).reason


def test_a_second_speed_builds_nothing(yang: System, hunting: Orbit) -> None:
    floquet(yang, hunting, steps=512)
    built = set(yang.dynamics.once)
    floquet(yang, hunting.replace(parameters=hunting.parameters | {"V": 91.0}), steps=512)
    assert set(yang.dynamics.once) == built


def test_wrong_input_is_refused(yang: System, hunting: Orbit) -> None:
    with pytest.raises(ModelError, match="belongs to"):
        floquet(van_der_pol(), hunting)
    with pytest.raises(ModelError, match="steps"):
        floquet(yang, hunting, steps=0)
    with pytest.raises(ModelError, match="tolerance"):
        floquet(yang, hunting, tolerance=0.0)
    with pytest.raises(ModelError, match="frequency"):
        floquet(yang, hunting.replace(omega=-1.0))


# --- half a period ----------------------------------------------------------------------------


def circuit(direction: float = 1.0) -> System:
    """Return the odd circuit with parameter v; direction -1 lets its time run backwards.

    x' = (-(b + v) x + b y - a3 x^3 + b3 (y - x)^3) / r, y' = b x - (b + g) y - z - b3 (y - x)^3, z' = y
    """
    x, y, z, v = Coordinate("x"), Coordinate("y"), Coordinate("z"), Parameter("v", -0.59)
    b, g, r, a3, b3 = 0.5, -0.6, 0.6, 0.328578, 0.933578
    rates = [
        (-(b + v) * x + b * y - a3 * x**3 + b3 * (y - x) ** 3) / r,
        b * x - (b + g) * y - z - b3 * (y - x) ** 3,
        1.0 * y,
    ]
    equations = [c.dot - direction * rate for c, rate in zip((x, y, z), rates, strict=True)]
    return System("circuit", [x, y, z], [v], equations)


PITCHFORK, PERIOD_THERE = -0.587028974, 8.68966962


@pytest.fixture(scope="module")
def circuit_branch() -> tuple[System, Branch]:
    system = circuit()
    (hopf,) = hopf_points(system, "v", (-0.7, -0.5))
    assert hopf.value == pytest.approx(-0.589336478, abs=5e-10)
    return system, trace(HarmonicBalance(15).equations(system), hopf, "v", (-0.6, -0.57))


def at_pitchfork(system: System, branch: Branch) -> Orbit:
    found = crossings(HarmonicBalance(15).equations(system), branch, PITCHFORK)
    return max(found, key=lambda o: o.period)


def test_half_multipliers_square_to_those_of_the_period(yang: System) -> None:
    """Two different meshes: they agree to the error of the steps, which the default keeps below 1e-6."""
    cycles = [(yang, orbit) for orbit in find_cycles(yang, V=90.0, stability=False)]
    cycles += [(van_der_pol(), find_cycles(van_der_pol(), mu=1.0, stability=False, harmonics=31)[0])]
    for system, orbit in cycles:
        half, full = floquet(system, orbit), floquet(system, orbit, half=False)
        assert half.half_multipliers is not None and full.half_multipliers is None
        assert half.multipliers == pytest.approx(half.half_multipliers**2, rel=1e-12)
        large = np.abs(full.multipliers) > 1e-4
        assert half.multipliers[large].real == pytest.approx(full.multipliers[large].real, rel=2e-6, abs=1e-7)
        assert np.abs(half.multipliers[large]) == pytest.approx(np.abs(full.multipliers[large]), rel=2e-6)
        assert np.abs(half.half_multipliers - 1).min() == pytest.approx(half.trivial_error / 2, rel=1e-2)
        assert (half.verdict, half.unstable) == (full.verdict, full.unstable)
        assert half.critical == pytest.approx(full.critical, rel=2e-6)


def test_liouville_over_half_a_period() -> None:
    """The product of the half multipliers of van der Pol is the root of exp of the integral of the trace."""
    orbit = find_cycles(van_der_pol(), mu=1.0, stability=False, harmonics=45)[0]
    result = floquet(van_der_pol(), orbit)
    assert result.half_multipliers is not None
    mean_square = 0.5 * (orbit.coefficients[1:, 0] ** 2).sum()
    product = np.prod(result.half_multipliers)
    assert product.real == pytest.approx(np.exp(0.5 * orbit.period * (1 - mean_square)), rel=1e-6)
    assert result.critical == pytest.approx(8.596950636e-4, rel=1e-6)


def test_half_a_period_halves_the_steps_and_keeps_the_order() -> None:
    system, orbit = radial(0.3)
    halves = [floquet(system, orbit, steps=n, half=True).multipliers[1] for n in (16, 32)]
    wholes = [floquet(system, orbit, steps=n, half=False).multipliers[1] for n in (16, 32)]
    assert halves == pytest.approx(wholes, rel=1e-10)  # the same steps, since A repeats


def test_half_where_it_is_not_enough_is_refused() -> None:
    system, orbit = radial(0.3)
    shifted = orbit.coefficients.copy()
    shifted[0] = 1e-3
    with pytest.raises(ModelError, match="mean or even"):
        floquet(system, orbit.replace(coefficients=shifted), half=True)
    with pytest.raises(ModelError, match="equilibrium"):
        floquet(system, equilibrium(system), half=True)
    lure_system, cycle = lure()
    with pytest.raises(ModelError, match="not odd"):
        floquet(lure_system, cycle, half=True)
    assert floquet(lure_system, cycle).half_multipliers is None


def test_pitchfork_of_the_circuit(circuit_branch: tuple[System, Branch]) -> None:
    """G has -1 there, which over the full period is a second +1.

    The value of v is printed to 5e-10; the multiplier changes by 100 per unit of v (-0.99267 at v = -0.5871,
    -1.00303 at -0.5870), so that it must be within 5e-8 of -1, plus 3e-7 for the integration. The period
    changes by 53 per unit of v: 3e-8 on top of the digits printed.
    """
    system, branch = circuit_branch
    orbit = at_pitchfork(system, branch)
    assert orbit.period == pytest.approx(PERIOD_THERE, abs=3.2e-8)
    result, full = floquet(system, orbit), floquet(system, orbit, half=False)
    assert result.half_multipliers is not None
    assert np.abs(result.half_multipliers + 1).min() < 1e-6
    assert np.abs(result.half_multipliers - 1).min() < 1e-6
    assert np.sort(np.abs(full.multipliers - 1))[1] < 1e-6
    assert result.verdict == "unstable" and result.unstable in (1, 2)  # the digits printed do not tell the side
    assert result.critical == pytest.approx(1.1748, abs=1e-4)


def test_mode_at_the_pitchfork(circuit_branch: tuple[System, Branch]) -> None:
    """Backwards in time the multipliers are the inverses, -1 the largest; two motions show its mode."""
    system, branch = circuit_branch
    orbit = next(point.orbit for point in branch.special if point.kind == "pitchfork")
    c = orbit.coefficients.copy()
    c[2::2] *= -1
    forth, backwards = floquet(system, orbit), circuit(-1.0)
    mirrored = orbit.replace(coefficients=c)
    back = floquet(backwards, mirrored)
    assert forth.half_multipliers is not None and back.half_multipliers is not None
    inverse = np.sort_complex(1 / forth.half_multipliers)
    assert np.sort_complex(back.half_multipliers) == pytest.approx(inverse, rel=1e-6)
    assert back.verdict == "unknown" and "neutral" in back.reason
    assert back.mode is not None and np.abs(back.mode).max() == pytest.approx(1.0, rel=1e-12)
    assert back.critical == pytest.approx(1.0, abs=1e-6)
    # G mode = -mode: after half a period the disturbance is back, while the cycle has changed its sign
    ends, size, start = [], 1e-4, mirrored.q(0.0)[0]
    for sign in (1.0, -1.0):
        x = start + sign * size * back.mode.real
        values = dict(zip(backwards.coordinate_names, map(float, x), strict=True))
        half_period = 0.5 * orbit.period
        motion = simulate(
            backwards, values, half_period, method="cvodes", step=half_period / 64, tolerance=1e-12, v=PITCHFORK
        )
        ends.append(motion.q[-1])
    assert (ends[0] - ends[1]) / (2 * size) == pytest.approx(back.mode.real, abs=1e-5)


def test_fold_of_the_circuit(circuit_branch: tuple[System, Branch]) -> None:
    """Published: v = -0.584335, T = 8.42647, where G has a second +1.

    At a fold multipliers go like the root of the distance: |G - 1| is 3.4e-4 at the printed v, 2.3e-7 off, so
    that the half unit of its last digit, 5e-7, leaves less than 1e-3. The fold located to 1e-12 is left with
    the root of the integration's error.
    """
    system, branch = circuit_branch
    (fold,) = branch.folds()
    assert fold.value == pytest.approx(-0.584335, abs=5e-7)
    assert fold.orbit.period == pytest.approx(8.42647, abs=5e-6)
    printed = crossings(HarmonicBalance(15).equations(system), branch, -0.584335)
    assert len(printed) == 2
    for orbit, allowed in [(fold.orbit, 1e-4), *((o, 1e-3) for o in printed)]:
        result = floquet(system, orbit)
        assert result.half_multipliers is not None
        assert np.sort(np.abs(result.half_multipliers - 1))[1] < allowed


# --- published period doubling, critical multiplier and mode ----------------------------------


def test_period_doubling_of_lure() -> None:
    """alpha = 0.63030200616, T = 6.3640713394: the critical multiplier is -1, the verdict open."""
    system, orbit = lure()
    assert orbit.period == pytest.approx(6.3640713394, abs=5e-10)
    result = floquet(system, orbit)
    assert result.critical is not None and abs(result.critical + 1) < 1e-6
    assert result.verdict == "unknown" and "bifurcation" in result.reason
    assert result.mode is not None and result.mode.shape == (3,)


def test_mode_is_the_eigenvector_of_the_critical_multiplier() -> None:
    """Radial normal form: radial disturbances decay with exp(-4 pi rho), from (1, 0) along x."""
    result = floquet(*radial(0.1))
    assert result.critical == pytest.approx(np.exp(-0.4 * np.pi), rel=1e-6)
    assert result.mode == pytest.approx(np.array([1.0, 0.0]), abs=1e-6)


def test_brusselator_published() -> None:
    """A = 1, B = 3: T = 7.1569199212, multiplier 2.51637580e-4."""
    x, y, B = Coordinate("x"), Coordinate("y"), Parameter("B", 3.0)
    system = System("Brusselator", [x, y], [B], [x.dot - 1 + (B + 1) * x - x**2 * y, y.dot - B * x + x**2 * y])
    coarse = find_cycles(system, B=3.0, harmonics=15, stability=False)[0]
    orbit = solve(HarmonicBalance(60).equations(system), coarse)
    assert orbit.period == pytest.approx(7.1569199212, rel=1e-9)
    assert floquet(system, orbit, steps=2048).critical == pytest.approx(2.51637580e-4, rel=1e-6)


def test_new_fields_are_saved(tmp_path, yang: System, hunting: Orbit) -> None:
    system, orbit = radial(0.3)
    for half in (True, False):
        orbit = orbit.replace(stability=floquet(system, orbit, half=half))
        orbit.save(tmp_path / "orbit.nc")
        loaded = Orbit.load(tmp_path / "orbit.nc").stability
        assert loaded is not None and orbit.stability is not None
        for name in ("multipliers", "half_multipliers", "critical", "mode"):
            before, after = getattr(orbit.stability, name), getattr(loaded, name)
            assert (before is None) == (after is None) and np.array_equal(before, after)
        assert (loaded.half_multipliers is not None) == half


def test_a_multiplier_below_round_off_is_zero() -> None:
    """The circle of radius 3 of r' = r (1 - r^2)(r^2 - 4)(r^2 - 9) / 10, with a multiplier of exp(-452)."""
    x, y, k = Coordinate("x"), Coordinate("y"), Parameter("k", 0.1)
    r2 = x**2 + y**2
    rate = k * (1 - r2) * (r2 - 4) * (r2 - 9)
    system = System("nested", [x, y], [k], [x.dot - x * rate + y, y.dot - y * rate - x])
    for radius, verdict in ((1.0, "stable"), (2.0, "unstable"), (3.0, "stable")):
        c = radius * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        orbit = verify(system, Orbit("nested", ("x", "y"), ("", ""), c, 1.0, {"k": 0.1})).orbit
        assert orbit.stability is not None and orbit.stability.verdict == verdict
