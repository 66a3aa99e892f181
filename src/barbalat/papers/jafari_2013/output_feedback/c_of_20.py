"""A search over three forms, with one bandwidth each, for one C that satisfies (20) for every plant of a known set."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from barbalat.certificates.schemes.output.l1 import condition_norm, small_gain_system
from barbalat.controllers.output.l1 import L1Output
from barbalat.linear.systems import TransferFunction
from barbalat.papers.claim import Claim, Measurement, short, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.sentences import SENTENCES

M, LIPSCHITZ = 1.0, 0.5
"""The pole of (19) [rad/s], and L, both as in the bundled case l1-output."""
BANDWIDTHS = np.geomspace(1.0, 1e4, 9)
"""Bandwidths of the filter [rad/s]."""
GRID = np.linspace(-5.0, 5.0, 5)
"""Values of each theta_i, which give corners, edges and interior points of Section V's known set."""


def first_order(w: float) -> TransferFunction:
    """Return the filter (6) with kappa = 1/w."""
    return TransferFunction([w], [1.0, w])


def two_slopes(w: float) -> TransferFunction:
    """Return the C with 1 - C = s^2/(s + w)^2."""
    return TransferFunction([2 * w, w**2], [1.0, 2 * w, w**2])


def with_lead(w: float) -> TransferFunction:
    """Return the C with C/(1 - C) = m w^2 (3 s + w)/(s (s + 3 w)). With 1/s^2, the high-frequency limit of every plant of the
    set, it gives a lead of 53 degrees at the crossover w."""
    num = M * np.array([3 * w**2, w**3])
    return TransferFunction(num, np.polyadd([1.0, 3 * w, 0.0], num))


FIRST = "first order, as (6)"
FORMS: dict[str, Callable[[float], TransferFunction]] = {
    FIRST: first_order,
    "two slopes of 1 - C": two_slopes,
    "with a lead": with_lead,
}


def plants(gain: float = 1.0) -> list[TransferFunction]:
    """Return the plants from u to x_1 over the known set, gain/(s^2 + (1 - theta_2) s + 0.3 - theta_1)."""
    A_m = section_v.problem().plant.A_m
    return [TransferFunction([gain], [1.0, -A_m[1, 1] - b, -A_m[1, 0] - a]) for a in GRID for b in GRID]


def stabilised(C: TransferFunction, family: list[TransferFunction]) -> int:
    """Return the number of plants for which H is stable."""
    scheme = L1Output(m=M, gamma=1.0, filter=C)
    return sum(small_gain_system(scheme, G).is_stable for G in family)


def largest_norm(C: TransferFunction, family: list[TransferFunction]) -> float:
    """Return a guaranteed upper bound on ||H (1 - C)||_1 L for the worst plant. H must be stable for all plants."""
    scheme = L1Output(m=M, gamma=1.0, filter=C)
    return LIPSCHITZ * max(condition_norm(scheme, G).upper for G in family)


def claim() -> Claim:
    """Try each form over the bandwidths and the plants of the set, and with an unknown sign of the gain."""
    sentence, family = SENTENCES["c-of-20"], plants()
    counts = {name: [stabilised(form(float(w)), family) for w in BANDWIDTHS] for name, form in FORMS.items()}
    found = {name: _least(form, family, counts[name]) for name, form in FORMS.items()}
    satisfied = {name: (w, norm) for name, (w, norm) in found.items() if norm < 1}
    either = [*plants(), *plants(-1.0)]
    of_both = sum(stabilised(form(float(w)), either) == len(either) for form in FORMS.values() for w in BANDWIDTHS)
    best, (w, _) = min(satisfied.items(), key=lambda one: one[1][0], default=("none", (np.nan, np.nan)))
    told = "; ".join(
        f"{name} for w >= {short(at)} rad/s, with ||H(1-C)||_1 L at most {value:.2g}" for name, (at, value) in satisfied.items()
    )
    most = {name: max(values) for name, values in counts.items()}
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(bool(satisfied), told or f"none of {len(FORMS) * len(BANDWIDTHS)} does so for all {len(family)} "
            f"plants"),
            Reading(
                "a first-order C, such as (6), is sufficient",
                FIRST in satisfied,
                f"H is stable for at most {most[FIRST]} of {len(family)} plants. Its denominator is m s d(s) + w (s + m); if "
                f"d(s) = s^2 + a_1 s + a_0 has a_1 < 0, its coefficient m a_1 is negative for any w and m",
                "beside",
            ),
            Reading(
                "some C also stabilises H for plants with either sign of the gain",
                bool(of_both),
                f"{of_both} of {len(FORMS) * len(BANDWIDTHS)} do. None can: with C(0) = 1 the denominator of H begins with m "
                f"d(s) (q - p), C = p/q, and ends with n(0) p(0) m, whose sign is that of the gain. An MRAC also needs to "
                f"know that sign",
                "beside",
            ),
        ),
        shows=f"A C {best}, w = {short(w)} rad/s, satisfies (20) for all {len(family)} plants of Section V's set; a C of first "
        f"order stabilises at most {most[FIRST]} of them.",
        measured=f"number of the {len(family)} plants for which H is stable at the best bandwidth: "
        f"{', '.join(f'{count} ({name})' for name, count in most.items())}. These C satisfy (20) for all plants: "
        f"{told or 'none'}. "
        "Ref. 15 is not available, so it is open whether its section 4.1.4 addresses the question in general",
        how=f"G = 1/(s^2 + (1 - theta_2) s + 0.3 - theta_1), {len(GRID)} x {len(GRID)} theta of the known set, (19) with m = "
        f"{M:g}, L = {LIPSCHITZ:g}, {len(BANDWIDTHS)} bandwidths from {BANDWIDTHS[0]:g} to {BANDWIDTHS[-1]:g} rad/s; poles of "
        f"H, certified L1 norms; a grid says nothing about the plants between its points",
        listings=(table("Number of plants for which H of (20) is stable, by the bandwidth of "
        "C", {"w [rad/s]": BANDWIDTHS} | {name: [str(count) for count in values] for name, values in counts.items()}),),
        would_change="fails: a set for which no C of these forms satisfies (20). The C with a lead works because every plant of "
            "the set behaves as 1/s^2 at high frequency; other relative degrees or zeros need a new search",
    )  # fmt: skip


def _least(form: Callable[[float], TransferFunction], family: list[TransferFunction], counts: list[int]) -> tuple[float, float]:
    """Return the smallest bandwidth with which a form satisfies (20) for all plants, and its worst norm times L; infinity if none
    does."""
    for w, count in zip(BANDWIDTHS, counts, strict=True):
        if count == len(family) and (norm := largest_norm(form(float(w)), family)) < 1:
            return float(w), norm
    return np.inf, np.inf


ROWS = (Measurement(claim, 1.5, {"c-of-20": "one C that satisfies (20) for an unknown plant"}, place=345),)
