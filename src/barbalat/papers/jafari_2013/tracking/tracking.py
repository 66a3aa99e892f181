"""Claims on tracking: Theorem 1's bounds, and what the two schemes share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.controllers import L1Adaptive, Mrac
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import Claim, Measurement, numbers, short, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import by_component, figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Constant
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

MEMBERS = 192
"""Random runs: a multiple of the kernel's lanes."""
MORE_MEMBERS = 32 * MEMBERS
"""Of ``reproduce --full``: a search for a run that breaks a bound."""
FULL_COMMAND = f"{MORE_MEMBERS} random runs instead of {MEMBERS}"
SEED = 20130819  # any fixed number: the draws are the same on every machine


def bound_9(size: int = MEMBERS) -> Claim:
    """(9) over the known set and three decades of gain."""
    rng = np.random.default_rng(SEED)
    members, bounds = [], []
    for _ in range(size):
        theta, gamma = rng.uniform(-5, 5, 2), 10 ** rng.uniform(-1, 2)
        given = variant(theta=theta)
        members.append((given, Mrac(gamma=gamma)))
        nu = theorem_1.nu_0(theorem_1.initial_parameter_error(np.zeros(2), theta), given.known)
        bounds.append(theorem_1.mrac_bound(nu, gamma))
    ratio = figures(members, 20.0, 1e-4).max_abs_e.max(axis=1) / np.array(bounds)
    sentence = SENTENCES["bound-9"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(bool((ratio < 1).all()), f"largest |e| / bound {ratio.max():.2f} over {size} runs"),),
        shows=f"The largest |e| of {size} random runs is {ratio.max():.2f} of the bound.",
        measured=        f"largest |e| / bound {ratio.max():.2f}, median {np.median(ratio):.2f}, over {size} runs",
        how="Section V, theta drawn from the box, Gamma from 0.1 to 100, RK4, h = 1e-4 s, 20 s, every step; bound rounded outward",
        listings=(table("Largest |e| over the bound, by Gamma", _by_decade([c.gamma for _, c in members], ratio)),),
        would_change="one run with e(0) = 0, without modelling error and numerically stable, whose |e| exceeds the bound",
        sharpened=FULL_COMMAND,
    )  # fmt: skip


def _by_decade(gammas: Sequence[float], ratio: Array) -> dict[str, Sequence[str] | Array]:
    """Columns: the decades of gain from 0.1 to 100, their runs, the median and the largest ratio in each."""
    decades = np.floor(np.log10(gammas))
    parts = [ratio[decades == k] for k in (-1, 0, 1)]
    return {
        "Gamma": ("0.1 to 1", "1 to 10", "10 to 100"),
        "runs": [str(len(part)) for part in parts],
        "median": np.array([np.median(part) for part in parts]),
        "largest": np.array([part.max() for part in parts]),
    }


