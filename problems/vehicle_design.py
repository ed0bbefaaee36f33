"""The railway vehicle, its primary suspension and yaw dampers chosen anew for a higher critical speed.

The vehicle is that of the problem vehicle. Its critical speed is the lowest fold of three attractors: both bogies hunt,
or the front one, or the rear one. Longitudinal and lateral primary stiffness, and slope, blow-off force and slope
beyond it of the yaw dampers may be changed by -40 % to +60 %. Three limits speak against it:

- curving: the primary yaw stiffness 2 kpx bp^2 of a wheelset may not grow. The stiffer it is, the less the wheelsets
  can steer, and the more flanges and rails wear;
- comfort: hunting at a tenth above the critical speed, the lateral acceleration of both frames above their outer
  wheelsets has a root mean square below the instability criterion of EN 14363, as quoted in `frame_acceleration_limit`,
  for a bogie with its two wheelsets;
- cost: the squares of the logarithms of all changes add up to 0.5 at most.

Conicity changes with wear, friction with the weather. The creep coefficients are left as they are: friction enters by
its limit. The factors are taken as independent.

Source: the problem vehicle for the data; bounds, limits and scatter are typical figures, chosen for this example.
"""

from __future__ import annotations

from typing import Any

from scipy import stats

from hbbogie import System, load_problem
from hbbogie.design import Expression, Limit, RootMeanSquare, Uncertainty, cost_of_change
from hbbogie.railway import frame_acceleration_limit

SYSTEM = load_problem("vehicle").vehicle
PARAMETER = "V"
RANGE = (30.0, 130.0)
SERVICE = 55.0  # m/s, about 200 km/h
HARMONICS = 9  # of the search; the folds of its result are solved for with more
CHANGED = ("kpx", "kpy", "c1", "Fb", "c2")

UNCERTAIN = Uncertainty(
    {
        "lam": stats.uniform(0.5, 1.0),  # conicity from 0.1, new wheels, to 0.3, worn ones
        "muN": stats.lognorm(0.2),  # friction on dry and on wet rails
    }
)


def yaw_stiffness(p: Any) -> Any:
    """Return the primary yaw stiffness of a wheelset [N m/rad]."""
    return 2 * p["kpx"] * p["bp"] ** 2


def design(system: System) -> dict[str, Any]:
    """Return what `optimise` is asked for.

    Parameters
    ----------
    system : System
        The vehicle before.
    """
    before = system.values
    allowed = frame_acceleration_limit(before["mb"] + 2 * before["mw"]).value
    hunting = [f"{where} frame acceleration, outer" for where in ("front", "rear")]
    return {
        "over": {name: (0.6 * before[name], 1.6 * before[name]) for name in CHANGED},
        "subject_to": [
            Limit(Expression("primary yaw stiffness", yaw_stiffness, "N m/rad"), upper=yaw_stiffness(before)),
            *(Limit(RootMeanSquare(of, overspeed=0.1, unit="m/s2"), upper=allowed) for of in hunting),
            Limit(cost_of_change(system, CHANGED), upper=50.0),
        ],
        "harmonics": HARMONICS,
    }
