"""Motion in time: integration, the state to which a motion settles, and slowly changing parameters.

A `System` and a start go in. A `Trajectory` comes out, whose last period can be turned into an `Orbit`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
