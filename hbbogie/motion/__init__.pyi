from .energy import energy_shares as energy_shares
from .energy import moving_groups as moving_groups
from .integration import simulate as simulate
from .settling import Settled as Settled
from .settling import last_orbit as last_orbit
from .settling import settle as settle
from .slow_parameter import simulate_ramp as simulate_ramp
from .slow_parameter import turning_points as turning_points
