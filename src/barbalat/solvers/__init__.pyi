from .registry import SOLVERS as SOLVERS
from .tableau import EULER as EULER
from .tableau import HEUN as HEUN
from .tableau import RK4 as RK4
from .tableau import Tableau as Tableau
