"""Problems of users of the piecewise-constant law, with its exported C on the F-16: wrong trim, a wrong sample time, mode
changes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("jsbsim", reason="the extra flight is not installed: ./dev flight installs it")

from barbalat import L1PiecewiseConstant, input_filter
from barbalat.exports import exported_c
from barbalat.flights import FlightCondition
from barbalat.laws import AsFlown
from barbalat.run.kernel.sampled_controller import Agreement, SampledList
from barbalat.vehicles.f16.airframe import DEGREES
from barbalat.vehicles.f16.axis import PITCH, SAMPLE_TIME, Axis
from barbalat.vehicles.f16.failures import OF_PITCH
from barbalat.vehicles.f16.flying import fly_once
from barbalat.vehicles.f16.schemes import TUNED
from barbalat.vehicles.f16.trim import trimmed
from barbalat.vehicles.flight import Timing
from export.engaged import Engaged
from export.targets import needs_gcc
from vehicles.nominal import of_axis

FAILURES = {one.name: one for one in OF_PITCH}
pytestmark = [pytest.mark.full, needs_gcc]  # ./dev flight runs them; each starts a simulator and a compiler


@pytest.fixture(scope="module")
def axis():
    return Axis(trim=trimmed(FlightCondition()))


TRIM_OFF = 0.2
"""Trim error [deg] of the elevator, so small that the aircraft stays linear."""


def test_of_a_trim_that_is_off_the_law_leaves_what_its_dc_gain_says(axis):
    """The remaining fraction of the error under feedback is 1 - B^-1 e^(A_m T) B in the exact form and 1 - e^(aT) as flown, which
    are 3 % and 5 % at 100 Hz."""
    off = Axis(trim=replace(axis.trim, elevator=axis.trim.elevator + TRIM_OFF / DEGREES), followed=replace(PITCH, commanded=0.0))
    rate = {}
    for name in ("lqr", "l1-piecewise", "l1-piecewise-flown"):
        step = exported_c(*of_axis(off, name)).step()
        found = fly_once(off, step, FAILURES["none"], timing=Timing(duration=5.0, fails_at=3.0))
        assert found.agreement == Agreement(samples=500)
        rate[name] = found.column("q")[-1]
    _, b = axis.model
    B = np.column_stack([b, [-b[1], b[0]]])
    exact = 1 - np.linalg.solve(B, expm(axis.A_m * SAMPLE_TIME) @ B)[0, 0]
    flown = -np.expm1(AsFlown().predictor_poles * SAMPLE_TIME)
    assert rate["l1-piecewise"] == pytest.approx(exact * rate["lqr"], rel=0.05)  # the phugoid and gravity are not in the model
    assert rate["l1-piecewise-flown"] == pytest.approx(flown * rate["lqr"], rel=0.05)


def test_told_that_it_runs_twice_as_fast_the_law_shakes_the_surface(axis):
    """As flown, with half of T assumed, a direct estimate is twice as large. With a filter of 30 rad/s it uses the whole rate
    limit."""
    travel = {}
    for assumed in (SAMPLE_TIME, SAMPLE_TIME / 2):
        flown = AsFlown(nominal=axis.gain, assumed_sample_time=assumed)
        law = L1PiecewiseConstant(sample_time=SAMPLE_TIME, filter=input_filter(1 / 30), as_flown=flown, saturated_predictor=True)
        step = exported_c(axis.linear_problem, law).step()
        found = fly_once(axis, step, FAILURES["none"], timing=Timing(duration=12.0, fails_at=3.0))
        assert found.agreement.equal
        travel[assumed] = found.figures["elevator_travel"] / axis.equipment.rate_limit
    assert travel[SAMPLE_TIME] < 0.25
    assert travel[SAMPLE_TIME / 2] > 0.8


ENABLED_AT = 6.0
"""Instant of the start [s]. The centre of gravity is aft from 3 s on, and by then the aircraft has drifted away from trim under
feedback alone."""


class EnabledInFlight:
    """Feedback alone flies, then the law's C takes over control, with a start or only by calls."""

    name = "enabled in flight"

    def __init__(self, axis, *, started):
        feedback, (problem, law) = of_axis(axis, "lqr"), of_axis(axis, "l1-piecewise")
        self.by_feedback, self.law, self.started = SampledList.of(*feedback).step(), Engaged(problem, law), started

    def reset(self):
        self.k, self.u, self.sigma_hat = 0, 0.0, []

    def __call__(self, y, r):
        k, self.k = self.k, self.k + 1
        if k < round(ENABLED_AT / SAMPLE_TIME):
            (self.u,) = self.by_feedback(y, r)
            if k < 100:
                self.law(y, r)  # it was on for a second and was then disabled
        else:
            if self.started and k == round(ENABLED_AT / SAMPLE_TIME):
                self.law.enable(y, self.u, 100, keep=False)
            self.u, *sigma_hat = self.law(y, r)
            self.sigma_hat.append(sigma_hat)
        return np.array([self.u])

    def agreement(self):
        return None


def test_enabled_in_flight_the_law_takes_over_without_a_kick_where_it_is_started(axis):
    """The F-16 has drifted. A law that is only called again takes five seconds of motion for the disturbance in one sample."""
    moved, estimated, bandwidth = {}, {}, TUNED["f16-pitch"]["l1-piecewise"]["bandwidth"]
    entered = round(ENABLED_AT / SAMPLE_TIME)
    for started in (True, False):
        law = EnabledInFlight(axis, started=started)
        found = fly_once(axis, law, FAILURES["aft-cg"], timing=Timing(duration=8.0, fails_at=3.0))
        assert not found.lost
        moved[started] = np.diff(found.column("elevator_command")[entered - 1 : entered + 50])
        estimated[started] = np.abs(law.sigma_hat).max(axis=0)
    assert moved[True][0] == 0  # the first control is the actuator's output
    taken = bandwidth * SAMPLE_TIME * estimated[True][0]  # the filter's change by the estimate in a sample
    assert np.abs(moved[True]).max() < taken
    assert np.abs(moved[True]).max() == pytest.approx(0.3, abs=0.05)  # docs/piecewise.md says so, and what follows
    assert np.abs(moved[False]).max() == pytest.approx(2.2, abs=0.05)
    assert (estimated[False] > 5 * estimated[True]).all()
