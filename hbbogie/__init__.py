"""Limit cycles of self-excited mechanical systems as nonlinear programs.

``System -> Equations -> Orbit -> Branch``: each is a value, and the verbs are functions. The names for the main tasks
are here. Everything else is reached through its wing, such as `hbbogie.model` for the force laws or `hbbogie.design`
for the limits and objectives of `optimise`. Wings load when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.2.0.dev0"
