"""The claim that the robust MRAC extends to SISO plants of any relative degree, with disturbances and unmodelled dynamics."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from barbalat.adaptation.law import Normalization
from barbalat.adaptation.laws import AdaptiveLaw, Gradient, LeastSquares
from barbalat.adaptation.modifications import SwitchingSigma
from barbalat.controllers.output.mrac import MracOutput
from barbalat.linear.systems import TransferFunction
from barbalat.papers.claim import Claim, Measurement, span, table
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013.section_v import local_exponents
from barbalat.papers.jafari_2013.sentences import SENTENCES
from barbalat.problem.actuation import PlantInput
from barbalat.problem.output_feedback import OutputPlant, OutputProblem, OutputReferenceModel
from barbalat.run.engine.simulate import simulate
from barbalat.signals import Sine
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array

DEGREES = {
    1: (TransferFunction(np.array([2.0, 2.0]), np.array([1.0, 1.0, 2.0])), TransferFunction(np.ones(1), np.array([1.0, 1.0]))),
    2: (TransferFunction(np.array([2.0]), np.array([1.0, 1.0, -0.5])), TransferFunction(np.ones(1), np.array([1.0, 2.0, 1.0]))),
    3: (
        TransferFunction(np.array([1.5]), np.array([1.0, 2.0, 2.0, 0.5])),
        TransferFunction(np.ones(1), np.array([1.0, 3.0, 3.5, 1.5])),
    ),
    4: (
        TransferFunction(np.array([2.0]), np.array([1.0, 5.0, 8.75, 6.25, 1.5])),
        TransferFunction(np.ones(1), np.array([1.0, 5.5, 11.0, 9.5, 3.0])),
    ),
}
"""A plant and a model for each relative degree. The second plant is unstable. The last plant has the poles -0.5, -1, -1.5 and -2,
and its model has the poles -1, -1, -1.5 and -2."""
USUAL_DEGREES = (1, 2, 3)
"""The relative degrees that are tried without ``--full``, which tries all."""
LEAST_SQUARES = "least squares (15)"
LAWS: dict[str, AdaptiveLaw] = {LEAST_SQUARES: LeastSquares(covariance0=5.0), "gradient": Gradient(gamma=5.0)}
"""The laws. Without ``--full`` only the first one is tried, which the literal readings name."""

DISTURBANCE_AND_LAG: tuple[Sine, float] = (Sine(amplitude=0.2, frequency=2.0), 0.05)
"""The size of a bounded disturbance, a fifth of the command, and an actuator lag [s] that is unknown to the designer."""
LARGEST_GROWTH = 1.1
"""Factor by which the largest error of the last quarter may exceed that of the previous quarter, because signals of two
frequencies beat and the estimates still move."""


def claim(*, full: bool = False) -> Claim:
    """Measure the effect of the auxiliary input for the relative degrees and laws tried, and the law under the perturbations that
    the sentence names."""
    taus = np.array([0.1, 0.05, 0.025])
    degrees, laws = (tuple(DEGREES), tuple(LAWS)) if full else (USUAL_DEGREES, tuple(LAWS)[:1])
    errors = {f"n* = {degree}, {law}": _peaks(degree, LAWS[law], taus) for law in laws for degree in degrees}
    exponents = {name: local_exponents(peaks, taus) for name, peaks in errors.items()}
    disturbed = {f"n* = {degree}": _last_quarters(degree, LAWS[LEAST_SQUARES]) for degree in degrees}
    leaking = {f"n* = {degree}": _last_quarters(degree, LEAKING) for degree in degrees} if full else {}
    own = {name: found for name, found in exponents.items() if LEAST_SQUARES in name}
    shrinks, stays = _powers(own), _told(disturbed)
    sentence, least = SENTENCES["siso-any-relative-degree"], min(float(exponent.min()) for exponent in own.values())
    largest = max(last for _, last in disturbed.values())
    others = (
        ()
        if not full
        else (
            Reading(
                "the same holds with the gradient law; under disturbance and lag, it has a switching sigma-modification",
                min(float(found.min()) for found in exponents.values()) > LEAST_EXPONENT and _bounded(leaking),
                f"{_powers({name: found for name, found in exponents.items() if name not in own})}; {_told(leaking)}",
                "beside",
            ),
        )
    )
    return Claim(
        sentence=sentence,
        readings=(
            sentence.reads(least > LEAST_EXPONENT, shrinks),
            sentence.reads(_bounded(disturbed), stays, 1),
            *others,
        ),
        shows=f"For relative degrees 1 to {max(degrees)} with law (15), the error falls at least as fast as tau^{least:.2f}; "
        f"with disturbance and lag it is at most {largest:.2g} in the last quarter.",
        measured=f"{shrinks}; with disturbance and lag {stays}",
        how=f"one plant for each relative degree, r = sin 1.3t, law (15) with P(0) = 5, RK4, h = 1e-3 s, tau = {span(taus)} s, "
        f"20 s; with disturbance and lag: d = 0.2 sin 2t, a lag of {DISTURBANCE_AND_LAG[1]:g} s, (16) with alpha_0 = 0.1, "
        "delta_0 = 0.5, tau = 0.1 s, h = 2e-3 s, 240 s",
        listings=(table("The largest |y - y_m| against tau, by relative degree n* and law", {"tau [s]": taus, **errors}),),
        would_change="a relative degree at which the transient error does not shrink with tau, or at which the error grows in "
            "time with the disturbance and the lag. A run shows only one relative degree, and the paper gives no proof",
        sharpened=f"relative degree {max(DEGREES)}, and the gradient law as well as pure least squares",
    )  # fmt: skip


LEAST_EXPONENT = 0.5
LEAKING = Gradient(gamma=5.0, leakage=SwitchingSigma(sigma=0.1, M_0=20.0))


def _bounded(quarters: dict[str, tuple[float, float]]) -> bool:
    return all(last <= LARGEST_GROWTH * before for before, last in quarters.values())


def _powers(exponents: dict[str, Array]) -> str:
    return "max |y - y_m| varies as tau to the power " + ", ".join(f"{span(found)} for {n}" for n, found in exponents.items())


def _told(quarters: dict[str, tuple[float, float]]) -> str:
    return "the largest |y - y_m| of the last quarter is " + ", ".join(
        f"{last:.3g} for {n}, {last / before:.2f} times that of the previous quarter" for n, (before, last) in quarters.items()
    )


def _peaks(degree: int, law: AdaptiveLaw, taus: Array) -> Array:
    """Return the largest |y - y_m| of the transient for each tau, without modelling error."""
    controllers = [_robust(degree, law, float(tau), name=f"{tau}") for tau in taus]
    runs = simulate(_on_a_plant(degree), controllers, Simulation(t_end=20.0, dt=1e-3))
    return np.array([run.metrics.max_abs_e[0, 0] for run in runs.values()])


def _last_quarters(degree: int, law: AdaptiveLaw) -> tuple[float, float]:
    """Return the largest |y - y_m| of the third and of the last quarter of four minutes; infinite if the run diverges."""
    controller = replace(_robust(degree, law, 0.1, name="robust"), normalization=Normalization(alpha_0=0.1, delta_0=0.5))
    disturbance, lag = DISTURBANCE_AND_LAG
    actuator = TransferFunction(np.ones(1), np.array([lag, 1.0]))
    given = replace(_on_a_plant(degree), disturbance=disturbance)
    given = replace(given, plant=replace(given.plant, input=PlantInput(actuator=actuator)))
    (run,) = simulate(given, [controller], Simulation(t_end=240.0, dt=2e-3)).values()
    if run.diverged_at is not None:
        return 1.0, np.inf
    _, _, third, last = np.array_split(np.abs(run.e[:, 0]), 4)
    return float(third.max()), float(last.max())


def _robust(degree: int, law: AdaptiveLaw, tau: float, *, name: str) -> MracOutput:
    """Return the controller for a plant of known order, relative degree and sign."""
    order = len(DEGREES[degree][0].poles)
    return MracOutput(order=order, relative_degree=degree, sign=1, law=law, tau=tau, c_0_min=0.1, name=name)


def _on_a_plant(degree: int) -> OutputProblem:
    plant, model = DEGREES[degree]
    return OutputProblem(
        plant=OutputPlant(transfer_function=plant),
        reference_model=OutputReferenceModel(transfer_function=model),
        reference=Sine(amplitude=1.0, frequency=1.3),
    )


ROWS = (
    Measurement(
        claim,
        4.0,
        {"siso-any-relative-degree": "the robust MRAC for any relative degree"},
        place=390,
        sharper=partial(claim, full=True),
        sharper_seconds=14.0,
    ),
)
