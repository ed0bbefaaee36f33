import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from hbbogie.errors import ModelError
from hbbogie.model import load_problem, parts, shipped_problems, system_of

TIGHT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}


@pytest.mark.parametrize("name", shipped_problems())
def test_contract(name):
    module = load_problem(name)
    assert module.__doc__ and "Source:" in module.__doc__
    assert module.SYSTEM.__doc__
    system = system_of(module)
    for thing in (*system.parameters, *system.coordinates):
        assert thing.description, f"{thing.name} has no description"
        assert thing.unit, f"{thing.name} has no unit"
    for parameter in system.parameters:
        assert parameter.bounds[0] <= parameter.default <= parameter.bounds[1]
    if hasattr(module, "PARAMETER"):
        assert module.PARAMETER in system.parameter_names
        lo, hi = module.RANGE
        assert lo < hi
        assert system.with_parameters(**{module.PARAMETER: lo}).values[module.PARAMETER] == lo
        assert system.with_parameters(**{module.PARAMETER: hi}).values[module.PARAMETER] == hi


@pytest.mark.parametrize("name", shipped_problems())
def test_overrides(name):
    module = load_problem(name)
    for parameter in system_of(module).parameters:
        value = 1.01 * parameter.default + (0.01 if parameter.default == 0 else 0)
        assert system_of(module, **{parameter.name: value}).values[parameter.name] == value
    with pytest.raises(ModelError, match="unknown parameter 'nonsense'"):
        system_of(module, nonsense=1.0)


@pytest.mark.parametrize("name", sorted({*shipped_problems()} - {"circuit"}))
def test_rest_is_an_equilibrium_and_motions_are_odd(name):
    system = system_of(load_problem(name))
    assert np.all(system.ode(np.zeros(system.n_states), system.vector()).full() == 0)
    assert system.odd == (name != "piecewise")
    unused = {"yang1995": ("W",), "yang1995_design": ("W",)}
    assert system.inactive_parameters == unused.get(name, ())


def test_circuit_is_odd_only_without_its_bias():
    module = load_problem("circuit")
    assert not module.circuit().odd
    for values, odd in ((module.BIASED, False), (module.SYMMETRIC, True)):
        system = module.circuit(**values)
        assert parts.is_odd(system.dynamics, system.vector()) == odd
        assert np.all(system.ode(np.zeros(3), system.vector()).full() == 0) == odd


def turning_times(system, start, end, rtol=1e-13):
    """Times at which the rate of the first coordinate changes sign, from a start at rest."""

    def f(t, x):
        return system.ode(x, p).full().ravel()

    def turns(t, x):
        return x[1]

    p = system.vector()
    return solve_ivp(f, (0, end), start, events=turns, **(TIGHT | {"rtol": rtol}))


@pytest.mark.parametrize(("alpha", "beta", "amplitude"), [(1, 1, 1.3), (2, 0.5, 3), (1, -0.3, 1.2), (-1, 1, 1.8)])
def test_duffing_backbone(alpha, beta, amplitude):
    module = load_problem("duffing")
    omega = module.backbone(amplitude, alpha, beta)
    system = module.duffing(alpha=alpha, beta=beta)
    period = 2 * np.pi / omega
    motion = turning_times(system, [amplitude, 0.0], 1.2 * period)
    times = motion.t_events[0][motion.t_events[0] > 1e-3]
    assert times[1] == pytest.approx(period, rel=1e-8)
    energy = module.energy(motion.y[0], alpha, beta) + motion.y[1] ** 2 / 2
    np.testing.assert_allclose(energy, module.energy(amplitude, alpha, beta), rtol=1e-10)


def test_duffing_backbone_where_no_motion_exists():
    backbone = load_problem("duffing").backbone
    assert backbone(1e-6) == pytest.approx(1.0, abs=1e-11)
    # softening: beyond the hilltop; two wells: inside one of them
    assert np.isnan(backbone([1.01], 1.0, -1.0)).all()
    assert np.isnan(backbone(np.array([0.5, 1.3]), -1.0, 1.0)).all()


