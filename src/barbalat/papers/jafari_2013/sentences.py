"""The paper, sentence by sentence: the literal reading of each that has a row, and why another has none.

Written down before the rows were measured under the rules of docs/claims.md. The order is the paper's. A formula stands in plain
letters; what the OCR of the paper's text garbled is mended against the sense.
"""

from __future__ import annotations

from barbalat.papers.finding import Sentence, Source, Unmeasured
from barbalat.papers.jafari_2013.statements import OTHERS, STATEMENTS

CRITIQUE = Source("jafari_2013", "Jafari, Ioannou, Rudd (2013)", "the critique")

HISTORY = "not testable here: on the history of the field"
MOTIVES = "not testable here: on what people thought and why"
JUDGEMENT = "not testable here: a judgement, no statement of a fact"
ABROAD = "not testable here: on publications that are not at hand"
DEFINITION = "a definition"
OUTLINE = "an outline of the paper"


def _row(row: str, where: str, quote: str, statement: str, *literal: str) -> Sentence:
    return Sentence(row=row, source=CRITIQUE, where=where, quote=quote, statement=statement, literal=literal)


def _same(where: str, quote: str, row: str, why: str = "says the same", part: int | None = None) -> Unmeasured:
    return Unmeasured(where=where, quote=quote, row=row, part=part, why=why)


def _none(where: str, quote: str, why: str) -> Unmeasured:
    return Unmeasured(where=where, quote=quote, why=why)


