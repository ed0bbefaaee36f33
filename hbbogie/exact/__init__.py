"""Cycles of systems that are linear between the switchings of piecewise-linear laws, in closed form.

A `System` that is linear between switchings goes in. `follow` gives the whole branch with its grazings and folds,
`critical_values` the folds and Hopf points of many designs at once, and `cycle_of` a cycle as plain data.

>>> import hbbogie as hb
>>> from hbbogie.exact import at_grazing, cycle_of, follow
>>> bogie = hb.load_problem("yang1995").bogie()
>>> (hopf,) = hb.hopf_points(bogie, "V", (60.0, 190.0))
>>> walk = follow(at_grazing(bogie, hopf), (60.0, 190.0))
>>> round(walk.marked("fold")[0].value, 9)
88.764113194
>>> print(walk.end)
the end of the interval, 190
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
