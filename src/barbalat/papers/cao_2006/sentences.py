"""The abstract, sentence by sentence: the literal reading of each that has a row, and why another has none."""

from __future__ import annotations

from barbalat.papers.finding import Sentence, Source, Unmeasured

SOURCE = Source("cao_2006", "Cao, Patel, Reddy, Hovakimyan, Lavretsky, Wise (AIAA 2006-6347)", "L1's authors")


def _row(row: str, quote: str, statement: str, *literal: str) -> Sentence:
    return Sentence(row=row, source=SOURCE, where="Abstract", quote=quote, statement=statement, literal=literal)


def _none(quote: str, why: str) -> Unmeasured:
    return Unmeasured(where="Abstract", quote=quote, why=why)


COVERAGE = (
    _none("This paper addresses the important issue of robustness for design of feedback control systems.", "an outline"),
    _row(
        "high-gain-phase",
        "a high gain in the feedback loop leads to increased control effort and reduced phase margin",
        "A high gain in the loop reduces the phase margin: the MRAC beside a constant disturbance",
        "the phase margin of the MRAC's loop falls with every rise of the gain that was tried",
    ),
    _row(
        "high-gain-delay",
        "a high adaptive gain, implying fast adaptation, often leads to undesirable high-frequency oscillations in the control signal and sensitivity to time-delays",
        "A high adaptive gain makes the MRAC's loop fast, badly damped and sensitive to delays",
        "at the highest gain the MRAC's loop has a mode with less than a hundredth of critical damping, and a higher frequency than at any lower gain",
        "its delay margin falls with every rise of the gain",
    ),
    _none("Since adaptive controllers are nonlinear, the notion of the phase margin cannot be defined for these architectures.", "a definition"),
    _none(
        "Since the closed-loop retains the linear structure, one can explicitly compute the corresponding gain and phase margins.",
        "proved in three lines: with phi = 1 the law sigma_hat' = Gamma x_tilde'P b and the predictor are linear in x, x_hat, sigma_hat and u, C is linear, and no product of signals is left",
    ),
    _none("the classical definition of the time-delay margin does not hold for the L1 adaptive controller", "not testable here: which definition is meant stands in the text, of which only the abstract is at hand"),
    _row(
        "phase-independent",
        "the phase margin of the L1 adaptive controller is independent of the adaptation rate",
        "L1-AC's phase margin does not depend on the adaptive gain, beside a constant disturbance",
        "with each of three filters the phase margin changes by less than a tenth over ten decades of gain",
    ),
    _row(
        "delay-bounded",
        "its timedelay margin is guaranteed to be bounded away from zero as one increases the speed of adaptation",
        "L1-AC's delay margin stays away from zero as the gain grows, beside a constant disturbance",
        "with each of three filters the delay margin changes by less than a tenth over the last decade of gain, at a value above zero",
    ),
    _row(
        "high-gain-inside",
        "high gain can improve robustness if it is internal to the controller computation block",
        "A higher gain can improve robustness where it is the predictor's: L1-AC",
        "with some filter some rise of the gain raises both the phase and the delay margin",
    ),
    _none("we present also two nonadaptive systems and generalize this phenomenon to a different class of feedback controllers", "not testable here: the systems stand in the text, of which only the abstract is at hand"),
)  # fmt: skip
"""What the abstract states, in its order."""
SENTENCES = {one.row: one for one in COVERAGE if isinstance(one, Sentence)}
"""All that has a row, by the row's name."""
