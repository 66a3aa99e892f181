"""The transient of both schemes: L1-AC beside its reference system, the MRAC beside the bounds that (9) gives it."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.bounds.model import model_bounds
from barbalat.controllers import Mrac
from barbalat.papers.cao_hovakimyan_2006.sentences import SENTENCES
from barbalat.papers.claim import Claim, Measurement, numbers, span, table
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.tracking import l1_reference

SEED, MEMBERS = 20130822, 96
"""Random runs of the MRAC, a multiple of the kernel's lanes; any fixed seed draws the same on every machine."""
THETA_MAX = 10.0
"""Section V's, of |theta_hat|_1 over the known set, which projection keeps."""
LATE_SHARE = 0.1
"""Of the first quarter's distance, below which the last quarter's counts as on its way to zero."""


def mrac() -> Claim:
    """The MRAC's error and input over their bounds, theta and the gain drawn at random."""
    rng, given = np.random.default_rng(SEED), section_v.problem()
    model, members, of_e, of_u = model_bounds(given), [], [], []
    for _ in range(MEMBERS):
        theta, gamma = rng.uniform(-5, 5, 2), 10 ** rng.uniform(-1, 2)
        drawn = variant(theta=theta)
        members.append((drawn, Mrac(gamma=gamma)))
        bound = theorem_1.mrac_bound(theorem_1.nu_0(theorem_1.initial_parameter_error(np.zeros(2), theta), drawn.known), gamma)
        of_e.append(bound)
        of_u.append(THETA_MAX * (model.x_m + bound) + drawn.known.k_0 * model.r)
    found = figures(members, 20.0, 1e-4)
    error = found.max_abs_e.max(axis=1) / np.array(of_e)
    control = found.max_abs_u.reshape(MEMBERS, -1).max(axis=1) / np.array(of_u)
    sentence = SENTENCES["mrac-transient"]
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(error.max() > 1), f"the largest |e| is at most {error.max():.2f} of it, over {MEMBERS} runs"),
            sentence.reads(bool(control.max() > 1), f"the largest |u| is at most {control.max():.2f} of it", 1),
        ),
        shows=f"The MRAC's |e| reaches {error.max():.2f} of nu_0/sqrt(Gamma), its |u| {control.max():.2f} of the bound that follows, in {MEMBERS} random runs.",
        measured=f"largest |e| / bound {error.max():.2f}, median {np.median(error):.2f}; largest |u| / bound {control.max():.2f}, median {np.median(control):.2f}",
        how="Section V, theta drawn from the box, Gamma from 0.1 to 100, RK4, h = 1e-4 s, 20 s, every step, without modelling error; bounds rounded outward",
        listings=(table("Of the bounds, over all runs", {"of": ("|e|", "|u|"), "median": (np.median(error), np.median(control)), "largest": (error.max(), control.max())}),),
        would_change="a run without modelling error, numerically stable, that exceeds one of the bounds",
    )  # fmt: skip


def l1() -> list[Claim]:
    """L1-AC's distance from its reference system, over the gain and over time."""
    found, sentence = l1_reference.distances(l1_reference.STEPS), SENTENCES["gain-enforces-transient"]
    falls = [bool((np.diff(values) < 0).all()) for values in (found.state, found.control)]
    enforced = Claim(
        sentence=sentence,
        readings=(
            sentence.reads(falls[0], f"{span(found.state)} over Gamma = {numbers(found.gains)}"),
            sentence.reads(falls[1], f"{span(found.control)}", 1),
        ),
        shows=f"From Gamma = {found.gains[0]:g} to {found.gains[-1]:g} the largest |x - x_ref| falls from {found.state[0]:.2g} to {found.state[-1]:.2g}, |u - u_ref| from {found.control[0]:.2g} to {found.control[-1]:.2g}.",
        measured=f"|x - x_ref| {span(found.state)}, |u - u_ref| {span(found.control)}; the reference system itself stays up to {found.model:.3g} away from the model x_m, whatever the gain is",
        how=f"Section V, kappa = {section_v.KAPPA:g} s, RK4, h = {span(list(l1_reference.STEPS.values()))} s, {l1_reference.T_END:g} s",
        listings=(table("The largest distances from the reference system", {"Gamma": found.gains, "|x - x_ref|": found.state, "|u - u_ref|": found.control}),),
        would_change="a gain at which a resolved run is farther from the reference system than at a lower one",
    )  # fmt: skip
    return [enforced, _asymptotic()]


def _asymptotic() -> Claim:
    sentence, gamma, t_end = SENTENCES["asymptotic-tracking"], 100.0, section_v.T_END
    one, other = l1_reference.run_pair(gamma, l1_reference.STEPS[gamma], t_end)
    distance = np.abs(one.x - other.x).max(axis=1)
    quarters = np.array([distance[(one.t >= k * t_end / 4) & (one.t <= (k + 1) * t_end / 4)].max() for k in range(4)])
    return Claim(
        sentence=sentence,
        readings=(sentence.reads(bool(quarters[-1] < LATE_SHARE * quarters[0]), f"{quarters[0]:.3g} in the first quarter, {quarters[-1]:.2g} in the last"),),
        shows=f"At Gamma = {gamma:g} |x - x_ref| goes from {quarters[0]:.2g} in the first quarter of {t_end:g} s to {quarters[-1]:.1g} in the last.",
        measured=f"the largest |x - x_ref| of the quarters goes from {quarters[0]:.3g} to {quarters[-1]:.2g}",
        how=f"Section V, kappa = {section_v.KAPPA:g} s, RK4, h = {l1_reference.STEPS[gamma]:g} s, {t_end:g} s, {l1_reference.COMPARED_INSTANTS} instants",
        listings=(table("The largest |x - x_ref| in each quarter of the run", {"quarter": ("first", "second", "third", "last"), "|x - x_ref|": quarters}),),
        would_change="a distance that does not fall in a longer run",
    )  # fmt: skip


ROWS = (
    Measurement(mrac, 0.5, {"mrac-transient": "what bounds the MRAC's transient"}, place=10, quick=True),
    Measurement(
        l1,
        2.0,
        {
            "gain-enforces-transient": "L1-AC's transient over the gain",
            "asymptotic-tracking": "L1-AC's distance from its reference system",
        },
        place=20,
    ),
)
