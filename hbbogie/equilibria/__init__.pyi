from .eigenvalues import Eigenvalues as Eigenvalues
from .find import find_equilibria as find_equilibria
from .hopf import hopf_points as hopf_points
from .linearisation import Linearisation as Linearisation
from .normal_form import first_lyapunov as first_lyapunov
from .normal_form import lyapunov_at as lyapunov_at
from .spectrum import eigenpairs as eigenpairs
from .spectrum import matched as matched
