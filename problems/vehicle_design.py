"""The vehicle, its yaw dampers and primary stiffness chosen anew for a higher critical speed.

The vehicle is that of the problem vehicle. Three attractors bring it to hunt: the front bogie, the rear bogie or both
together. Each has its own fold, and the lowest of them all is raised. Stiffness of the primary suspension and the
curve of the yaw dampers may be changed, within what is built. Limits speak against the choice:

- curving without slip: in a curve of radius R a wheelset that stands radially is turned by lb / R against its frame,
  which takes the moment 2 kpx bp^2 lb / R. Creep forces give 2 a muN at most. The sharpest curve in which the wheelsets
  still stand radially has the radius kpx bp^2 lb / (a muN). It is to be 1500 m at most;
- curves entered: the moment by which the bogie resists being turned, over wheelbase and axle load, is 0.1 at most. The
  yaw is that of a curve of 250 m, its rate 1 degree a second;
- comfort: at the service speed every mode of the straight run has a damping ratio of at least 10 %, so that the
  response to a track defect has fallen to a tenth after four periods;
- cant deficiency: a lateral acceleration of 1 m/s2 moves frame and car body by 2 mm at most against the wheelsets. With
  (mc + 2 mb) / (8 kpy) this is the lower bound of kpy.

Conicity grows as wheels wear, and the friction limit depends on the weather. Their factors are those of the study
vehicle_hunting.

Source: D. Boocock, Journal Mechanical Engineering Science 11 (1969) 556-566, and D. E. Newland, ASME Journal of
Engineering for Industry 91 (1969) 908-918, for curving by creep forces until a wheel slips; the rotation resistance is
the X factor of EN 14363. The figures of limits, bounds and scatter are typical ones, chosen for this example: no
standard is quoted for them. Where yours are others, change them in a copy of this file, ``hbbogie design my_copy.py``.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from scipy import stats

from hbbogie import System, load_problem
from hbbogie.design import DampingRatio, Expression, Limit, Uncertainty

VEHICLE = load_problem("vehicle")
SYSTEM, study = VEHICLE.vehicle, VEHICLE.study
PARAMETER = "V"
RANGE = (30.0, 110.0)
SERVICE = 50.0  # m/s
CURVE, RATE = 250.0, np.radians(1.0)  # m, rad/s: where the rotation resistance is taken

UNCERTAIN = Uncertainty(
    {
        "lam": stats.uniform(0.5, 1.0),  # wheels new to worn
        "muN": stats.lognorm(0.2),  # dry to wet rails
    }
)


def slip_radius(p: Any) -> Any:
    """Return the radius of the sharpest curve in which creep forces hold the wheelsets radial [m]."""
    return p["kpx"] * p["bp"] ** 2 * p["lb"] / (p["a"] * p["muN"])


def rotation_resistance(p: Any) -> Any:
    """Return the moment that resists the bogie's rotation, over wheelbase and axle load [1]."""
    w = p["by"] * RATE
    damper = ca.fmin(p["c1"] * w, p["Fb"] + p["c2"] * (w - p["Fb"] / p["c1"]))  # below and beyond blow-off
    moment = 2 * p["ksx"] * p["bs"] ** 2 * p["lc"] / CURVE + 2 * p["by"] * damper
    return moment / (2 * p["lb"] * 2 * p["Q"])


def design(system: System) -> dict[str, Any]:
    """Return what `optimise` is asked for.

    Parameters
    ----------
    system : System
        The vehicle before.
    """
    p = system.values
    return {
        "over": {
            "kpx": (5e6, 40e6),
            "kpy": ((p["mc"] + 2 * p["mb"]) * 1.0 / (8 * 2e-3), 8e6),
            "c1": (100e3, 600e3),
            "Fb": (3e3, 12e3),
            "c2": (5e3, 20e3),
        },
        "subject_to": [
            Limit(Expression("radius without slip", slip_radius, "m"), upper=1500.0),
            Limit(Expression("rotation resistance", rotation_resistance, "1"), upper=0.1),
            Limit(DampingRatio(at=SERVICE), lower=0.1),
        ],
        "harmonics": 9,
    }
