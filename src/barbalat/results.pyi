from .certificates.certificate import Certificate as Certificate
from .certificates.certificates import Certificates as Certificates
from .run.ensemble import EnsembleResult as EnsembleResult
from .run.plot import plot as plot
from .run.result import Result as Result
from .run.results import Results as Results
