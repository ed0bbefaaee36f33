"""Methods: each turns a system into equations for its cycles.

``HarmonicBalance(15).equations(system)`` gives `Equations`, the only thing that solvers and continuation see. The
describing functions, the equivalent linear system and the method of the paper are in this wing, too.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
