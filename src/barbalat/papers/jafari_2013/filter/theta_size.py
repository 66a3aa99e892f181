"""The claim that the filter limits the size of the uncertainty, tested with a guaranteed, an exact and a simulated limit."""

from __future__ import annotations

import numpy as np

from barbalat.certificates.bounds import theorem_1
from barbalat.certificates.linear_loops.ideal import fast_adaptation
from barbalat.controllers import Mrac
from barbalat.linear.largest import largest
from barbalat.linear.systems import input_filter
from barbalat.papers.claim import ChartAxis, Claim, Curve, Map, Measurement, numbers
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.section_v import figures, variant
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Controller
from barbalat.signals import Constant
from barbalat.validate import Array

THETA_DIRECTION = np.array([4.0, -3.0])
"""The paper's theta."""
ADAPTIVE_GAIN = 100.0
KAPPAS = np.geomspace(1e-3, 1.0, 25)
THETA_SCALES = np.geomspace(0.5, 50, 17)
"""Sizes of theta, of which the paper's is 1."""


def filter_limits_theta() -> Claim:
    """Measure up to which size of theta the filtered and the unfiltered loop are stable."""
    guaranteed = _guaranteed_scale(np.array([section_v.KAPPA]))[0]
    exact = _exact_scale(section_v.KAPPA)
    sides = [(_given(s), _l1(section_v.KAPPA)) for s in (0.8 * exact, 1.25 * exact)]
    early, late = _tail(sides, 30.0), _tail(sides, 60.0)
    unfiltered = _tail([(_given(s), Mrac(gamma=ADAPTIVE_GAIN, projection=False)) for s in THETA_SCALES])
    stays, goes = bool(late[0] < early[0] / 2), bool(np.isnan(late[1]) or late[1] > 2 * early[1])
    bounded = bool((unfiltered < 1e-3).all())
    sentence = SENTENCES["filter-limits-theta"]
    readings = (
        sentence.reads(
            stays and goes and bounded,
            f"with the filter the loop is unstable beyond theta = {exact:.2f} [4, -3]; MRAC tolerates {THETA_SCALES[-1]:g} [4, "
            "-3]",
        ),
        Reading(
            "Theorem 1's guarantee limits the size only with the filter",
            bool(np.isfinite(guaranteed)) and bounded,
            f"up to theta = {_down(guaranteed)} [4, -3] with the filter; without it the theorem has no such condition",
            "beside",
        ),
    )
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"With the filter the loop is unstable beyond theta = {exact:.2f} [4, -3]; MRAC tolerates {THETA_SCALES[-1]:g} [4, "
        "-3].",
        measured=f"with kappa = 0.02 s Theorem 1 guarantees stability up to theta = {_down(guaranteed)} [4, -3], |theta|_1 = "
            f"{_down(7 * guaranteed)}. The limit loop is stable up to {exact:.2f} [4, -3], {exact / guaranteed:.1f} times that "
            f"size. In runs at 0.8 and 1.25 times this limit the tail error of L1-AC is {numbers(early)} over 30 s and "
            f"{numbers(late)} over 60 s. For {len(THETA_SCALES)} sizes up to {THETA_SCALES[-1]:g} [4, -3] the tail error of "
            f"MRAC is at most {unfiltered.max():.1g}",
        how="certified norms; bisection on the exact eigenvalues of the fast-adaptation loop; RK4, h = 1e-4 s, Gamma = 100, r = 1, no projection, "
        "30 s (h omega_a is below 1 in the stable runs)",
        maps=(_map(),),
        would_change="a filtered loop that tolerates any theta, or an unfiltered loop that diverges with a large theta although "
        "there is no modelling error",
    )  # fmt: skip


def _down(value: float) -> str:
    """Format a guaranteed limit, rounded to the safe side."""
    return f"{np.floor(1000 * value) / 1000:.3f}"


def _given(scale: float) -> Problem:
    return variant(theta=scale * THETA_DIRECTION, reference=Constant(1.0))


def _l1(kappa: float) -> Controller:
    return section_v.l1("L1", ADAPTIVE_GAIN, kappa, projection=False)


def _tail(members: list[tuple[Problem, Controller]], t_end: float = 30.0) -> Array:
    """Return the tail error of each run, NaN if it diverged."""
    return np.asarray(figures(members, t_end, 1e-4).tail_max_abs_e.max(axis=1))


def _guaranteed_scale(kappas: Array) -> Array:
    """Return for each kappa the largest theta/[4, -3] with ||W_b (1 - C)||_1 |theta|_1 < 1."""
    known, size = section_v.problem().known, np.abs(THETA_DIRECTION).sum()
    norms = [theorem_1.filter_condition(known, input_filter(float(k)).realise(), 1.0).norm.upper for k in kappas]
    return np.array([1 / (norm * size) for norm in norms])


def _exact_scale(kappa: float) -> float:
    """Find the size at which the limit of fast adaptation loses stability, by bisection."""
    C = input_filter(kappa).realise()

    def is_stable(scale: float) -> bool:
        loop = fast_adaptation(variant(theta=scale * THETA_DIRECTION).plant, C)
        return bool(np.linalg.eigvals(loop.A - np.outer(loop.B, loop.C) / (1 + loop.D)).real.max() < 0)

    return largest(is_stable, 1e-3, 1e4, within=1e-10)


def _map() -> Map:
    tail = _tail([(_given(s), _l1(float(k))) for s in THETA_SCALES for k in KAPPAS])
    coarse = KAPPAS[::4]
    return Map(
        key="kappa-theta",
        title="L1-AC: the uncertainty tolerated with a filter",
        caption=(
            "Each cell is a run of L1-AC with theta = s [4, -3], r = 1, Gamma = 100, no projection, h = 1e-4 s, 30 s. "
            "The MRAC without a filter is stable for every size on the map. Theorem 1's condition is certified below the lower "
            "line; the limit loop of fast adaptation loses stability at the upper line."
        ),
        x=ChartAxis("filter time constant κ [s]", KAPPAS, logarithmic=True),
        y=ChartAxis("size s of the parameters, θ = s [4, −3]", THETA_SCALES, logarithmic=True),
        values=tail.reshape(len(THETA_SCALES), len(KAPPAS)),
        quantity="max |e| in the tail",
        logarithmic=True,
        curves=(
            Curve("certified: Theorem 1's condition", KAPPAS, _guaranteed_scale(KAPPAS)),
            Curve("exact, for Γ → ∞", coarse, np.array([_exact_scale(float(k)) for k in coarse])),
            Curve("Section V", [section_v.KAPPA], [1.0], marks=True),
        ),
    )


ROWS = (
    Measurement(
        filter_limits_theta, 1.6, {"filter-limits-theta": "the filter limits the size of the unknown parameters"}, place=110
    ),
)
