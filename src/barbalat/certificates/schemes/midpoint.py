"""Properties of the Lyapunov function that the midpoint form of a scheme preserves from sample to sample; docs/sampled.md has the
proofs."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from barbalat.adaptation.law import AdaptiveLaw, OutputErrorLaw, SampledLaw
from barbalat.certificates.bounds import laws
from barbalat.certificates.entry import Assumption
from barbalat.certificates.schemes import SchemeFile
from barbalat.certificates.schemes.state_feedback import of_the_case
from barbalat.problem.known_set import EstimateSet, Gain
from barbalat.problem.state_feedback import Problem
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller

PREDICTOR_BESIDE_PROJECTION = (
    "with a gain matrix or a memory, the predictor uses the estimate before its projection: while the projection acts, "
    "x_hat departs from x_m, and with a delay the loop may be lost"
)


class MidpointForm(NamedTuple):
    """A form in which V = theta_tilde'Gamma^-1 theta_tilde never grows by the step of the law.

    metric    Gamma
    box       the set onto which the estimates are projected
    kept      whether V also does not grow with the leakage, if there is one
    rests_on  the assumptions if nothing is claimed for the continuous law; None if nothing is then known
    findings  further findings about the form, as sentences
    """

    metric: Gain
    estimate_set: EstimateSet | None
    kept: bool
    rests_on: tuple[Assumption, ...] | None = None
    findings: tuple[str, ...] = ()

    @property
    def never_cut(self) -> Assumption:
        """With a coupling gain, a point that leaves the set in a step is moved back face by face, which is exact for two
        faces."""
        cut = self.metric.is_matrix and self.estimate_set is not None and self.estimate_set.steps_cut_corners
        return Assumption("a step never cuts a corner", "a gain matrix in corners of the known set" if cut else "")


@runtime_checkable
class MidpointFile(SchemeFile, Protocol):
    """The file of a scheme with a midpoint form."""

    def midpoint_form(self, problem: TrackingProblem, controller: Controller, sample_time: float) -> MidpointForm:
        """Return the properties that the sampled form of a continuous controller preserves."""
        ...


def of_predictor(problem: Problem, controller: laws.ModifiedScheme, *findings: str) -> MidpointForm:
    """Return the preserved properties for L1-AC and for MRAC, whose sampled form has a predictor too."""
    metric, estimate_set = Gain(controller.gamma), controller.bind(problem.known).estimate_set
    kept = controller.leakage is None or controller.leakage.harmless_within is not None
    if metric.is_matrix or controller.learning is not None:
        findings = (*findings, PREDICTOR_BESIDE_PROJECTION)
    return MidpointForm(metric, estimate_set, kept, None if kept else of_the_case(problem, estimate_set), findings)


def of_law(law: AdaptiveLaw | OutputErrorLaw, estimate_set: EstimateSet | None) -> MidpointForm:
    """Return the preserved properties for a law on the parametric model, whose implicit step preserves its V."""
    assert isinstance(law, SampledLaw)  # any other law is rejected by ``adaptation.implicit``
    found = laws.guarantee_of(law, estimate_set)
    return MidpointForm(law.metric, estimate_set, kept=not found.leaks or found.M_0 is not None)
