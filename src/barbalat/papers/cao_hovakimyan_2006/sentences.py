"""The abstract, sentence by sentence. Sentences with a row have literal readings. For every other sentence the file says why it
has no row."""

from __future__ import annotations

from barbalat.papers.finding import Change, Sentence, Unmeasured
from barbalat.papers.jafari_2013.statements import CAO_HOVAKIMYAN_2006


def _row(row: str, quote: str, statement: str, *literal: str, equation: str, changed: tuple[Change, ...] = ()) -> Sentence:
    return Sentence(
        row=row,
        source=CAO_HOVAKIMYAN_2006,
        where="Abstract",
        quote=quote,
        statement=statement,
        literal=literal,
        equation=equation,
        changed=changed,
    )


def _none(quote: str, why: str) -> Unmeasured:
    return Unmeasured(where="Abstract", quote=quote, why=why)


COVERAGE = (
    _row(
        "mrac-transient",
        "offers no means for characterizing the system's input/output performance during the transient phase",
        "The transients of the conventional MRAC's state and input have no bound that is known beforehand",
        "the bound (9) on the state, nu_0/sqrt(Gamma) for e(0) = 0, does not characterise it: some random run exceeds the bound, "
        "or the largest |e| does not fall with each decade of the gain from 1e2 to 1e4",
        "the bound |theta_hat|_1 (sup |x_m| + nu_0/sqrt(Gamma)) + k_0 sup |r| on the input, which follows from (9) and the "
        "projection, does not characterise it: at least one of the random runs exceeds the bound",
        equation="(3), (4), (9) of jafari_2013",
        changed=(
            Change(date="2026-11-26", before="fails", after="mixed", what="a bound on the state or on the input had been "
                "sufficient for this row; it now requires one means for each. For the input it required a distance from the "
                "ideal input that falls with the gain"),
            Change(date="2026-11-27", before="mixed", after="fails", what="a bound on |u| that is known beforehand is a means of characterising it; the distance from the ideal input is supplementary"),
        ),
    ),
    _none("Application of adaptive controllers was therefore largely restricted", "not testable here: it concerns the history of the field"),
    _none(
        "ensures that the input and the output of an uncertain linear system track the input and output of a desired linear system during the transient phase",
        "measured in the ledger of jafari_2013: barbalat claims l1-reference-system",
    ),
    _row(
        "asymptotic-tracking",
        "track the input and output of a desired linear system during the transient phase, in addition to the asymptotic tracking",
        "L1-AC's state and input tend to those of its reference system",
        "at Gamma = 100 the largest |x - x_ref| in the last quarter of 60 s is less than a tenth of the largest in the first quarter",
        "the same holds for the largest |u - u_ref|",
        equation="(5) to (8) of jafari_2013",
        changed=(
            Change(date="2026-11-27", before="holds", after="holds", what="the quotation now says that input and output are tracked; the row had tested only the state"),
        ),
    ),
    _row(
        "gain-enforces-transient",
        "a low-pass filter in the feedback-loop that enables to enforce the desired transient performance by increasing the adaptation gain",
        "With steps that resolve the gain, L1-AC's transient comes closer to that of its reference system as the gain grows",
        "the largest |x - x_ref| falls with each decade of the gain from 1e2 to 1e4",
        "the largest |u - u_ref| falls with each decade too",
        equation="(5) to (8) of jafari_2013",
    ),
    _none("is required to be less than the inverse of the upper bound of the norm of unknown parameters", "a definition: the condition of Theorem 1 (ii); barbalat claims filter-limits-theta measures how far beyond it the loop is stable"),
    _none("The ideal (non-adaptive) version of this L1 adaptive controller is used along with the main system dynamics to define a closed-loop reference system", "a definition"),
)  # fmt: skip
"""The statements of the abstract in the order of the text, as far as the text was available."""
SENTENCES = {one.row: one for one in COVERAGE if isinstance(one, Sentence)}
"""The sentences that have a row, by the row's name."""
