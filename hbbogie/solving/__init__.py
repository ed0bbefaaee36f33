"""Solving: Newton's method, one nonlinear program for IPOPT, and one algorithm for curves of solutions.

`Equations` and a guess go in. An `Orbit` comes out, or an `Optimum` if something is minimised.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
