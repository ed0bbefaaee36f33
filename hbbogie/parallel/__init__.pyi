from .calls import each as each
from .calls import in_processes as in_processes
from .calls import processes_asked as processes_asked
from .pool import Pool as Pool
from .pool import worker_pool as worker_pool
from .processes import interruptions as interruptions
from .processes import starting as starting
