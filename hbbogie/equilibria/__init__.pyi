from .eigenvalues import Eigenvalues as Eigenvalues
from .hopf import hopf_points as hopf_points
from .linearisation import Linearisation as Linearisation
from .normal_form import first_lyapunov as first_lyapunov
from .normal_form import lyapunov_at as lyapunov_at
