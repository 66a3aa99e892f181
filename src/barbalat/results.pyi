from .certificates.certificate import Certificate as Certificate
from .certificates.certificates import Certificates as Certificates
from .judge.verdict import Verdict as Verdict
from .run.engine.ensemble import EnsembleResult as EnsembleResult
from .run.results.result import Result as Result
from .run.results.result import Results as Results
from .run.results.result import plot as plot