@pytest.mark.parametrize("amplitude", [1.05, 1.5, 4.0])
def test_gap_oscillator_period(amplitude):
    module = load_problem("gap_oscillator")
    values = {"m": 2.0, "k": 3.0, "delta": 0.8}
    system = module.gap_oscillator(**values)
    period = float(module.period(amplitude, **values))
    p, speed = system.vector(), module.velocity_in_gap(amplitude, **values)

    # a solver of high order must not step across a kink: integrate the contact, cross the gap exactly
    def f(t, x):
        return system.ode(x, p).full().ravel()

    def leaves(t, x):
        return x[0] - values["delta"]

    leaves.terminal = True
    leaves.direction = -1
    contact = solve_ivp(f, (0, period), [amplitude, 0.0], events=leaves, **TIGHT)
    quarter = contact.t[-1] + values["delta"] / -contact.y[1, -1]
    assert 4 * quarter == pytest.approx(period, rel=1e-8)
    assert -contact.y[1, -1] == pytest.approx(speed, rel=1e-10)
    np.testing.assert_array_equal(f(0, [0.5 * values["delta"], speed]), [speed, 0.0])
    assert np.isnan(module.period(values["delta"], **values))


def test_bautin_radii_and_multipliers():
    module = load_problem("bautin")
    for mu, a, count in [(-0.1, 1.0, 2), (0.1, 1.0, 1), (-0.3, 1.0, 0), (0.2, -1.0, 1), (-0.2, -1.0, 0)]:
        radii = module.radii(mu, a)
        assert len(radii) == count
        system = module.bautin(mu=mu, a=a, w0=2.0)
        for r in radii:
            rates = system.ode([r, 0.0], system.vector()).full().ravel()
            np.testing.assert_allclose(rates, [0.0, 2.0 * r], atol=1e-15)
            slope = system.ode_jacobian([r, 0.0], system.vector()).full()[0, 0]
            assert module.multiplier(r, a, 2.0) == pytest.approx(np.exp(2 * np.pi / 2.0 * slope), rel=1e-12)
    unstable, stable = module.multiplier(module.radii(-0.1))
    assert unstable > 1 > stable


def test_bautin_fold():
    module = load_problem("bautin")
    mu, r = module.fold(a=0.8)
    np.testing.assert_allclose(module.radii(mu, 0.8), r, rtol=1e-7)
    assert module.radii(mu - 1e-9, 0.8).size == 0
    assert module.multiplier(r, 0.8) == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("builder", ["van_der_pol", "van_der_pol_first_order"])
@pytest.mark.parametrize("i", [0, 1, 2])
def test_van_der_pol_published(builder, i):
    module = load_problem("van_der_pol")
    cycle = module.PUBLISHED[i]
    system = getattr(module, builder)(mu=cycle.mu)
    motion = turning_times(system, [cycle.peak, 0.0], 1.1 * cycle.period)
    (times, states) = motion.t_events[0], motion.y_events[0]
    later = times > 0.1 * cycle.period
    assert times[later][1] == pytest.approx(cycle.period, abs=1e-8)
    assert states[later][1][0] == pytest.approx(cycle.peak, abs=1e-8)


def test_van_der_pol_multiplier():
    module = load_problem("van_der_pol")
    cycle = module.PUBLISHED[0]
    system = module.van_der_pol(mu=cycle.mu)
    p = system.vector()
    motion = solve_ivp(
        lambda t, x: system.ode(x, p).full().ravel(),
        (0, cycle.period),
        [cycle.peak, 0.0],
        dense_output=True,
        **TIGHT,
    )
    trace, _ = quad(lambda t: cycle.mu * (1 - motion.sol(t)[0] ** 2), 0, cycle.period, epsabs=1e-10, limit=200)
    assert np.exp(trace) == pytest.approx(cycle.multiplier, rel=1e-7)


def test_both_forms_of_van_der_pol_are_one():
    module = load_problem("van_der_pol")
    second, first = module.van_der_pol(mu=1.7), module.van_der_pol_first_order(mu=1.7)
    x = np.array([0.3, -0.8])
    np.testing.assert_allclose(second.ode(x, [1.7]).full(), first.ode(x, [1.7]).full(), rtol=1e-14)
