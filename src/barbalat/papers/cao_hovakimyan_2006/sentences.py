"""The abstract, sentence by sentence: the literal reading of each that has a row, and why another has none."""

from __future__ import annotations

from barbalat.papers.finding import Sentence, Unmeasured
from barbalat.papers.jafari_2013.statements import CAO_HOVAKIMYAN_2006


def _row(row: str, quote: str, statement: str, *literal: str) -> Sentence:
    return Sentence(row=row, source=CAO_HOVAKIMYAN_2006, where="Abstract", quote=quote, statement=statement, literal=literal)


def _none(quote: str, why: str) -> Unmeasured:
    return Unmeasured(where="Abstract", quote=quote, why=why)


COVERAGE = (
    _row(
        "mrac-transient",
        "offers no means for characterizing the system's input/output performance during the transient phase",
        "Nothing bounds the transient of the conventional MRAC, its state and its input",
        "(9), nu_0/sqrt(Gamma), does not bound the MRAC's error: some run of those drawn exceeds it",
        "nor is the input bounded by what (9) and the projection make of it, |theta_hat|_1 (sup |x_m| + nu_0/sqrt(Gamma)) + k_0 sup |r|: some run exceeds that",
    ),
    _none("Application of adaptive controllers was therefore largely restricted", "not testable here: on the history of the field"),
    _none(
        "ensures that the input and the output of an uncertain linear system track the input and output of a desired linear system during the transient phase",
        "measured in the ledger of jafari_2013: barbalat claims l1-reference-system",
    ),
    _row(
        "asymptotic-tracking",
        "in addition to the asymptotic tracking",
        "L1-AC's state tends to that of its reference system",
        "the largest |x - x_ref| of the last quarter of 60 s is less than a tenth of that of the first quarter, at Gamma = 100",
    ),
    _row(
        "gain-enforces-transient",
        "a low-pass filter in the feedback-loop that enables to enforce the desired transient performance by increasing the adaptation gain",
        "A higher gain brings L1-AC's transient nearer to that of its reference system, at steps that resolve it",
        "the largest |x - x_ref| falls with each decade of the gain from 1e2 to 1e4",
        "so does the largest |u - u_ref|",
    ),
    _none("is required to be less than the inverse of the upper bound of the norm of unknown parameters", "a definition: the condition of Theorem 1 (ii); how far beyond it the loop is stable says barbalat claims filter-limits-theta"),
    _none("The ideal (non-adaptive) version of this L1 adaptive controller is used along with the main system dynamics to define a closed-loop reference system", "a definition"),
)  # fmt: skip
"""What the abstract states, in its order, as far as it was at hand."""
SENTENCES = {one.row: one for one in COVERAGE if isinstance(one, Sentence)}
"""All that has a row, by the row's name."""
