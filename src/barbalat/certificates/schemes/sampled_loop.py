"""What the schemes that are linear from sample to sample share: the margins of a loop that is known exactly."""

from __future__ import annotations

from barbalat.certificates.certificate import Draft
from barbalat.certificates.linear_loops.from_sample_to_sample import Linearised
from barbalat.certificates.linear_loops.margin_values import KEYS_OF_MARGINS, finite
from barbalat.certificates.quantities import Quantity
from barbalat.linear.interconnections import complementary_sensitivity, sensitivity
from barbalat.linear.margins import margins
from barbalat.linear.peaks import peak_gain
from barbalat.problem.tracking import TrackingProblem
from barbalat.validate import InputError

OF_SAMPLED_LOOPS = {"spectral_radius": Quantity("of the closed loop from sample to sample: stable below 1")}
OF_THE_LOOP = "from sample to sample with the true parameters, broken at the plant input"


def name_of(problem: TrackingProblem) -> str:
    """The loop of the certificate's exact values."""
    beside = f", beside its delay of {problem.delay:g} s" if problem.delay > 0 else ""
    lag = problem.sensor.lag if problem.sensor is not None else 0.0
    lagged = f", with its sensor's lag of {lag:g} s" if lag > 0 else ""
    return OF_THE_LOOP + beside + lagged + ("" if all(path.is_linear for path in problem.plant.paths) else ", without its limits")


def add_margins(draft: Draft, problem: TrackingProblem, found: Linearised, linear: str) -> None:
    """Of the loop with its delay in it; the delay margin is what it bears beside. ``linear`` says what makes it a linear one."""
    loop, name = found.loop, name_of(problem)
    try:
        delay = loop.delay_margin(problem.delay)
    except InputError as error:
        draft.missing("delay_margin", str(error))
    else:
        draft.exact({"delay_margin": finite(delay)}, name, linear)
    draft.advise({"margins_of": f"the linear loop {name}"})
    if len(problem.plant.paths) > 1:
        draft.note("gain and phase margins are those of one input; the delay margin is of one delay in all inputs")
        return
    L = loop.as_continuous(problem.delay)
    try:
        of_L = margins(L)
    except InputError as error:
        draft.note(f"linear loop {name}: {error}")
        return
    values = {key: finite(getattr(of_L, one)) for one, key in KEYS_OF_MARGINS.items() if one != "delay"}
    peaks = {"sensitivity_peak": sensitivity, "complementary_sensitivity_peak": complementary_sensitivity}
    draft.exact(values | {key: peak_gain(of(L)).gain for key, of in peaks.items()}, name, linear)
