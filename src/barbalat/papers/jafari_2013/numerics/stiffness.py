"""The claim that a high gain makes the loop stiff, tested by the eigenvalues of its exact Jacobian at the fastest adaptation,
over the gain."""

from __future__ import annotations

import numpy as np

from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.linearization import jacobian_function, signals_at_rest
from barbalat.papers.claim import Claim, Measurement, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

GAINS = (1e2, 1e3, 1e4, 1e5, 1e6)
GROWTH = 1.5
"""A decay rate that grows by less than this factor per decade of the gain counts as independent of the gain. Growth with
sqrt(Gamma) would give a factor of 3.2."""
SMOOTH_GAIN = 100.0
"""Gain of the run that provides the crest of |x|. x depends little on the gain, and this run is smooth at h = 1e-4 s."""


def stiffness() -> Claim:
    """Compute the eigenvalues of L1-AC's loop, frozen at the crest of |x|, for five gains."""
    eigenvalues = [_at_crest(gamma) for gamma in GAINS]
    decay = np.array([-found.real.min() for found in eigenvalues])
    size = np.array([np.abs(found).max() for found in eigenvalues])
    exponents = [np.polyfit(np.log(GAINS), np.log(values), 1)[0] for values in (decay, size)]
    sentence = SENTENCES["stiffness"]
    readings = (
        sentence.reads(bool((decay[1:] > GROWTH * decay[:-1]).all()), f"the fastest decay is {decay[0]:.3g} 1/s at Gamma = {GAINS[0]:g} and {decay[-1]:.3g} 1/s at {GAINS[-1]:g}"),
        Reading(
            "stiff is meant in the sense of Hairer and Wanner: stability limits the step of an explicit method, here because of "
            "a frequency",
            bool((size[1:] > GROWTH * size[:-1]).all()),
            f"the largest |lambda| goes from {size[0]:.3g} to {size[-1]:.3g} rad/s, as Gamma^{exponents[1]:.2f}",
        ),
    )  # fmt: skip
    return Claim(
        sentence=sentence,
        readings=readings,
        shows=f"Over four decades of gain the fastest decay goes from {decay[0]:.3g} to {decay[-1]:.3g} 1/s and the frequency "
        f"from {size[0]:.1e} to {size[-1]:.1e} rad/s.",
        measured=f"at the crest of |x| the fastest decay rate of the loop varies as Gamma^{exponents[0]:.2f} and the largest "
        f"|lambda| as Gamma^{exponents[1]:.2f}: the fast modes oscillate",
        how=f"L1-AC of Section V, kappa = {section_v.KAPPA:g} s, exact Jacobian at the state of a run with Gamma = {SMOOTH_GAIN:g} at the largest |x|, with the projection inactive",
        listings=(
            table("The loop's eigenvalues at the crest of |x|", {"Gamma": GAINS, "fastest decay [1/s]": decay, "largest |lambda| [rad/s]": size}),
        ),
        would_change="a loop whose decay rates differ more and more as the gain rises",
    )  # fmt: skip


def _at_crest(gamma: float) -> Array:
    """Return the eigenvalues [1/s] of the loop with this gain, at the largest |x| of the smooth run."""
    given = section_v.problem()
    (run,) = simulate(given, [section_v.l1("L1", SMOOTH_GAIN, projection=False)], Simulation(t_end=20.0, dt=1e-4)).values()
    crest = int(np.linalg.norm(run.x, axis=1).argmax())
    loop = ClosedLoop.of(given, section_v.l1("L1", gamma, projection=False))
    jacobian = jacobian_function(loop)(run.states[crest], signals_at_rest(loop, float(run.r[crest])))
    return np.linalg.eigvals(np.array(jacobian))


ROWS = (Measurement(stiffness, 0.5, {"stiffness": "whether a high gain makes the loop stiff"}, place=115),)
