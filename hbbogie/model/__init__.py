"""Models: equations of motion written symbolically, and what analysis finds in them.

A `System` is made from `Coordinate`, `Parameter`, equations and `Element`, each of which puts a force law at its place.
Everything above this wing takes the `System`. `load_problem` reads one from a problem file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
