"""The missing theorems because of which there is no bound on e: the sentences in certificates and
docs/reference/missing-theorems.md."""

from __future__ import annotations

from collections.abc import Iterable

DELAY = "a Lyapunov-Krasovskii functional of the adaptive loop with a delay at its input"
LIMITS = "a Lyapunov function of the modified error with a limited input, and an invariant set of the loop"
QUANTIZATION = "Theorem 1 with the converter's error as a bounded matched disturbance"
ACTUATOR = "Theorem 1 with the actuator's states in the Lyapunov function, and a bound on the lag that it tolerates"
UNMODELLED = "Theorem 2 with computed constants: the largest Delta_m, and a bound on e instead of on its mean square"
INPUT_GAIN = "Theorem 1 with the input's gain among the parameters of V, and a law that adapts it"
UNMATCHED_RESTS = "Theorem 1 with unmatched uncertainty, by a small-gain argument from x to e"
DISTURBANCE = "this scheme's theorem with a V that accounts for a bounded disturbance"
DISTURBED_SET = "Theorem 1 with disturbances for every theta of the known set, and not only for the case's theta"
UNPROJECTED = "Theorem 1 with disturbances for estimates without projection, or for a memory that learns from disturbances"
OUTPUT_DISTURBANCE = "Theorem 1 with a disturbance at the output, which enters the adaptive law too"
MEASUREMENT = "Theorem 1 with a bounded measurement error, which enters the adaptive law"
GAUSSIAN = "no theorem: Gaussian noise has no bound"
BOUNDED_COMMAND = "no theorem: a bound on e needs a bound on r"
SAMPLED = "a sampled-data version of Theorem 1, in which V also accounts for the plant's motion between samples"
THETA_OUTSIDE = "Theorem 1 for a theta outside the set of the projection, where projection may make V grow"
REGRESSOR = "existence of the solution: an invariant set of x in which phi(x) is finite"
CORNERS = "V' <= 0 for a projection that cuts the corners of a set, with a gain matrix that couples the parameters"
DEAD_ZONE = "the largest e before e enters the set allowed by a dead zone"
LEAKAGE = "the ultimate bound on V under leakage, with the largest e on the way to it"
FILTER_NOT_SMALL = "a condition on C(s) that is weaker than the small-gain condition, such as one over cells of the known set"
FILTER_WITHOUT_SET = "a bound on the estimates without projection, from which the condition on C(s) would follow"
FILTER_BEYOND = "the bound (10) for several inputs, phi(x) instead of x, or an unknown gain: a small-gain condition on a set of x"
LEMMA_1 = "Lemma 1 with constants that can be computed, and for e itself: as it stands, it bounds only a mean square of e"
LEMMA_1_OUTPUT = "Lemma 1 for output feedback with constants computed from the case, or a Lyapunov function of the whole loop"
MIT_RULE = "a Lyapunov function of the MIT rule; averaging shows stability for sufficiently small gains, but gives no number"
NETWORK = "a bound on the network's approximation error of theta'phi(x) on an invariant set of x"
LINEAR_SMALL_GAIN = "a robust bound for the linear loop under a weaker condition than small gain over the known set"
SAMPLED_BASELINE = "the impulse sums of the sampled loop, including the states of the baseline"
OBSERVER = "Theorem 1 with an observer's error in the adaptive law, and a bound on that error while theta is unknown"
LINEAR_UNSTABLE = "no theorem: the linear loop is unstable"
LINEAR_DELAY = "the L1 norms of a continuous linear loop with a delay at its input"
LINEAR_ADDITIONS = "a small-gain condition over the known set for the linear loop with its actuator, sensor and disturbances"
LINEAR_LIMITS = "an invariant set of the linear loop in which its input stays within its limits"
LINEAR_FAMILY = (
    "a small-gain condition for the linear loop over unmodelled dynamics, unmatched parameters or an interval of input gains"
)
LINEAR_SAMPLED = "the impulse sums of the sampled linear loop for every theta of the known set"
LINEAR_THETA = "no theorem: a small-gain condition over the known set covers no theta outside it"
LINEAR_BEYOND = "a small-gain condition for the linear controller's loop with several inputs or with phi(x) instead of x"
SLOPE = "a bound with f(t, y) that is less conservative than the small-gain bound with the slope of f"
OUTPUT_LOOP = "a bound for the linear loop with limits, a delay, noise or unbounded signals"
OTHER_PARAMETERS = "a small-gain condition for a loop with parameters other than the plant's and phi(x) instead of x"
UNKNOWN_LAW = "a Lyapunov function of this law; the package has none"
REFUSED_V = "another V of this law, for which V' <= -W can be shown"


def of_linear_loop(theorem: str) -> str:
    """The theorems that a linear loop lacks where an adaptive loop lacks these; others are kept."""
    linear = {
        DELAY: LINEAR_DELAY,
        LIMITS: LINEAR_LIMITS,
        QUANTIZATION: LINEAR_ADDITIONS,
        ACTUATOR: LINEAR_ADDITIONS,
        DISTURBANCE: LINEAR_ADDITIONS,
        OUTPUT_DISTURBANCE: LINEAR_ADDITIONS,
        MEASUREMENT: LINEAR_ADDITIONS,
        UNMODELLED: LINEAR_FAMILY,
        INPUT_GAIN: LINEAR_FAMILY,
        UNMATCHED_RESTS: LINEAR_FAMILY,
        SAMPLED: LINEAR_SAMPLED,
        THETA_OUTSIDE: LINEAR_THETA,
    }
    return joined(linear.get(one, one) for one in theorem.split(SEPARATOR))


SEPARATOR = "; "


def joined(theorems: Iterable[str]) -> str:
    """The distinct theorems, in order, as one sentence."""
    return SEPARATOR.join(dict.fromkeys(one for each in theorems if each for one in each.split(SEPARATOR)))
