"""What a scheme's midpoint form keeps of its Lyapunov function from sample to sample; docs/sampled.md has the proofs."""

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
    "with a gain matrix or learning the predictor is fed with the estimate before its projection: while the projection acts, "
    "x_hat leaves x_m, and with a delay the loop may be lost"
)


class MidpointForm(NamedTuple):
    """V = theta_tilde'Gamma^-1 theta_tilde never grows by the law's step.

    metric    Gamma
    box       what is projected onto
    kept      whether that holds with the leakage too, where there is one
    rests_on  what it rests on where the continuous law claims nothing; None where nothing is then known
    findings  what else is known of the form, as sentences
    """

    metric: Gain
    estimate_set: EstimateSet | None
    kept: bool
    rests_on: tuple[Assumption, ...] | None = None
    findings: tuple[str, ...] = ()

    @property
    def never_cut(self) -> Assumption:
        """What lies outside after a step with a coupling gain is brought back face by face, which is exact for two of them."""
        cut = self.metric.is_matrix and self.estimate_set is not None and self.estimate_set.steps_cut_corners
        return Assumption("a step never cuts a corner", "a gain matrix in corners of the known set" if cut else "")


@runtime_checkable
class MidpointFile(SchemeFile, Protocol):
    """A scheme's file that knows its midpoint form."""

    def midpoint_form(self, problem: TrackingProblem, controller: Controller, sample_time: float) -> MidpointForm:
        """Say what the sampled form of a continuous controller keeps."""
        ...


def of_predictor(problem: Problem, controller: laws.ModifiedScheme, *findings: str) -> MidpointForm:
    """Say what the sampled form keeps for L1-AC and for the MRAC, whose sampled form has a predictor too."""
    metric, estimate_set = Gain(controller.gamma), controller.bind(problem.known).estimate_set
    kept = controller.leakage is None or controller.leakage.harmless_within is not None
    if metric.is_matrix or controller.learning is not None:
        findings = (*findings, PREDICTOR_BESIDE_PROJECTION)
    return MidpointForm(metric, estimate_set, kept, None if kept else of_the_case(problem, estimate_set), findings)


def of_law(law: AdaptiveLaw | OutputErrorLaw, estimate_set: EstimateSet | None) -> MidpointForm:
    """Say what the sampled form keeps for a law on the parametric model, whose own implicit step keeps its V."""
    assert isinstance(law, SampledLaw)  # any other law is refused: ``adaptation.implicit``
    found = laws.guarantee_of(law, estimate_set)
    return MidpointForm(law.metric, estimate_set, kept=not found.leaks or found.M_0 is not None)
