"""Hunting of a railway bogie with flange contact, seven degrees of freedom (Yang 1995).

`bogie` builds the system; its module holds the equations of motion, the parameters and the published Table 1.
The other modules compute what the paper shows: Table 1 by `study`, every method on every state by `comparison`,
figures 2 to 6 by `paper`, and by `identification` the creep coefficients, which are not printed. `sketch` draws the
bogie from above.

Source: Y.-R. Yang, Limit cycle hunting of a bogie with flanged wheels, Vehicle System Dynamics 24 (1995) 185-196.
"""

from .bogie import PARAMETER, RANGE, SYSTEM, TABLE_1, State, bogie
from .creep import identification
from .paper import comparison, paper
from .sketch import sketch
from .table_1 import PUSHED, study

__all__ = [
    "PARAMETER",
    "PUSHED",
    "RANGE",
    "SYSTEM",
    "TABLE_1",
    "State",
    "bogie",
    "comparison",
    "identification",
    "paper",
    "sketch",
    "study",
]