def bound_10(size: int = MEMBERS) -> Claim:
    """(10) for kappa up to kappa_max."""
    rng = np.random.default_rng(SEED + 1)
    members, bounds = [], []
    given = section_v.problem()
    known, theta_max = given.known, 10.0
    model, slope = model_bounds(given), theorem_1.derivative_norm(known)
    largest = theorem_1.kappa_max(slope, theta_max)
    kappas = np.geomspace(1e-3, 0.95 * largest, 8)
    for kappa in kappas:
        C = input_filter(float(kappa))
        found = theorem_1.filter_condition(known, C.realise(), theta_max)
        for _ in range(size // 8):
            theta, gamma = rng.uniform(-5, 5, 2), 10 ** rng.uniform(-1, 2)
            members.append((variant(theta=theta), L1Adaptive(gamma=gamma, filter=C)))
            nu = theorem_1.nu_0(theorem_1.initial_parameter_error(np.zeros(2), theta), known)
            bounds.append(theorem_1.l1_bound(nu, gamma, found, theta_max, known.k_0, model))
    ratio = figures(members, 20.0, 1e-4).max_abs_e.max(axis=1) / np.array(bounds)
    sentence = SENTENCES["bound-10"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(bool((ratio < 1).all()), f"largest |e| / bound {ratio.max():.3f} over {size} runs"),),
        shows=f"The largest |e| of {size} random runs is {ratio.max():.3f} of the bound.",
        measured=        f"largest |e| / bound {ratio.max():.3f}, median {np.median(ratio):.3f}, over {size} runs",
        how=f"as for (9), kappa from 0.001 to 0.95 kappa_max = {0.95 * largest:.4f} s; certified norms and model bounds",
        listings=(
            table(
                "Largest |e| over the bound, by kappa",
                {"kappa [s]": kappas, "runs": [str(size // 8)] * 8, "median": np.median(ratio.reshape(8, -1), axis=1)}
                | {"largest": ratio.reshape(8, -1).max(axis=1)},
            ),
        ),
        would_change="as for (9), for a kappa below kappa_max",
        sharpened=FULL_COMMAND,
    )  # fmt: skip


def bound_9_further() -> Claim:
    """The row on the bound (9), with more random problems."""
    return bound_9(MORE_MEMBERS)


def bound_10_further() -> Claim:
    """The row on the bound (10), with more random problems."""
    return bound_10(MORE_MEMBERS)


def best_at_zero() -> Claim:
    """The bound and the measured error against kappa, down to the unfiltered scheme."""
    given = section_v.problem()
    known, model, gamma = given.known, model_bounds(given), 100.0
    nu = theorem_1.nu_0(5.0, known)
    kappas = (0.04, 0.02, 0.01, 0.001)
    bounds = [
        theorem_1.l1_bound(nu, gamma, theorem_1.filter_condition(known, input_filter(k).realise(), 10.0), 10.0, known.k_0, model)
        for k in kappas
    ]
    bounds.append(theorem_1.mrac_bound(nu, gamma))
    peaks = figures([(given, section_v.l1("L1", gamma, k)) for k in kappas], 60.0, 1e-4).max_abs_e.max(axis=1)
    unfiltered = figures([(given, Mrac(gamma=gamma))], 60.0, 1e-4).max_abs_e.max()
    errors = np.append(peaks, unfiltered)
    sentence = SENTENCES["best-kappa-zero"]
    readings = (
        sentence.reads(bool((np.diff(bounds) < 0).all()), f"{bounds[-1]:.2g} without filter, {bounds[-2]:.3g} with the fastest"),
        Reading(
            "so is the error itself",
            bool((np.diff(errors) < 0).all()),
            f"{errors[-1]:.2g} without filter, {errors[-2]:.3g} with the fastest",
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"The bound is {short(bounds[1])} with Section V's filter and {short(bounds[-1])} without; the largest error {errors[1]:.3g} and {errors[-1]:.1g}.",
        measured=        f"from kappa = {kappas[0]:g} s to none the bound goes from {short(bounds[0])} to {short(bounds[-1])}, the largest error "
        f"from {errors[0]:.3g} to {errors[-1]:.3g}",
        how="Section V, Gamma = 100; certified bounds beside RK4 runs of 60 s at h = 1e-4 s, without modelling error",
        listings=(
            table(
                f"The bound (10) and the largest |e| of a run against the filter's time constant, Gamma = {gamma:g}; 0: no "
                "filter",
                {"kappa [s]": (*kappas, 0.0), "bound of |e|": bounds, "largest |e|": errors},
            ),
        ),
        would_change="a filter with a smaller bound or error than none, without modelling error; with one see filter-reduces-margins",
    )  # fmt: skip


def part_iii() -> Claim:
    """What (10) states of a constant command for Gamma -> infinity, beside the error that a run has."""
    given = variant(reference=Constant(50.0))
    found = theorem_1.filter_condition(given.known, input_filter(section_v.KAPPA).realise(), 10.0)
    bound = theorem_1.l1_bound(theorem_1.nu_0(5.0, given.known), np.inf, found, 10.0, given.known.k_0, model_bounds(given))
    left = float(figures([(given, section_v.l1("L1", 1.0))], 120.0, 1e-3).tail_max_abs_e.max())
    sentence = SENTENCES["part-iii"]
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(bound == 0, f"(10) leaves {bound:.3g} for r = 50, however high the gain"),),
        shows=f"For r = 50 and any gain (10) still allows an error of {short(bound)}; the run's is {left:.0e}. It takes Barbalat's lemma and C(0) = 1.",
        measured=f"the bound (10) for r = 50 as Gamma goes to infinity is {bound:.4g}, the error of a run in the tail {left:.1g}. What is missing: the integral of |x_tilde|^2 is at most V(0), so x_tilde -> 0 "
        "(Barbalat); x_hat - x_m is then driven through W_b (1 - C) by a signal that tends to a constant, and (1 - C)(0) = 0",
        how=f"certified norm and model bounds, kappa = {section_v.KAPPA:g} s; run: Gamma = 1, RK4, h = 1e-3 s, 120 s",
        listings=(table("For r = 50: what part (ii) allows, and what a run leaves", {"": ("bound (10), Gamma -> infinity", "|e|, tail of a run"), "|e|": (bound, left)}),),
        would_change="a bound in part (ii) that goes to zero with time; that part (iii) is true is constant-command",
    )  # fmt: skip


V_TOLERANCE = 1e-6
"""Of V(0): by no more may V rise from one recorded instant to the next, which is what the step leaves."""
UNSTABLE_KAPPA = 1.0
"""[s]: twenty times what Theorem 1's condition admits; the limit of fast adaptation is unstable."""
LASTING_GROWTH = 5.0
"""From the first half of the run to the second, beyond which a state is taken to grow without end; the command's own period is shorter."""
LYAPUNOV_STEP = 2e-5
"""[s]: h omega_a is below 2.3, however far x goes in this time, and RK4 is stable up to 2.83."""


def same_lyapunov() -> Claim:
    """V of x_tilde and theta_tilde along L1-AC: with Section V's filter, and with one with which the plant is unstable."""
    given, gamma, sentence = section_v.problem(), 0.1, SENTENCES["same-lyapunov"]
    rises, reached, grown = [], [], []
    for kappa in (section_v.KAPPA, UNSTABLE_KAPPA):
        (run,) = simulate(
            given, [section_v.l1("L1", gamma, kappa)], Simulation(t_end=20.0, dt=LYAPUNOV_STEP, record_points=10_000)
        ).values()
        states = [run.loop.unpack(flat) for flat in run.states]
        x_tilde = run.x - np.array([one.controller.x_hat for one in states])
        theta_tilde = run.theta_hat - given.plant.theta
        V = np.einsum("ki,ij,kj->k", x_tilde, given.known.P, x_tilde) + (theta_tilde**2).sum(axis=1) / gamma
        rises.append(float(np.diff(V).max() / V[0]))
        size = np.abs(run.x).max(axis=1)
        reached.append(float(size.max()))
        grown.append(float(size[len(size) // 2 :].max() / size[: len(size) // 2].max()))
    falls = [rise < V_TOLERANCE for rise in rises]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(falls[0], f"the largest rise is {rises[0]:.1g} of V(0)"),
            sentence.reads(
                not falls[1] or grown[1] < LASTING_GROWTH,
                f"with kappa = {UNSTABLE_KAPPA:g} s the largest rise is {rises[1]:.1g} of V(0), and |x| reaches {reached[1]:.2g} in 20 s, {grown[1]:.2g} times what it is in the first half",
                1,
            ),
        ),
        shows=f"With both filters V rises by at most {max(0.0, *rises):.0e} of V(0), but it bounds x_tilde alone: with kappa = {UNSTABLE_KAPPA:g} s |x| reaches {reached[1]:.0e} in 20 s.",
        measured=f"with kappa = {section_v.KAPPA:g} s V rises by at most {rises[0]:.1g} of V(0) and |x| reaches {reached[0]:.3g}; with {UNSTABLE_KAPPA:g} s {rises[1]:.1g} and {reached[1]:.2g}. The proof of part (ii) names the small-gain theorem beside V",
        how=f"Section V, Gamma = {gamma:g}, RK4, h = {LYAPUNOV_STEP:g} s, 20 s, V at {len(run.t)} instants",
        listings=(
            table("V along L1-AC, and where the state goes", {"kappa [s]": (section_v.KAPPA, UNSTABLE_KAPPA), "largest rise of V, of V(0)": rises, "max |x|": reached}),
        ),
        would_change="a V that rises along a resolved run; a state that stays bounded with any filter",
    )  # fmt: skip


def constant_command() -> Claim:
    """Both schemes, with unit DC gain of the model from r to x_1 and with another."""
    tails = []
    for k_0 in (0.3, 4.0):
        given = variant(reference=Constant(50.0), k_0=k_0)
        tails += [figures([(given, c)], 120.0, 1e-4).tail_max_abs_e.max() for c in (Mrac(gamma=1.0), section_v.l1("L1", 1.0))]
    sentence = SENTENCES["constant-command"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(max(tails[:2]) < 1e-4, f"MRAC {tails[0]:.1g}, L1-AC {tails[1]:.1g}"),
            Reading("the condition on the DC gain is needed", max(tails[2:]) >= 1e-4, f"with a DC gain of 13.3 MRAC {tails[2]:.1g}, L1-AC {tails[3]:.1g}", "beside"),
        ),
        shows=f"max |e| in the tail: MRAC {tails[0]:.0e}, L1-AC {tails[1]:.0e}; with a DC gain of 13.3 too, {max(tails[2:]):.0e} at most.",
        measured=        f"max |e| in the tail: MRAC {tails[0]:.1g}, L1-AC {tails[1]:.1g} with DC gain 1; {tails[2]:.1g} and {tails[3]:.1g} with DC gain "
        "13.3: the condition is not needed, C(0) = 1 is enough",
        how="Section V with r = 50, k_0 = 0.3 and 4, Gamma = 1, RK4, h = 1e-4 s, 120 s",
        listings=(
            table(
                "The largest |e| in the last quarter of the run",
                {"DC gain of the model": ("1", "13.3"), "MRAC": tails[::2], "L1-AC": tails[1::2]},
            ),
        ),
        would_change="a constant command and a filter with C(0) = 1 inside Theorem 1's condition whose error stays",
    )  # fmt: skip


def is_mrac() -> Claim:
    """C = 1 in the predictor's form; and a filter before the standard MRAC as it stands, whose law is driven by e."""
    given, gamma = section_v.problem(), section_v.MODERATE_GAIN
    one = figures([(given, L1Adaptive(gamma=gamma, filter=None))], 60.0, 1e-4)
    other = figures([(given, Mrac(gamma=gamma))], 60.0, 1e-4)
    difference = float(np.abs(one.max_abs_e / other.max_abs_e - 1).max())
    filtered = variant(input=PlantInput(actuator=input_filter(section_v.KAPPA)))  # C(s) between (3) and the plant
    by_e = figures([(filtered, Mrac(gamma=gamma))], 60.0, 1e-4)
    by_prediction = figures([(given, section_v.l1("L1", gamma))], 60.0, 1e-4)
    apart = float(np.abs(by_e.tail_max_abs_e / by_prediction.tail_max_abs_e - 1).max())
    literal = f"tail error {numbers(by_e.tail_max_abs_e[0])}, with (5)-(8) {numbers(by_prediction.tail_max_abs_e[0])}"
    shares = (by_e.tail_max_abs_e / by_prediction.tail_max_abs_e)[0]
    sentence = SENTENCES["filtered-mrac"]
    readings = (
        sentence.reads(apart < 0.01, literal),
        Reading(
            "the MRAC is written with the predictor (8), which knows of the filter: with C = 1 the two then coincide",
            difference < 1e-9,
            f"largest errors differ by {difference:.1g} of themselves",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"A filter on the plain MRAC leaves {shares[0]:.2g} and {shares[1]:.2g} of L1-AC's tail errors.",
        measured=        f"the predictor's form with C = 1 has the MRAC's errors within {difference:.1g} of themselves. A filter of kappa = {section_v.KAPPA:g} s before the "
        f"error-driven MRAC is another scheme: {literal}, {apart:.0%} apart. Between them stands the predictor, which knows of the filter",
        how="Section V, Gamma = 10, RK4, h = 1e-4 s, 60 s; the step by step agreement is held to rounding by a test",
        listings=(
            by_component(
                f"Tail error and variation of the estimates with the same filter, kappa = {section_v.KAPPA:g} s, before either "
                "law",
                {"(3)-(4), driven by e": by_e, "(5)-(8)": by_prediction},
            ),
        ),
        would_change="errors of the two that differ with C = 1, or a filtered error-driven MRAC that moves as (5)-(8) does",
    )  # fmt: skip


ROWS = (
    Measurement(
        bound_9,
        0.6,
        {"bound-9": "the standard MRAC's bound (9)"},
        place=40,
        quick=True,
        sharper=bound_9_further,
        sharper_seconds=6.0,
    ),
    Measurement(
        bound_10, 0.8, {"bound-10": "L1-AC's bound (10)"}, place=50, quick=True, sharper=bound_10_further, sharper_seconds=8.0
    ),
    Measurement(best_at_zero, 0.2, {"best-kappa-zero": "the bound (10) is best without a filter"}, place=70, quick=True),
    Measurement(constant_command, 0.4, {"constant-command": "errors for constant r"}, place=80, quick=True),
    Measurement(part_iii, 0.2, {"part-iii": "part (iii) as a consequence of (i) and (ii)"}, place=85),
    Measurement(is_mrac, 0.2, {"filtered-mrac": "L1-AC with C = 1 is the standard MRAC"}, place=90, quick=True),
    Measurement(same_lyapunov, 0.6, {"same-lyapunov": "the same Lyapunov function"}, place=95),
)
