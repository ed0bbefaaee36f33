"""Motion in time: integration, what a motion settles on, and slowly changing parameters.

A `System` and a start go in; a `Trajectory` comes out, and from its last period an `Orbit`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