ABSTRACT = (
    _none(
        "Abstract", "Recently, a class of adaptive control schemes called L1 Adaptive Control (L1-AC) has been proposed", HISTORY
    ),
    _none("Abstract", "The L1-AC scheme is designed mainly for plants with full state measurement", HISTORY),
    _row(
        "filtered-mrac",
        "Abstract; Section III.A, after (8)",
        "the L1-AC for plants with measured states is simply a standard MRAC with a low pass filter inserted in front of the control input",
        "L1-AC is the standard MRAC with a filter before the plant's input",
        "a filter before the input of (3)-(4) as they stand, with the law driven by e = x - x_m, has the tail errors of (5)-(8), to within 1 %",
    ),
    _row(
        "same-lyapunov",
        "Abstract; Theorem 1, proof",
        "the same Lyapunov function is used to establish stability",
        "The Lyapunov function of the MRAC, with the prediction error in the place of the tracking error, shows L1-AC to be stable",
        "V = x_tilde'P x_tilde + theta_tilde'theta_tilde/Gamma never rises along L1-AC's run with the filter of Section V",
        "where that V never rises the plant's state is bounded, as it is with the MRAC: with a filter beyond the limit too",
    ),
    _same(
        "Abstract",
        "the tracking error can be made arbitrarily small during transient by increasing the adaptive gain",
        "bound-9",
        "by (9), which the row tests over three decades of gain",
    ),
    _row(
        "stiffness",
        "Abstract; Section III.A, last but two paragraphs",
        "A high adaptive gain however makes the differential equation of the adaptive law or estimator very stiff",
        "A high adaptive gain makes the loop stiff",
        "a decaying mode of the loop, linearised where |x| is largest, decays the faster the higher the gain is (Lambert's definition: decay rates that lie far apart)",
    ),
    _same(
        "Abstract",
        "leads to numerical problems that cause high oscillations in the estimated parameters",
        "numerical-oscillation",
        part=0,
    ),
    _none("Abstract", "The L1-AC approach mistook these numerical oscillations as properties of the adaptive scheme", MOTIVES),
    _row(
        "filter-control-frequency",
        "Abstract",
        "the filter helps reduce the frequency of these oscillations in the control law",
        "The filter reduces the frequency of the numerical oscillations in the control",
        "at Figure 3's gain and step the mean frequency of u, weighted by the power, and its strongest frequency both fall by more than a tenth",
    ),
    _same(
        "Abstract",
        "First the numerical instability does not go away and the estimated parameters continue to oscillate",
        "oscillation-without-filter",
    ),
    _same(
        "Abstract",
        "without converging to the true parameters even in the presence of sufficiently rich signals",
        "loss-of-learning",
        part=0,
    ),
    _same(
        "Abstract",
        "Second, due to the filter the tracking error is no longer guaranteed to converge to zero",
        "bias-kappa",
        part=0,
    ),
    _same(
        "Abstract", "the transient bounds for the tracking error also depend on the filter", "bound-10", "kappa stands in (10)"
    ),
    _row(
        "smaller-gain",
        "Abstract; Section VI",
        "the tracking properties of the L1-AC scheme are worse than what a simple MRAC scheme can generate with adaptive gains that could be high but away from the region of numerical instability",
        "A plain MRAC whose gain the step resolves tracks better than L1-AC of Figure 3",
        "the estimates of an MRAC with Gamma = 10 vary by less than 1 per s at Figure 3's step",
        "its largest error and its largest error in the tail are smaller than those of L1-AC of Figure 3, in both components",
    ),
    _row(
        "filter-reduces-margins",
        "Abstract; Section III.A; Section VI",
        "The input filter introduces a bias in performance and reduces the robust stability margins no matter what size adaptive gains are used",
        "The filter lowers every robustness margin at every gain",
        "each exact margin of the loop that adapts (gain upwards and downwards, phase, delay, 1/||T||) is smaller with a filter of kappa <= 0.1 s than without, at every gain",
    ),
    _row(
        "no-advantage",
        "Abstract",
        "provides literally no advantage",
        "The filter brings no advantage over the same MRAC without it",
        "in no respect that is measured here does L1-AC of Section V do better than the MRAC of the same gain",
    ),
    _row(
        "robust-mrac-better",
        "Abstract; Sections III.B, VI",
        "simple robust MRAC techniques can solve the same problem achieving much better properties",
        "The robust MRAC does better than L1-AC in every respect, both tuned by one rule",
        "every tuning of L1-AC that was tried is beaten by a tuning of the robust MRAC that is worse in no objective: largest error without a disturbance, with d = 20, with d = 20 sin 2t, in the tail, largest delay",
    ),
    _none("Abstract", "The authors of L1-AC often compare the properties of a numerically unstable MRAC", ABROAD),
    _none("Abstract", "Such comparisons are not only misleading but do not reveal what causes what", JUDGEMENT),
    _none("Abstract", "The use of filters in adaptive control is not new", HISTORY),
    _same(
        "Abstract",
        "we present such a scheme that guarantees good transient performance and robustness",
        "tau-error",
        "and tau-limit-delay, for the trade-off that it reveals",
    ),
)
SECTIONS_I_AND_II = (
    _none(
        "Section I",
        "Adaptive control as a powerful control design tool for handling large parametric uncertainties has been attracting the interest of researchers.",
        HISTORY,
    ),
    _none(
        "Section I",
        "During past decades, several attempts were made to design adaptive control schemes for aerospace applications",
        HISTORY,
    ),
    _none(
        "Section I",
        'claims of arbitrary tracking error performance and "separation of performance improvement from robustness"',
        "not testable here: reported of others; of their own words see l1-margins",
    ),
    _none(
        "Section I",
        "In this paper, we investigate the results and claims regarding the performance and robustness of the L1-AC",
        OUTLINE,
    ),
    _same("Section I", "another MRAC control design that is developed with attention to performance", "siso-any-relative-degree"),
    _row(
        "non-adaptive-cannot",
        "Section I, last sentence; Section IV",
        "a large uncertainty such that the control objective cannot be achieved with robust non-adaptive techniques",
        "No fixed linear controller meets the objective over Section V's known set",
        "every linear design that was tried has, at the centre or at a corner of the known set, a tail error above a fifth of the model's amplitude",
    ),
    _none("Section II, (1)", "We consider the following class of plants considered by the L1-AC authors", DEFINITION),
    _none(
        "Section II",
        "if the eigenvalues of A_m are not in desired locations, they can be arbitrarily assigned by a simple state feedback gain",
        "proved in three lines: (A_m, b) is controllable, so x' = (A_m - b k')x + b(u + ...) has any poles for some k (pole placement), and k'x joins u",
    ),
    _none(
        "Section II, (2)",
        "The objective is to choose u(t) such that all signals in the closed-loop system are uniformly bounded and x(t) tracks the state vector of a desired reference model",
        DEFINITION,
    ),
    _none("Section II", "This paper examines and compares properties of the L1-AC", OUTLINE),
)
SECTION_III_A = (
    _none(
        "Section III", "This section studies some adaptive control schemes as solutions to the problem formulated above", OUTLINE
    ),
    _none("Section III.A, (3), (4)", "The standard MRAC solution to the problem is given by", DEFINITION),
    _none("Section III.A, (5) to (8)", "The L1-AC solution to the same problem is given by", DEFINITION),
    _none(
        "Section III.A, (6)",
        "is the simplest choice for the input filter",
        "proved in three lines: a strictly proper C(s) with C(0) = 1 has at least one pole and no constant alone, and (6) has one pole and one parameter",
    ),
    _none(
        "Section III.A",
        "if filter C(s) is removed i.e., C(s) = 1 in (5), then x_hat(t) = x_m(t)",
        "proved in three lines: with u = -theta_hat'x + k_0 r, (8) is x_hat' = A_m x_hat + b k_0 r, which is (2), from the same initial state; a test holds it to rounding",
    ),
    _same("Section III.A", "the only difference between (3)-(4) and (5)-(8) is the insertion of C(s)", "filtered-mrac"),
    _row(
        "any-command",
        "Theorem 1 (i); Section III.B, last paragraph",
        "for any reference signal r(t) the tracking error e(t) = x(t) - x_m(t) converges to zero as t -> infinity",
        "Without modelling error the error of the standard MRAC and of the robust MRAC goes to zero for any command",
        "the standard MRAC: with every command drawn the integral of |e|^2 stays below V(0) = |theta_tilde(0)|^2/Gamma, from which e -> 0 follows (Barbalat)",
        "the robust MRAC: with every command drawn the largest error of the last quarter is below that of the second quarter",
    ),
    _row(
        "bound-9",
        "Theorem 1 (i), (9)",
        "||e(t)||_inf <= nu_0/sqrt(Gamma)",
        "The standard MRAC's error never exceeds nu_0/sqrt(Gamma)",
        "no run of those drawn has an |e_i| above nu_0/sqrt(Gamma): theta over the known set, Gamma from 0.1 to 100",
    ),
    _same(
        "Theorem 1 (ii)",
        "there exists a kappa_max > 0 so that for any kappa in [0, kappa_max) all signals are uniformly bounded",
        "bound-10",
        "by (10), which the row tests for kappa up to 0.95 kappa_max",
    ),
    _row(
        "bound-10",
        "Theorem 1 (ii), (10)",
        "||e(t)||_inf <= kappa nu_1 + nu_2/sqrt(Gamma)",
        "L1-AC's error never exceeds kappa nu_1 + nu_2/sqrt(Gamma)",
        "no run of those drawn has an |e_i| above it: theta over the known set, Gamma from 0.1 to 100, kappa up to 0.95 kappa_max",
    ),
    _row(
        "constant-command",
        "Theorem 1 (iii)",
        "both schemes guarantee convergence of the tracking error to zero provided the dc gain of the reference model is equal to one",
        "For a constant command both errors go to zero if the model's DC gain is one",
        "beside r = 50, with a DC gain of one, max |e| in the last quarter of 120 s is below 1e-4 for both schemes",
    ),
    _none(
        "Theorem 1, proof (i)",
        "The proof follows by choosing the Lyapunov function V = e'Pe + theta_tilde'Gamma^-1 theta_tilde",
        "proved in three lines: V' = -|e|^2 + 2 theta_tilde'(theta_hat'/Gamma - e'Pb x) = -|e|^2, <= with projection; so e, theta_hat, x, e' are bounded, the integral of |e|^2 is at most V(0), and e -> 0 (Barbalat)",
    ),
    _same(
        "Theorem 1, proof (ii)",
        "Using the same Lyapunov function with e is replaced by x_tilde and the small gain theorem the proof follows.",
        "same-lyapunov",
        part=0,
    ),
    _row(
        "part-iii",
        "Theorem 1, proof (iii)",
        "The proof of part (iii) is a direct consequence of previous parts.",
        "What parts (i) and (ii) state implies part (iii)",
        "the bound (10) of part (ii), for a constant command and Gamma -> infinity, is zero",
    ),
    _row(
        "best-kappa-zero",
        "Section III.A, after Theorem 1",
        "in (10) the best bound for the tracking error is obtained by setting kappa = 0, i.e., removing the filter C(s)",
        "The best bound (10) is that without a filter",
        "the bound is smaller without the filter than with any kappa that was tried",
    ),
    _same(
        "Section III.A, after Theorem 1",
        "not only made small by choosing a large adaptive gain but also it goes to zero with time",
        "any-command",
        part=0,
    ),
    _row(
        "bias-kappa",
        "Section III.A, after Theorem 1; Figure 3, caption",
        "The presence of the input filter destroys the property of zero tracking error at steady state and introduces a constant bias that is proportional to kappa",
        "The filter leaves an error in the steady state, which is a constant bias and proportional to kappa",
        "beside Section V's sine the error in the tail is more than a hundredth of the largest error",
        "the error that stays is a bias: it stays beside a constant command too, above a thousandth of that beside a sine of the same size",
        "twice the kappa leaves twice the error, to within a tenth, beside Section V's sine, from 0.00125 s up to 0.04 s",
    ),
    _row(
        "filter-limits-theta",
        "Section III.A, after Theorem 1",
        "the presence of the filter puts a limitation on the size of the unknown parameters",
        "The filter puts a limit on the size of the unknown parameters",
        "beyond a certain size of theta the filtered loop at high gain is unstable, and the MRAC bears every size that was tried",
    ),
    _none(
        "Section III.A",
        "Table 1 summarizes the properties of the standard MRAC scheme (3)-(4) and the L1-AC scheme (5)-(8)",
        "not testable here: the table's cells are not in the text at hand; it is rebuilt by analysis on the page of guarantees",
    ),
    _none("Section III.A", "The authors of L1-AC were motivated from the bound (9)", MOTIVES),
    _same(
        "Section III.A",
        "which often produces high frequency oscillations in the time response of the estimated parameters",
        "numerical-oscillation",
        "and boundary, which says from which gain on",
        part=0,
    ),
    _none("Section III.A", "without recognizing the true origin of the oscillations", MOTIVES),
    _same("Section III.A", "The filter causes certain signal bounds to become different from those of MRAC", "bound-10"),
    _none(
        "Section III.A",
        "they have to be inserted in the right place in order to avoid bias and negative impact on performance and robustness",
        "not testable here: a consequence drawn; its parts are bias-kappa and filter-reduces-margins",
    ),
    _row(
        "unmodelled-unbounded",
        "Section III.A, paragraph after Table 1",
        "both the MRAC and L1-AC above cannot be proven to have globally bounded solutions unless the adaptive gain has a reasonable size and further modifications in the adaptive law are imposed",
        "Beside unmodelled dynamics the projected MRAC and L1-AC are not bounded in general, and a small gain alone does not mend it",
        "with both schemes some run grows without end, at a theta in Section V's known set and beside a delay that the same loop bears with theta known",
        "it does so at every gain that was tried: a reasonable gain alone does not prevent it",
    ),
    _row(
        "gain-reduces-margins",
        "Section III.A, last paragraph; Section III.B, last paragraph",
        "The negative effect of high adaptive gains on robustness is well documented",
        "A higher adaptive gain costs robustness, measured by the paper's own modelling error (11) and its example, a delay",
        "of the MRAC: the delay margin and 1/||T||, the size of Delta_m that is borne, both fall with every rise of the gain",
        "of L1-AC: the delay margin and 1/||T|| both fall with every rise of the gain",
    ),
    _none(
        "Section III.A, last paragraph",
        "The negative effect of the input filter on robustness is shown in Ref. 19.",
        ABROAD + "; see filter-reduces-margins",
    ),
)
SECTION_III_B = (
    _none(
        "Section III.B",
        "the robustness analysis of the L1-AC with respect to unmodeled dynamics has been considered as an open problem by the authors of L1-AC",
        ABROAD,
    ),
    _none(
        "Section III.B",
        "What they often referred to as robustness analysis requires an adequate knowledge of the unmodeled dynamics",
        ABROAD,
    ),
    _none(
        "Section III.B",
        "the claim of guaranteed robustness in the presence of fast adaptation made by the authors of L1-AC as the key feature of the L1-AC scheme is misleading",
        JUDGEMENT + "; what fast adaptation does to the margins is l1-margins",
    ),
    _none("Section III.B, (11)", "We consider the plant with a multiplicative uncertainty term", DEFINITION),
    _row(
        "minus-mu-s",
        "Section III.B, after (11)",
        "a small constant may represent the approximation of a time delay mu in the input",
        "A small -mu s stands for an input delay of mu",
        "the loop of Section V with theta known, u = -theta'x + k_0 r, bears the same largest mu as its delay margin, to within a tenth",
    ),
    _none(
        "Section III.B, (12)",
        "Since (A_m, b) is controllable, there exists a vector c_0 in R^n so that W_m(s) = c_0'W_b(s) is a strictly proper minimum-phase transfer function.",
        "proved in three lines: in the controllable canonical form c_0's entries are the coefficients of W_m's numerator; choose any Hurwitz polynomial of degree below n; Section V's c_0 = [1, 1] gives s + 1",
    ),
    _none(
        "Section III.B, (13)",
        "z(t) = theta*'phi(t) + eta(t)",
        "proved in three lines: c_0' times (12); the identity is held to rounding by a test",
    ),
    _none(
        "Section III.B",
        "The filter is similar to the one used in L1-AC but appears in a different place and operates on different signals.",
        DEFINITION,
    ),
    _row(
        "erratum-14",
        "Section III.B, (14)",
        "W_c0(s) = -c_0'(sI - A_m)^-1",
        "The auxiliary input (14), with W_c0 as printed, makes the transient error proportional to tau",
        "with W_c0 as printed, half the tau halves the largest error of both components, to within a tenth, from tau = 0.1 s",
    ),
    _none("Section III.B, (15)", "a robust adaptive law such as pure least-squares algorithm with projection", DEFINITION),
    _none(
        "Section III.B, (16)",
        "is designed to guarantee that |phi(t)/m_s(t)| and |eta(t)/m_s(t)| are bounded",
        "proved in three lines: m_s^2 >= 1 + phi'phi gives |phi|/m_s < 1; with alpha_0 > 0 and Delta analytic right of -delta_0/2, |eta|^2 <= ||Delta||^2_(2 delta_0) n_d gives |eta|/m_s <= ||Delta||/sqrt(alpha_0); lemma-1-small lists it along runs",
    ),
    _none(
        "Section III.B, (16)",
        "in the absence of modeling error (eta(t) = 0), the design constant alpha_0 can be set to be zero",
        "proved in three lines: eta/m_s = 0, and |phi|/m_s < 1 needs no n_d",
    ),
    _row(
        "lemma-1-bounded",
        "Lemma 1 (i)",
        "epsilon(t), epsilon(t) m_s(t), theta_hat(t), and theta_hat'(t) in L_infinity",
        "epsilon, epsilon m_s, theta_hat and theta_hat' are bounded",
        "along Section V's runs with mu up to 0.1 s none of the four suprema grows by more than a twentieth in the second half of the run",
    ),
    _row(
        "lemma-1-small",
        "Lemma 1 (ii)",
        "epsilon(t), epsilon(t) m_s(t), and theta_hat'(t) in S(eta^2/m_s^2)",
        "With a modelling error they are small in the mean, with one constant nu for all signals",
        "with law (15) one nu serves any signals of (13), by the paper's definition of S with the largest eta^2/m_s^2 as its mu",
    ),
    _row(
        "lemma-1-no-error",
        "Lemma 1 (ii), with eta = 0",
        "epsilon(t), epsilon(t) m_s(t), and theta_hat'(t) in S(eta^2/m_s^2)",
        "Without modelling error V = theta_tilde'P^-1 theta_tilde falls, and epsilon, epsilon m_s and theta_hat' are in L2",
        "along Section V's run V never rises, the integral of (epsilon m_s)^2 is at most V(0), and the last quarter adds less than a hundredth to any of the three integrals",
    ),
    _row(
        "tau-error",
        "Theorem 2, (17); Section III.B, after it",
        "in the absence of unmodeled dynamics there is a quantifiable bound ||e(t)||_inf <= tau nu for the tracking error",
        "Without modelling error the largest error of the robust MRAC is at most proportional to tau",
        "one nu serves all tau from 0.5 s down to 0.005 s: max |e|/tau is nowhere more than a twentieth above its value at the smallest tau",
    ),
    _row(
        "delta-2-term",
        "Theorem 2, (17)",
        "||e(t)||_inf <= tau nu + Delta_2 nu",
        "The modelling error adds at most Delta_2 nu to the error, with the same nu for all tau and sizes",
        "one nu bounds max |e| by (tau + Delta_2) nu for every tau and size that was tried, and it does not grow as tau falls",
    ),
    _row(
        "tau-limit-delay",
        "Section III.B, after Theorem 2",
        "in the presence of modeling error, the value of tau cannot be made arbitrarily small as reducing tau has adverse effects on robust stability and it has to meet a lower bound",
        "Beside an input delay tau has a lower limit, which grows with the delay",
        "with (16), alpha_0 > 0, the smallest tau that is borne is above the smallest tried with each of three delays, and rises from each to the next",
    ),
    _row(
        "tau-limit-mu",
        "Theorem 2",
        "for a given size of modeling error, the value of tau cannot be made arbitrarily small",
        "Beside Delta_m = -mu s tau has a lower limit, which grows with mu",
        "with (16), alpha_0 > 0, the smallest tau that is borne is above the smallest tried with each of three mu, and rises from each to the next",
    ),
    _same(
        "Theorem 2",
        "in the absence of modeling error (i.e., Delta_m(s) = 0), the tracking error converges to zero as t -> infinity",
        "any-command",
        part=1,
    ),
    _none(
        "Theorem 2",
        "guarantees that for any tau in (tau_min, 1/delta_0)",
        "not testable here: tau < 1/delta_0 is an assumption that suffices; nothing is said of larger tau, and Delta* is not given",
    ),
    _same(
        "Section III.B, after Theorem 2",
        "This demonstrates the trade-off between improving performance and ensuring robust stability.",
        "tau-limit-delay",
        "and tau-limit-mu; what tau does to the error is tau-error",
    ),
    _row(
        "small-tau-numerics",
        "Section III.B, after Theorem 2",
        "A very small tau implies a high gain equal to 1/tau in the control law which may lead to numerical instability even in the absence of any disturbances or modeling errors",
        "A very small tau fails numerically even without modelling error",
        "some tau makes RK4 at h = 1e-4 s diverge within 10 s without modelling error",
    ),
    _same(
        "Section III.B, last paragraph",
        "the convergence of the tracking error to zero for any reference signal r(t) is guaranteed",
        "any-command",
        part=1,
    ),
    _row(
        "exponential-convergence",
        "Section III.B, last paragraph",
        "in the presence of sufficiently rich signals the exponential convergence of theta_hat(t) to theta* is ensured",
        "With sufficiently rich signals the estimates of the robust MRAC converge exponentially",
        "with the law that is printed, pure least squares (15), the last rate of decay is at least four fifths of the one before, with each interval twice as long as the last",
    ),
    _none(
        "Section III.B, last paragraph", "no practical engineer will suggest large adaptive gains or very small tau", JUDGEMENT
    ),
)
SECTION_IV = (
    _row(
        "siso-any-relative-degree",
        "Section I, last paragraph; Section IV, first sentence",
        "applicable to SISO plants with only the output signal available for measurement in the presence of bounded disturbances and unmodeled dynamics",
        "The robust MRAC extends to SISO plants of any relative degree, also beside disturbances and unmodelled dynamics",
        "at every relative degree that was tried the largest |y - y_m| falls with tau, with a local exponent above 0.5",
        "at every one of them all stays bounded beside a disturbance and an unmodelled lag: the error of the last quarter is at most 1.1 times that of the one before",
    ),
    _none(
        "Section IV",
        'The authors of L1-AC often use the name "adaptive" and "L1" to label schemes that are clearly non-adaptive',
        JUDGEMENT + "; l1-output-is-lti and l1-piecewise-is-lti measure what the schemes are",
    ),
    _row(
        "l1-output-is-lti",
        "Section IV, before (18) and after (21); Figure 1",
        "the scheme is nothing more than a fixed gain LTI controller with an integral action",
        "The L1 output-feedback controller (21) is an LTI controller with integral action and anti-windup",
        "while sigma is inside its bounds the control is that of the linear equivalent, to 1e-9 of the largest |u|",
        "a constant disturbance leaves an error below 1e-9",
        "after saturation the mean |e| is less than half of that without the bound on sigma: the projection is an anti-windup",
    ),
    _none("Section IV", "It is therefore very confusing to call such schemes adaptive.", JUDGEMENT),
    _same(
        "Section IV",
        "Adaptive schemes are nonlinear and are designed to handle large parametric uncertainties that non-adaptive schemes cannot handle.",
        "non-adaptive-cannot",
    ),
    _none(
        "Section IV, (18) to (20)",
        "It is assumed that a strictly proper filter C(s) with dc gain of one can be found",
        DEFINITION,
    ),
    _none(
        "Section IV, after (20)",
        "This assumption essentially implies that any uncertainty in the plant parameter values is accommodated by using a stabilizing controller C(s)",
        JUDGEMENT,
    ),
    _none(
        "Section IV, after (20)",
        "How to find such a controller for an unknown plant with large parametric uncertainties which is the crucial question in adaptive control is not addressed in general",
        ABROAD,
    ),
    _same(
        "Section IV, Figure 1",
        "the nonadaptive controller C(s) is augmented with an integral action that involves an anti-wind up modification in the form of projection",
        "l1-output-is-lti",
        part=2,
    ),
    _none(
        "Section IV",
        "The nonadaptive nature of the L1-AC scheme in this case has been pointed out by other authors independently.",
        HISTORY + "; Ortega and Panteley, and van Heusden, Talebian and Dumont, are named in docs/both-sides.md",
    ),
    _none(
        "Section IV",
        "an integral controller can be derived using a similar analysis as in parameter estimation, is well known",
        HISTORY,
    ),
    _none(
        "Section IV",
        "what is absent in the L1-AC papers is a comparison of their (linear) controllers with others based on these robust control methods",
        ABROAD + "; adaptive-against-linear and l1-against-pi are such comparisons, ours",
    ),
    _none(
        "Section IV",
        "Both of these cases have employed the linear controller described above",
        ABROAD + "; l1-piecewise-is-lti is on the law of today's flight codes",
    ),
    _row(
        "ref-24-in-flight",
        "Section IV, last paragraph",
        "These studies did not indicate any improvements of L1-AC over MRAC.",
        "What is said of Ref. 24, on our quadrotor: no improvement of L1-AC over the MRAC, both tuned by one rule",
        "through no failure of the quadrotor does L1-AC, state feedback with the filter, follow with less error than the MRAC beyond chance",
    ),
    _none(
        "Section IV, last paragraph",
        "On the contrary, the performance of L1-AC in comparison to MRAC was mediocre.",
        ABROAD + "; see ref-24-in-flight",
    ),
)
SECTIONS_V_AND_VI = (
    _none("Section V", "the sampling rate is 10 KHz (fixed sampling period of 10^-4 sec)", DEFINITION),
    _row(
        "kappa-0.05",
        "Section V, settings of L1-AC",
        "for kappa < 0.05 the stability condition ||W_b(s)(C(s) - 1)||_1 theta_max < 1 is satisfied",
        "For kappa < 0.05 the condition ||W_b (C - 1)||_1 theta_max < 1 is satisfied",
        "the condition holds for every kappa below 0.05 s",
    ),
    _none("Section V", "a very large adaptive gain Gamma = 10^4 (as suggested by the L1-AC authors)", ABROAD),
    _row(
        "figures-2-5",
        "Section V, text and captions of Figures 2 to 5",
        "Figure 2, 3 show the simulation results.",
        "Figures 2 to 5 look as their captions and the text describe them",
        "every statement of the captions and of the text on Figures 2 to 5 holds, at the gains and steps that they name",
    ),
    _same(
        "Figure 2, caption",
        "The tracking error e(t) = [e_1(t), e_2(t)]' for any reference signal converges to zero with improved transient performance",
        "figures-2-5",
        "for Section V's command; any command is any-command",
    ),
    _same(
        "Figure 2, caption",
        "Since the signals are persistently exciting, the estimated parameter theta_hat(t) = [theta_hat_1(t), theta_hat_2(t)]' converges to the true value theta* = [4, -3]'",
        "figures-2-5",
        "one of its statements",
    ),
    _same(
        "Figure 4, caption",
        "Non-zero steady state tracking error remains but the high frequency oscillations are gone due to smaller step size.",
        "figures-2-5",
        "two of its statements",
    ),
    _same(
        "Figure 5, caption",
        "Choosing a larger adaptive gain Gamma = 10^6 leads again to numerical instability, loss of learning and permanent high frequency oscillations",
        "figures-2-5",
        "one of its statements",
    ),
    _row(
        "numerical-oscillation",
        "Section V, discussion of Figures 3 to 5",
        "It is clearly a numerical instability problem as if we keep all parameters the same and reduce the sampling period to 10^-5 sec, the oscillations go away",
        "The oscillations of Figure 3 are gone at a tenth of the step, and back at a hundred times the gain",
        "at h = 1e-5 s both estimates vary in the tail by less than a thousandth of what they do at 1e-4 s",
        "at Gamma = 1e6 both vary by more than a thousand times that again",
    ),
    _same(
        "Section V",
        "the parameter estimates oscillate with high frequency oscillations due to the use of a high adaptive gain that turned the adaptive law into a stiff differential equation",
        "numerical-oscillation",
        "and stiffness",
        part=0,
    ),
    _same(
        "Section V",
        "If we then keep increasing the adaptive gain it will again lead to a numerical instability",
        "numerical-oscillation",
        part=1,
    ),
    _same("Section V", "The fact that there is still boundedness is due to the use of projection.", "no-projection"),
    _row(
        "no-projection",
        "Section V; Figures 3 and 5, captions",
        "In the absence of projection all signals in the closed-loop system go unbounded due to numerical instability.",
        "Boundedness is the projection's doing: without it the signals go unbounded, for numerical reasons",
        "L1-AC without projection diverges within 60 s at the gains and steps of Figures 3 and 5",
        "at a tenth of the step, that of Figure 4, the same equations stay bounded",
    ),
    _row(
        "stiff-solvers",
        "Section V, discussion of Figures 3 to 5",
        "Even with a more computationally expensive solver designed for stiff problems, we cannot avoid such phenomena and possible singularity in the solution in general.",
        "No solver for stiff problems avoids the phenomena of Figures 3 and 5, nor a possible singularity",
        "no solver for stiff problems that was tried follows the equations with the projection at Figure 3's gain: the ringing is within a factor of 1.25 of the converged one for none",
        "a singularity of the solution is possible: it may end at a finite time",
    ),
    _none(
        "Section V",
        "These results are very consistent with what has been known for decades in robust adaptive control and numerical analysis.",
        HISTORY,
    ),
    _none("Section V", "led to wrong conclusions and claims", JUDGEMENT),
    _row(
        "oscillation-without-filter",
        "Section V, discussion of Figures 3 to 5; Abstract",
        "The numerical instability and resulting oscillations cannot be avoided by such an ad hoc filter",
        "The filter does not remove the oscillations of the estimates",
        "at Figure 3's gain and step both estimates vary by more than 1000 per s with the filter, as they do without it",
    ),
    _same("Section V", "but by reducing the adaptive gain to reasonable values", "smaller-gain", part=0),
    _row(
        "loss-of-learning",
        "Figure 3, caption",
        "The use of a large adaptive gain Gamma = 10^4 leads to numerical instability and the loss of learning even in the presence of persistently exciting signals",
        "Numerical instability makes L1-AC lose learning although the signals are exciting",
        "at Figure 3's step the estimates of L1-AC come to lie more than 5 away from theta in the last 15 s, those of Figure 2 within 0.01",
        "it is the numerical instability that keeps them from it: at a step that resolves the gain they come within 0.5 of theta in the 60 s",
    ),
    _row(
        "own-oscillation",
        "Section VI; Figure 4, caption",
        "These oscillations are due to numerical instability as a result of using large adaptive gains",
        "The oscillations are the solver's alone: the equations have none of their own",
        "with the projection, as in Figure 4, the converged solution rings by less than 0.01 in the last quarter",
        "without the projection it does not ring either: what is left at a converged step is no more than at h = 1e-5 s",
    ),
    _none(
        "Section VI",
        "L1-AC is not based on a new theory but it is an ad hoc modification of a standard MRAC",
        JUDGEMENT + "; filtered-mrac says what it is",
    ),
    _same(
        "Section VI",
        "Reducing the adaptive gain eliminates these oscillations and there is no need for a filter.",
        "smaller-gain",
        part=0,
    ),
    _same(
        "Section VI",
        "without causing any numerical problems during implementation",
        "small-tau-numerics",
        "and robust-mrac-better",
    ),
)
COVERAGE = (*ABSTRACT, *SECTIONS_I_AND_II, *SECTION_III_A, *SECTION_III_B, *SECTION_IV, *SECTIONS_V_AND_VI)
"""What the paper states, in its order; a definition of symbols or a pointer to what follows stands in it where it helps."""
SENTENCES = {one.row: one for one in (*COVERAGE, *OTHERS, *STATEMENTS) if isinstance(one, Sentence)}
"""All that has a row, by the row's name."""
