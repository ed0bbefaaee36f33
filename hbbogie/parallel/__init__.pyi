from .processes import interruptions as interruptions
from .processes import starting as starting
