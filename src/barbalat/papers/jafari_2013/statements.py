"""What is not the paper's: sentences of the other side, and statements of our own; their literal readings.

Written down before the rows were measured under the rules of docs/claims.md. What is quoted stands in a text that was read; where no text
is at hand nothing is quoted, and the statement is ours.
"""

from __future__ import annotations

from barbalat.papers.cao_2006.sentences import SOURCE as CAO_2006
from barbalat.papers.finding import Sentence, Source

OURS = Source("barbalat", "this project", "ours")
CAO_HOVAKIMYAN_2006 = Source("cao_hovakimyan_2006", "Cao, Hovakimyan (arXiv:math/0608320)", "L1's authors")
ROHRS_1985 = Source("rohrs_1985", "Rohrs, Valavani, Athans, Stein (1982, 1985)", "others")


def _ours(row: str, where: str, statement: str, *literal: str) -> Sentence:
    return Sentence(row=row, source=OURS, where=where, statement=statement, literal=literal)


OTHERS = (
    Sentence(
        row="l1-margins",
        source=CAO_2006,
        where="Abstract",
        quote="the phase margin of the L1 adaptive controller is independent of the adaptation rate, its timedelay margin is guaranteed to be bounded "
        "away from zero as one increases the speed of adaptation",
        statement="L1-AC's phase margin does not depend on the gain, and its delay margin stays away from zero as the gain grows; here on Section V's plant",
        literal=(
            "the exact phase margin of L1-AC around a constant command changes by less than a tenth over Gamma r^2 from 1e-6 to 1e8",
            "its delay margin tends to a limit above zero: over the last decade of the gain it changes by less than a tenth",
        ),
    ),
    Sentence(
        row="l1-reference-system",
        source=CAO_HOVAKIMYAN_2006,
        where="Abstract",
        quote="ensures that the input and the output of an uncertain linear system track the input and output of a desired linear system during the transient phase",
        statement="L1-AC follows its filtered reference system, state and control, to within a constant over sqrt(Gamma)",
        literal=(
            "at steps that resolve the ringing |x - x_ref| stays below gamma_1/sqrt(Gamma)",
            "and |u - u_ref| stays below gamma_2/sqrt(Gamma)",
        ),
    ),
    Sentence(
        row="rohrs",
        source=ROHRS_1985,
        where="their example; the text is not at hand",
        statement="Unmodelled dynamics destabilise an adaptive law without modifications; the robust laws bear them",
        literal=(
            "on Rohrs' plant and command the classical law diverges",
            "each modified law of the bundled case stays bounded over its run",
        ),
    ),
)
STATEMENTS = (
    _ours(
        "boundary",
        "from the stability region of RK4",
        "The oscillations begin where h omega_a passes the solver's limit on the imaginary axis",
        "the least gain that oscillates is 0.9 to 1.5 times the predicted one for both schemes at three steps, and goes as h^-2 to within 0.1 in the exponent",
    ),
    _ours(
        "sampled-midpoint",
        "against the discussion of Figures 3 to 5 in Section V",
        "A sampled law whose step dissipates in the prediction error and in the estimate is destabilised numerically by no gain",
        "by this step the variation of the estimates, of MRAC and of L1-AC, changes by less than a factor of two over Gamma = 1e2 to 1e8",
    ),
    _ours(
        "sampled-delay",
        "near to what is generally argued for the filter",
        "Fast adaptation without a filter leaves no robustness to delays: sampled controllers",
        "at Gamma = 1e6 the MRAC's estimates stay quiet up to a shorter delay than those of L1-AC",
    ),
    _ours(
        "adaptive-against-linear",
        "after Section IV, which misses a comparison with linear robust designs",
        "On Section V's family adaptive schemes track better than linear robust designs",
        "without a delay some adaptive scheme has a smaller tail error than the best linear design at every size of the uncertainty that one bears",
        "with an input delay of 10 ms some adaptive scheme has so too",
    ),
    _ours(
        "l1-against-pi",
        "after Section IV, which misses a comparison with linear robust designs",
        "L1-AC tracks better than a PI controller with as large a delay margin",
        "with the paper's filter (6) its tail error is smaller at every size of the uncertainty that both bear",
    ),
    _ours(
        "l1-piecewise-is-lti",
        "after Section IV, which says it of the output-feedback controller; of state feedback Ortega and Panteley claimed it",
        "The L1 controller with the piecewise-constant law, the one that flies today, is an LTI controller with integral action",
        "from sample to sample its control is that of a linear realisation, to 1e-9 of the largest |u|",
        "it has integral action: a constant disturbance leaves an error below 1e-9, with every predictor that was tried",
    ),
    _ours(
        "adaptive-in-flight",
        "after Section IV, which asks that flown controllers be compared with linear designs",
        "Through failures in flight adaptive schemes do better than linear designs with the same margins",
        "reversed surfaces apart, the adaptive scheme with the fewest losses loses fewer flights than the linear one with the fewest, beyond chance through some failure and the reverse through none",
        "an adaptive scheme follows with less error than every linear one, beyond chance, through more failures than the reverse",
    ),
)
