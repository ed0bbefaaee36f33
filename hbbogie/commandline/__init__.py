"""The command line: ``hbbogie COMMAND NAME ...``.

This wing reads arguments, runs a job of `hbbogie.reports`, and shows and writes its report. Numerics and figures are
imported only inside the commands.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
