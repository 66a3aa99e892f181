from .problem.regressors import GaussianRBF as GaussianRBF
from .problem.regressors import Linear as Linear
from .problem.regressors import Polynomial as Polynomial
from .problem.regressors import Regressor as Regressor
from .problem.regressors import Terms as Terms
