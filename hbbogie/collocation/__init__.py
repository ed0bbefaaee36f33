"""Cycles of smooth systems by orthogonal collocation on a mesh that adapts: relaxation, spikes, canards, homoclinics.

A `System` goes in. `Collocation` is the method for `hbbogie.solve` and `hbbogie.trace`; `collocated` solves for one
cycle as a piecewise polynomial, and `follow` gives a branch of them with its special points.

>>> import hbbogie as hb
>>> from hbbogie.collocation import collocated, from_motion
>>> system = hb.load_problem("van_der_pol").van_der_pol(mu=10.0)
>>> cycle = collocated(system, from_motion(system, [2.0, 0.0]))
>>> round(cycle.period, 8)
19.07836957
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
