"""Two methods, one truth: collocation against harmonic balance or the exact method on every shipped problem."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

import hbbogie as hb
from hbbogie import Collocation, HarmonicBalance, ModelError, load_problem
from hbbogie.branches import cycle_after
from hbbogie.exact import Exact
from hbbogie.model import shipped_problems


@dataclass(frozen=True)
class Case:
    """A system and values of its parameter.

    Cycles are searched for at the first value, or taken from the first points of the branch of a Hopf point, and
    followed to the others. Harmonics are as many as the waveform takes; none where the exact method is the truth.
    """

    values: tuple[float, ...]
    harmonics: int = 63
    system: dict[str, object] = field(default_factory=dict)
    beside_hopf: int = 0


JUMPS, FAMILY = "it jumps; a test of its own below", "a family; a test of its own below"
CASES: dict[str, tuple[Case, ...] | str] = {
    "bautin": (Case((-0.2, -0.1)), Case((0.1, 0.15))),
    "circuit": (Case((-0.6, -0.595)),),
    "duffing": FAMILY,
    "gap_oscillator": FAMILY,
    "isola": (Case((0.0, 0.3)),),
    "kaas_petersen1986": (Case((68.0, 68.3)), Case((60.0, 60.5), 63, {"flange": False})),
    "piecewise": JUMPS,
    "simple_bogie": (
        Case((66.0,)),
        Case((66.0, 66.4), 63, {"flange": False}),
        Case((75.0, 78.0), 63, {"flange": False}),
    ),
    "train": (Case((), 31, {"n": 2}, beside_hopf=10),),
    "van_der_pol": (Case((0.5, 1.0, 2.0)),),
    "vehicle": (Case((), 31, beside_hopf=20),),
    "vehicle_design": "its system is that of vehicle",
    "wheelset": (Case((48.0, 46.0, 60.0), 0),),
    "yang1995": (Case((90.0, 89.0, 100.0), 0),),
    "yang1995_design": (Case((95.0, 120.0), 0),),
}


def cycles_of(case: Case, system: hb.System, parameter: str, span: tuple[float, float]) -> list[hb.Orbit]:
    if not case.beside_hopf:
        return hb.find_cycles(system, parameter=parameter, **{parameter: case.values[0]})
    hopf, *_ = hb.hopf_points(system, parameter, span)
    balance = HarmonicBalance(7).equations(system)
    branch = hb.trace(balance, hopf, parameter, span, stability=False, max_points=case.beside_hopf)
    return [branch.orbits[-1]]


@pytest.mark.parametrize("name", shipped_problems())
def test_frequencies(name):
    """SOLVER: frequencies to 1e-8 at several values of the parameter."""
    assert name in CASES, f"problem {name!r} has no entry in CASES; say at which values the two methods are compared"
    cases, module = CASES[name], load_problem(name)
    if isinstance(cases, str):
        pytest.skip(cases)
    for case in cases:
        system = module.SYSTEM(**case.system)
        truth = (HarmonicBalance(case.harmonics) if case.harmonics else Exact()).equations(system)
        collocation = Collocation().equations(system)
        for orbit in cycles_of(case, system, module.PARAMETER, module.RANGE):
            for value in case.values or (orbit.parameters[module.PARAMETER],):
                at = {module.PARAMETER: value}
                orbit = hb.solve(truth, orbit, method="newton", **at) if case.harmonics else truth.solve(orbit, **at)
                cycle = collocation.cycle(orbit, **at)
                assert cycle.omega == pytest.approx(orbit.omega, rel=1e-8), (name, case, value)


@pytest.mark.parametrize("name", [name for name, cases in CASES.items() if cases == JUMPS])
def test_laws_that_jump_are_refused(name):
    with pytest.raises(ModelError, match="jumps"):
        Collocation().equations(load_problem(name).SYSTEM())


@pytest.mark.parametrize("amplitude", [1.2, 2.5])
def test_families_of_conservative_systems(amplitude):
    """IDENTITY: frequency over amplitude in closed form, of whichever member collocation comes to."""
    duffing, gap = load_problem("duffing"), load_problem("gap_oscillator")
    truths = ((duffing, duffing.backbone), (gap, lambda a: 2 * np.pi / gap.period(a)))
    for module, frequency in truths:
        system = module.SYSTEM()
        cycle = Collocation().equations(system).cycle(cycle_after(system, [amplitude, 0.0]))
        peak = cycle.amplitude(system.coordinate_names[0])
        assert cycle.omega == pytest.approx(float(frequency(peak)), rel=1e-8)
        assert peak > 1.1
        assert "one of a continuous family" in cycle.status
