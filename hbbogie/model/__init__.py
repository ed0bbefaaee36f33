"""Models: symbolic equations of motion, and their analysis.

A `System` is made from `Coordinate`, `Parameter`, equations and `Element`, which applies a force law to coordinates or
velocities. Everything above this wing takes the `System`. `load_problem` reads one from a problem file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
