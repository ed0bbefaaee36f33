"""Yang's bogie, its suspension chosen anew for a higher critical speed.

The bogie is that of the problem yang1995. Its critical speed is a fold: below it no hunting cycle exists, and between
it and the Hopf point a large disturbance starts hunting. Seven suspension parameters may be changed by -40 % to +60 %,
what springs and dampers from a catalogue allow without another layout. Four limits speak against the stiffest choice:

- curving: the primary yaw stiffness 2 K2 d1^2 of a wheelset may grow by a fifth at most. The stiffer it is, the less
  the wheelsets can steer, and the more flanges and rails wear;
- passing disturbances: at the service speed every mode of the straight run has a damping ratio of at least 6 %, so
  that the response to a track defect has fallen to a tenth after six periods;
- derailment: hunting at a tenth above the critical speed, the flange of the front wheelset is pressed against the
  rail with 32 kN at most, just below half the static load of a wheel;
- cost: the squares of the logarithms of all changes add up to 0.5 at most, a factor of 1.31 on each of seven.

The creep coefficients depend on the weather, the conicity on wear, stiffnesses and dampers scatter in manufacture;
their factors are taken as independent.

Source: Y.-R. Yang, Limit cycle hunting of a bogie with flanged wheels, Vehicle System Dynamics 24 (1995) 185-196, for
the bogie; bounds, limits and scatter are typical figures, chosen for this example.
"""

from __future__ import annotations

from typing import Any

from scipy import stats

from hbbogie import System, load_problem
from hbbogie.design import DampingRatio, Expression, Limit, Peak, Uncertainty, cost_of_change

SYSTEM = load_problem("yang1995").bogie
PARAMETER = "V"
RANGE = (60.0, 190.0)
SERVICE = 80.0  # m/s
CHANGED = ("K1", "K2", "K3", "K4", "K6", "D1", "D2")

UNCERTAIN = Uncertainty(
    {
        "f11": stats.lognorm(0.1),  # weather and surface of the rail
        "f22": stats.lognorm(0.1),
        "lam": stats.uniform(0.8, 0.4),  # wheels new to worn
        "K1": stats.norm(1, 0.05),
        "K2": stats.norm(1, 0.05),
        "K6": stats.norm(1, 0.05),
        "D2": stats.norm(1, 0.1),
    }
)


def yaw_stiffness(p: Any) -> Any:
    """Return the primary yaw stiffness of a wheelset [N m/rad]."""
    return 2 * p["K2"] * p["d1"] ** 2


def design(system: System) -> dict[str, Any]:
    """Return what `optimise` is asked for.

    Parameters
    ----------
    system : System
        The bogie before.
    """
    before = system.values
    return {
        "over": {name: (0.6 * before[name], 1.6 * before[name]) for name in CHANGED},
        "subject_to": [
            Limit(Expression("primary yaw stiffness", yaw_stiffness, "N m/rad"), upper=1.2 * yaw_stiffness(before)),
            Limit(DampingRatio(at=SERVICE), lower=0.06),
            Limit(Peak("front flange", overspeed=0.1, unit="N"), upper=32e3),
            Limit(cost_of_change(system, CHANGED), upper=50.0),
        ],
    }
