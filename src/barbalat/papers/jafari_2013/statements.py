"""Sentences by the opposing side and statements by this project, with their literal readings.

docs/claims.md contains the rules of the readings, and ``changes.py`` lists the changes after a measurement. Every quotation is
from a text that was read. If a text was not available, there is no quotation, and the statement is this project's.
"""

from __future__ import annotations

from barbalat.papers.finding import Sentence, Source
from barbalat.papers.jafari_2013.changes import CHANGED

MENDED = "(14) with its sign corrected"
"""Every row with the robust MRAC uses the sign of W_c0 that the swapping lemma gives; see erratum-14."""
OURS = Source("barbalat", "this project", "ours")
CAO_HOVAKIMYAN_2006 = Source("cao_hovakimyan_2006", "Cao, Hovakimyan (arXiv:math/0608320)", "L1's authors")


def _ours(row: str, where: str, statement: str, *literal: str, equation: str = "") -> Sentence:
    return Sentence(
        row=row,
        source=OURS,
        where=where,
        statement=statement,
        literal=literal,
        equation=equation,
        changed=CHANGED.get(row, ()),
    )


OTHERS = (
    Sentence(
        row="l1-reference-system",
        source=CAO_HOVAKIMYAN_2006,
        where="Abstract",
        quote="ensures that the input and the output of an uncertain linear system track the input and output of a desired "
        "linear system during the transient phase",
        statement="The state and the control of L1-AC track those of its filtered reference system to within a constant over "
        "sqrt(Gamma)",
        literal=(
            "at steps that resolve the ringing |x - x_ref| stays below gamma_1/sqrt(Gamma)",
            "and |u - u_ref| stays below gamma_2/sqrt(Gamma)",
        ),
        equation="(5) to (8)",
    ),
)
STATEMENTS = (
    _ours(
        "l1-margins",
        "on what the authors of L1 say about a linear plant under a constant disturbance (phase-independent and delay-bounded of "
        "reproduce cao_2006)",
        "On Section V's plant too, the phase margin of L1-AC does not depend on the gain, and its delay margin stays away from "
        "zero as the gain grows",
        "the exact phase margin of L1-AC around a constant command changes by less than a tenth over Gamma r^2 from 1e-6 to 1e8",
        "its delay margin tends to a limit above zero: over the last decade of the gain it changes by less than a tenth",
        equation="(5) to (8)",
    ),
    _ours(
        "c-of-20",
        "after Section IV, which raises the question of how to find a C of (20) for an unknown plant",
        "A single C satisfies (20) for every plant in a set with large parametric uncertainty, that of Section V",
        "with x_1 of Section V's plant as the output y, L = 0.5 and m = 1, at least one of the C tried satisfies (20) for every "
        "plant on a grid of theta over the known set. Three forms of C are tried, each with one bandwidth, from 1 to 1e4 rad/s",
        equation="(20)",
    ),
    _ours(
        "tau-range",
        "on Theorem 2, which admits every tau between tau_min and 1/delta_0",
        "The robust MRAC tolerates a delay of 2 ms at every tau from 0.01 s to 1/delta_0",
        "with (16) and alpha_0 > 0, the loop tolerates the same input delay of 2 ms over 400 s at each of eight values of tau "
        "from 0.01 s to 0.95/delta_0",
        equation=f"(11); {MENDED}, (15), (16)",
    ),
    _ours(
        "rohrs",
        "on the example of Rohrs, Valavani, Athans and Stein (1982, 1985), whose text is not available",
        "On Rohrs' example the classical law diverges, and the laws modified for robustness do not",
        "on Rohrs' plant and command the classical law diverges",
        "each modified law of the bundled case stays bounded over its run",
    ),
    _ours(
        "boundary",
        "from the stability region of RK4",
        "The oscillations begin when h omega_a exceeds the solver's stability limit on the imaginary axis",
        "for both schemes at three steps, the smallest gain with oscillation is 0.9 to 1.5 times the predicted one, and it "
        "varies as h^-2 to within 0.1 in the exponent",
        equation="(4), (7), (8)",
    ),
    _ours(
        "sampled-midpoint",
        "against the discussion of Figures 3 to 5 in Section V",
        "No gain numerically destabilises a sampled law whose discrete step is dissipative in the prediction error and in the "
        "estimate",
        "with this step the variation of the estimates of MRAC and of L1-AC changes by less than a factor of two over Gamma = "
        "1e2 to 1e8",
        equation="(4), (7), (8)",
    ),
    _ours(
        "sampled-delay",
        "related to the usual argument for the filter",
        "Without the filter, a fast-adapting sampled controller tolerates only a shorter delay",
        "at Gamma = 1e6 MRAC's estimates stay quiet only up to a shorter delay than those of L1-AC",
        equation="(3) to (8)",
    ),
    _ours(
        "missed-samples",
        "in addition to Section V, in which no measurement is lost",
        "Sampled schemes tolerate the loss of a tenth of their measurements if each miss freezes the estimates and holds the "
        "last control",
        "when a tenth of the samples are lost, one at a time, no component of e exceeds twice the largest value it has without "
        "losses, for any scheme or draw",
        "the same holds when a tenth of the samples are lost in bursts of ten",
        equation=f"(3) to (8); {MENDED}, (15)",
    ),
    _ours(
        "adaptive-against-linear",
        "on Section IV, which notes that the L1-AC papers lack a comparison with linear robust designs",
        "On Section V's family of plants, adaptive schemes track better than linear robust designs",
        "without a delay some adaptive scheme has a smaller tail error than the best linear design at every size of the "
        "uncertainty that a linear design tolerates",
        "the same holds with an input delay of 10 ms",
        equation=f"(3) to (8); {MENDED}, (15)",
    ),
    _ours(
        "l1-against-pi",
        "on Section IV, which notes that the L1-AC papers lack a comparison with linear robust designs",
        "L1-AC tracks better than a PI controller with as large a delay margin",
        "with the paper's filter (6) its tail error is smaller at every size of the uncertainty that both tolerate",
        equation="(5) to (8)",
    ),
    _ours(
        "l1-piecewise-is-lti",
        "after Section IV, which states this for the output-feedback controller; Ortega and Panteley claimed it for state "
        "feedback",
        "The L1 controller with the piecewise-constant law, which is used in flight today, is an LTI controller with integral "
        "action",
        "at every sample its control equals that of a linear realisation to within 1e-9 of the largest |u|",
        "it has integral action: with a constant disturbance the remaining error is below 1e-9 for every predictor tried",
    ),
    _ours(
        "adaptive-in-flight",
        "after Section IV, which asks that flown controllers be compared with linear designs",
        "When failures occur in flight, adaptive schemes do better than linear designs with the same margins",
        "without reversed surfaces, the adaptive scheme that loses the fewest flights loses fewer than the linear design that "
        "loses the fewest; for some failure this difference is beyond chance, and for no failure is the opposite difference",
        "some adaptive scheme has less error than every linear one, beyond chance, for more failures than the reverse",
        equation=f"(3) to (8); {MENDED}, (15), (16)",
    ),
    _ours(
        "l1-mrac-in-flight",
        "on Section IV, which cites simulation studies of L1-AC and MRAC on a flight platform that are not available",
        "In flight, L1-AC tracks better than MRAC if both are tuned by one rule",
        "on the quadrotor, L1-AC has less error than MRAC, beyond chance, for more failures than the reverse",
        "the same holds on the F-16, with pitch and roll counted together",
        equation="(3) to (8)",
    ),
)
