"""The abstract, sentence by sentence. Sentences with a row have literal readings. For every other sentence the file says why it
has no row."""

from __future__ import annotations

from barbalat.papers.finding import Change, Sentence, Source, Unmeasured

SOURCE = Source("cao_2006", "Cao, Patel, Reddy, Hovakimyan, Lavretsky, Wise (AIAA 2006-6347)", "L1's authors")

EQUATION = "(5), (6), (7), (8) of jafari_2013 with phi = 1 in place of x; for MRAC with C = 1"
"""The loop that every row measures, because the abstract has no equation."""


def _row(row: str, quote: str, statement: str, *literal: str, changed: tuple[Change, ...] = ()) -> Sentence:
    return Sentence(
        row=row,
        source=SOURCE,
        where="Abstract",
        quote=quote,
        statement=statement,
        literal=literal,
        equation=EQUATION,
        changed=changed,
    )


def _none(quote: str, why: str) -> Unmeasured:
    return Unmeasured(where="Abstract", quote=quote, why=why)


COVERAGE = (
    _none("This paper addresses the important issue of robustness for design of feedback control systems.", "an outline"),
    _row(
        "high-gain-phase",
        "a high gain in the feedback loop leads to increased control effort and reduced phase margin",
        "Under a constant disturbance, a high gain in the MRAC loop increases the control effort and reduces the phase margin",
        "the peak gain from the disturbance to the control in the MRAC loop is more than a tenth larger at the highest gain tried than at the lowest",
        "the phase margin of the MRAC loop is more than a tenth smaller there than at the lowest gain",
        changed=(
            Change(date="2026-11-27", before="holds", after="holds", what="the sentence is quoted in full, and the control effort is measured too; the quotation had consisted of three words"),
        ),
    ),
    _row(
        "high-gain-delay",
        "a high adaptive gain, implying fast adaptation, often leads to undesirable high-frequency oscillations in the control signal and sensitivity to time-delays",
        "A high adaptive gain makes the MRAC loop fast, poorly damped and sensitive to delays",
        "at the highest gain the MRAC loop has a mode with a damping ratio below a hundredth, and a higher frequency than at the lowest gain",
        "its delay margin is more than a tenth smaller there than at the lowest gain",
        changed=(
            Change(date="2026-11-26", before="holds", after="holds", what="a high gain is compared with the lowest; the literal reading had required a fall with every increase"),
        ),
    ),
    _none("Since adaptive controllers are nonlinear, the notion of the phase margin cannot be defined for these architectures.", "a definition"),
    _none("A more generalized notion is the time-delay margin that can serve as a measure for the system robustness.", "a definition"),
    _none("In this paper, we consider a linear system under constant disturbance in the presence of some type of a high-gain in the feedback loop.", "an outline"),
    _none("We explore two different adaptive control architectures, conventional model reference adaptive control (MRAC) and an L1 adaptive controller.", "an outline"),
    _none(
        "Since the closed-loop retains the linear structure, one can explicitly compute the corresponding gain and phase margins.",
        "proved in three lines: with phi = 1 the law sigma_hat' = Gamma x_tilde'P b and the predictor are linear in x, x_hat, "
        "sigma_hat and u; C is linear too, so the loop contains no product of signals",
    ),
    _none("the classical definition of the time-delay margin does not hold for the L1 adaptive controller", "not testable here: the definition is in the text, and only the abstract is available"),
    _row(
        "phase-independent",
        "the phase margin of the L1 adaptive controller is independent of the adaptation rate",
        "Under a constant disturbance, L1-AC's phase margin does not depend on the adaptive gain",
        "with each of three filters the phase margin changes by less than a tenth over ten decades of gain",
        changed=(
            Change(date="2026-11-26", before="holds if", after="fails", what="the condition restricted the gain, although the sentence says that the phase margin does not depend on it; that reading is supplementary now"),
            Change(date="2026-11-27", before="fails", after="fails", what="the headline says that the loop is ours, and above which gain the phase margin no longer depends on the gain"),
        ),
    ),
    _row(
        "delay-bounded",
        "its timedelay margin is guaranteed to be bounded away from zero as one increases the speed of adaptation",
        "Under a constant disturbance, L1-AC's delay margin stays away from zero as the gain grows",
        "with each of three filters the delay margin changes by less than a tenth over the last decade of gain and stays above zero",
    ),
    _none("the time-delay margin cannot be related to the phase margin straightforwardly and therefore constitutes a broader concept for measuring system robustness", "not testable here: a conclusion from the rows phase-independent and delay-bounded"),
    _row(
        "high-gain-inside",
        "high gain can improve robustness if it is internal to the controller computation block",
        "A higher gain can improve robustness if it acts inside the controller, as the gain of L1-AC's predictor does",
        "with some filter, some increase of the gain raises both the phase margin and the delay margin",
    ),
    _none("we present also two nonadaptive systems and generalize this phenomenon to a different class of feedback controllers", "not testable here: the systems are in the text, and only the abstract is available"),
)  # fmt: skip
"""The statements of the abstract, in the order of the text."""
SENTENCES = {one.row: one for one in COVERAGE if isinstance(one, Sentence)}
"""The sentences that have a row, by the row's name."""
