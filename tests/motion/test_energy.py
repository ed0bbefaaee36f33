import numpy as np
import pytest

import hbbogie as hb
from hbbogie.motion import energy_shares, moving_groups


def pair(coupling=0.0):
    """Two oscillators of different frequencies that are stable at rest and hunt beyond a threshold."""
    x, y = (hb.Coordinate(n, "m", group=f"{side} bogie") for n, side in (("x", "front"), ("y", "rear")))
    mu, m = hb.Parameter("mu", -0.1), hb.Parameter("m", 3.0)

    def force(u, stiffness):
        s = stiffness * u**2 + u.dot**2
        return stiffness * u - (mu + s - s**2) * u.dot

    equations = [x.ddot + force(x, 1.0) + coupling * (x - y), m * (y.ddot + force(y, 2.5)) + coupling * (y - x)]
    return hb.System("pair", [x, y], [mu, m], equations)


def orbit_of(system, x, y):
    """Return x cos t, y sin t."""
    return hb.Orbit(
        system=system.name,
        coordinates=("x", "y"),
        units=("m", "m"),
        motion=np.array([[0.0, 0.0], [x, 0.0], [0.0, y]]),
        omega=2.0,
        parameters=dict(system.values),
    )


def test_shares_of_the_kinetic_energy():
    system = pair()
    assert system.groups == {"front bogie": ("x",), "rear bogie": ("y",)}
    shares = energy_shares(system, orbit_of(system, 2.0, 1.0))  # m v^2: 1 * 2^2 and 3 * 1^2
    assert shares == pytest.approx({"front bogie": 4 / 7, "rear bogie": 3 / 7}, rel=1e-14)


@pytest.mark.parametrize(
    ("x", "y", "said"), [(1.0, 0.1, "front bogie"), (0.1, 1.0, "rear bogie"), (1.0, 1.0, "both"), (0.0, 0.0, "")]
)
def test_groups_that_move(x, y, said):
    system = pair()
    assert moving_groups(system, orbit_of(system, x, y)) == said


def test_systems_without_groups():
    x = hb.Coordinate("x", "m"), hb.Coordinate("y", "m")
    system = hb.System("plain", x, [], [u.ddot + u for u in x])
    assert system.groups == {} == energy_shares(system, orbit_of(system, 1.0, 1.0))
    assert moving_groups(system, orbit_of(system, 1.0, 1.0)) == ""


def test_find_cycles_looks_at_motions_of_one_group():
    """Weakly coupled, each oscillator hunts alone below the Hopf points."""
    system = pair(coupling=0.02)
    found = [moving_groups(system, o) for o in hb.find_cycles(system, mu=-0.1) if o.verdict == "stable"]
    assert {"front bogie", "rear bogie"} <= set(found)


def test_group_is_a_text():
    with pytest.raises(hb.ModelError, match="as group"):
        hb.Coordinate("x", group=1)
