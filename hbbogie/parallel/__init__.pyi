from .pool import Pool as Pool
from .pool import worker_pool as worker_pool
from .processes import interruptions as interruptions
from .processes import starting as starting
