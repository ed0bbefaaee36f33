from .bistability import Coexistence as Coexistence
from .bistability import coexistence as coexistence
from .charts import chart as chart
from .curvature import critical_hessian as critical_hessian
from .folds import fold as fold
from .hopf_curve import HopfCurve as HopfCurve
from .hopf_gradients import hopf_gradient as hopf_gradient
from .speeds import critical_speeds as critical_speeds
