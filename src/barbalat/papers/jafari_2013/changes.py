"""Changes made to rows after their measurement: to literal or weaker readings, quotations or settings."""

from __future__ import annotations

from barbalat.papers.finding import Change, Finding

AUDIT, REFEREE = "2026-11-26", "2026-11-27"


def _change(date: str, before: Finding | None, after: Finding, what: str) -> Change:
    return Change(date=date, before=before, after=after, what=what)


CHANGED: dict[str, tuple[Change, ...]] = {
    "minus-mu-s": (
        _change("2026-11-25", "fails", "holds", "the literal reading had required agreement at every tau of the robust MRAC; "
        "the sentence says 'may', for which one instance is sufficient"),
    ),
    "tau-error": (
        _change("2026-11-25", "holds", "holds", "the reading now says what is tested; the test is unchanged"),
        _change(REFEREE, "holds", "holds", "the headline says that nu is read off the runs and that (14) has its sign corrected"),
    ),
    "same-lyapunov": (
        _change("2026-11-25", "holds", "mixed", "the filter beyond the limit has kappa = 1 s: with the former 0.5 s the growth "
        "in 20 s was too slow to be distinguished from the response to the command"),
        _change(AUDIT, "mixed", "holds", "the literal reading had also required a filter beyond the limit, which the sentence "
        "does not mention; that reading is supplementary now"),
    ),
    "robust-mrac-better": (
        _change(AUDIT, "fails", "holds if", "a reading with the paper's filter (6) was missing"),
        _change(AUDIT, "holds if", "fails", "delays, previously known to a factor of two, are now bisected; the same number of "
            "tunings is compared for each scheme"),
        _change(REFEREE, "fails", "holds", "for 'can' one instance that beats Section V's L1-AC is sufficient; the literal "
        "reading had required that every tuning of L1-AC be beaten, which no-advantage decides"),
        _change(REFEREE, "holds", "fails", "one tuning out of 64 had been compared with an untuned L1-AC, which seven of the "
        "tuned L1-ACs beat too; both sides are tuned now, and the comparison with Section V's L1-AC is supplementary"),
    ),
    "no-advantage": (
        _change(AUDIT, "fails", "fails", "the quotation now includes the paper's reason, the robust MRAC, so the row compares "
        "L1-AC with it"),
        _change(REFEREE, "fails", "fails", "only this row now decides about tunings that no tuning of the other side beats; "
        "robust-mrac-better has its own literal reading"),
    ),
    "filter-reduces-margins": (
        _change(AUDIT, "fails", "fails", "the quotation ends before the next claim, the bias; at equal error both sides are "
        "tuned by one rule, and second-order filters (two slopes) are included"),
        _change(REFEREE, "fails", "fails", "the row quotes Section VI, the place that it names first; the sentence of the "
        "abstract has a separate entry in the table of coverage"),
    ),
    "bias-kappa": (
        _change(AUDIT, "mixed", "mixed", "proportionality is required at Section V's kappa, no longer over the range that "
        "Theorem 1 admits"),
    ),
    "no-numerical-problems": (
        _change(AUDIT, None, "holds if", "its literal reading was written together with its measurement"),
        _change(AUDIT, "holds if", "holds", "the literal reading had required the property at every tau; the sentence concerns "
        "Section V's settings"),
    ),
    "exponential-convergence": (
        _change(AUDIT, "holds if", "fails", "the condition replaced law (15) of the paper, which a weaker reading must "
        "include; that reading is supplementary now"),
    ),
    "stiff-solvers": (
        _change(AUDIT, "fails", "fails", "the ringing is judged where it occurs, from 0.5 to 6.4 s, with its drift removed; "
        "each implicit method is tried at all gains"),
        _change(REFEREE, "fails", "fails", "the headline now states the number that decides and that no singularity was found"),
    ),
    "oscillation-without-filter": (
        _change(REFEREE, "holds", "holds", "'cannot' requires a search for a filter that can; the row had tried only Section "
        "V's"),
    ),
    "sampled-delay": (
        _change(REFEREE, "holds", "holds", "the statement now says what its literal reading tests, a shorter delay; it had said "
        "that no robustness is left"),
    ),
    "own-oscillation": (
        _change(AUDIT, "mixed", "mixed", "ringing is now measured as in stiff-solvers"),
        _change(REFEREE, "mixed", "holds if", "the literal reading compares the equations' ringing with Figure 3's in every "
        "second of the run; it had judged the last quarter, and the run without projection, which the sentence does not "
        "mention"),
    ),
    "gain-reduces-margins": (
        _change(AUDIT, "mixed", "mixed", "a high gain is compared with a moderate one; the literal reading had required a fall "
        "with every increase"),
        _change(REFEREE, "mixed", "holds", "the comparison is between the highest and the lowest gain of the sweep, the rule "
        "for a sentence without an example; Gamma = 10 had been the moderate gain"),
        _change(REFEREE, "holds", "mixed", "the quoted sentence spoke of the literature. A sentence of Section III.B is quoted "
            "instead and read at Section V's settings, Gamma = 10 and 1e4; the ends of the sweep are supplementary"),
        _change(REFEREE, "mixed", "holds", "that sentence concerns only the MRAC schemes of Section III, as its beginning says; "
        "the quotation now includes that beginning, and L1-AC's reading is supplementary"),
    ),
    "filtered-mrac": (
        _change(AUDIT, "holds if", "fails", "the condition C = 1, which no MRAC could fail, was replaced by two conditions "
        "on the speed of the filter, which an MRAC can fail"),
        _change(REFEREE, "fails", "holds if", "the weaker reading with the predictor (8) in MRAC was missing"),
        _change(REFEREE, "holds if", "fails", "that reading restricts no setting, and no MRAC could fail it: (3), (7), (8) with "
        "C are (5)-(8); it is supplementary now"),
    ),
    "kappa-0.05": (
        _change(AUDIT, "holds if", "erratum", "the rule on rounding was added: a limit that is rounded to its unsafe side "
        "fails, and the correction adds the missing digit"),
    ),
    "part-iii": (
        _change(REFEREE, "fails", "mixed", "the sentence concerns both schemes, so each now has its own literal reading; the "
        "row had tested only L1-AC"),
    ),
    "figures-2-5": (
        _change(REFEREE, "holds", "holds", "three checks of statements that the paper does not make were removed, and "
        "statements that another row decides are no longer counted here"),
        _change(REFEREE, "holds", "holds", "the row now quotes the captions that are tested; it had quoted a sentence that only "
        "names the figures"),
    ),
    "siso-any-relative-degree": (
        _change(REFEREE, "holds", "holds", "the literal readings are measured with law (15), pure least squares; "
        "without --full the program had used the gradient law"),
    ),
    "lemma-1-small": (
        _change(REFEREE, "holds if", "fails", "the condition, single runs of Section V, replaced one constant for all signals "
        "by a constant for each run, which always exists; it is supplementary now"),
    ),
    "l1-against-pi": (
        _change(REFEREE, "holds if", "fails", "the condition, a filter of two slopes, replaced the paper's filter (6), which "
        "the statement names; it is supplementary now"),
    ),
    "smaller-gain": (
        _change(REFEREE, "holds", "holds", "the headline now says that there is no modelling error and which delay that MRAC "
        "tolerates"),
    ),
    "l1-margins": (
        _change(REFEREE, "mixed", "mixed", "the row is now our own statement about Section V's plant; it had quoted an abstract "
        "about a different class of plants, which reproduce cao_2006 measures"),
    ),
    "c-of-20": (
        _change(AUDIT, None, "holds if", "its literal reading was written together with its measurement"),
        _change(REFEREE, "holds if", "holds", "the paper's sentence is about a publication that is not available; the row now "
        "measures our own statement that one C exists"),
    ),
    "tau-range": (
        _change(AUDIT, None, "holds", "its literal reading was written together with its measurement"),
        _change(REFEREE, "holds", "holds", "no measurement can refute the theorem, which does not give Delta*; the row now "
        "measures our own statement about one delay"),
    ),
    "l1-mrac-in-flight": (
        _change(AUDIT, None, "mixed", "the row replaced one that had used our vehicles in place of those of Ref. 24; it "
            "was written when the numbers were already known"),
    ),
}  # fmt: skip
"""The changes of each row, by name, oldest first."""
