"""Problems of users of the piecewise-constant law in flight, tested on the exported C in a loop with a plant and on the
equations.

The law is reset or started when the mode is entered, enabled after it was disabled, first sampled away from its initial state,
and limited by its actuator. The plant is written here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat import L1PiecewiseConstant, Plant, Problem, ReferenceModel, Simulation, input_filter, simulate
from barbalat.export.in_the_loop import simulate_export
from barbalat.laws import AsFlown
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.plants import PlantInput
from barbalat.run.kernel.sampled_controller import initial_acting
from barbalat.signals import Constant
from export.engaged import Engaged
from export.targets import needs_gcc

T = 0.01
"""[s], as on the flight models."""
LIMIT = 4.0
A_M, B, THETA = np.array([[0.0, 1.0], [-9.0, -4.2]]), np.array([0.0, 5.0]), np.array([0.6, -0.2])
ACTS = 1.5
"""Disturbance of the input that the law has to compensate. 2 of ``LIMIT`` remain for other motions."""
PROBLEM = Problem(
    plant=Plant(A_m=A_M, b=B, theta=THETA, input=PlantInput(saturation=[-LIMIT, LIMIT])),
    reference_model=ReferenceModel(k_0=9 / 5),
    reference=Constant(0.0),
    disturbance=Constant(ACTS),
)
SETTINGS = {"sample_time": T, "filter": input_filter(kappa=0.1), "saturated_predictor": True, "name": "law"}
LAWS = {"exact": L1PiecewiseConstant(**SETTINGS), "as flown": L1PiecewiseConstant(**SETTINGS, as_flown=AsFlown())}
pytestmark = needs_gcc


@dataclass
class Flight:
    """The plant and the C that controls it. ``x`` is the present state, and ``rows`` are u and sigma_hat of the samples so
    far."""

    law: Engaged
    x: np.ndarray
    rows: list[tuple[float, float, float]]

    @classmethod
    def of(cls, law) -> Flight:
        return cls(Engaged(PROBLEM, law), np.zeros(2), [])

    def drift(self, u: float, seconds: float) -> None:
        """Simulate with the law disabled while u is held within the limits by somebody else."""
        whole = np.zeros((3, 3))
        whole[:2, :2], whole[:2, 2] = A_M + np.outer(B, THETA), B
        self.x = (expm(seconds * whole) @ np.append(self.x, min(max(u, -LIMIT), LIMIT) + ACTS))[:2]

    def fly(self, samples: int, r: float = 0.0) -> np.ndarray:
        """Simulate with the law enabled and return u and sigma_hat (samples, 3)."""
        for _ in range(samples):
            self.rows.append(self.law(self.x, r))
            self.drift(self.rows[-1][0], T)
        return np.array(self.rows[-samples:])

    def enable(self, u_now: float, samples: int, *, keep: bool) -> None:
        self.law.enable(self.x, u_now, samples, keep=keep)

    @property
    def acting(self) -> float:
        """The disturbance at the input, computed by an observer that knows the plant."""
        return float(THETA @ self.x + ACTS)


@pytest.mark.parametrize("name", LAWS)
def test_enabled_after_disabled_it_has_no_kick_where_it_is_started_and_one_where_it_only_goes_on(name) -> None:
    """The plant moves away in 3 s of manual control. A law that has kept its old predictor takes this motion for a
    disturbance."""
    found = {}
    for started in (True, False):
        flight = Flight.of(LAWS[name])
        before = flight.fly(400)
        by_hand = before[-1, 0] + 2.0
        flight.drift(by_hand, 3.0)
        if started:
            flight.enable(by_hand, 50, keep=False)
        found[started] = flight.fly(400)
        assert abs(found[started][-1, 0] - before[-1, 0]) < 0.01  # the same equilibrium again, without any trace of the start
    first = found[True][:, 0]
    assert first[0] == pytest.approx(by_hand, abs=1e-12)  # the actuator's output
    assert np.abs(np.diff(first[:3])).max() < 0.1 * LIMIT  # 2 % of the bump at a sample, plus the filter's contribution
    assert np.abs(found[True][:, 1:]).max() < 2 * ACTS
    assert np.abs(found[False][:, 1:]).max() > 20 * ACTS


@pytest.mark.parametrize("name", LAWS)
def test_what_it_learnt_is_kept_or_not_as_it_is_asked(name) -> None:
    """If it is kept, the disturbance is known at the first sample, otherwise one sample later."""
    flight = Flight.of(LAWS[name])
    known = flight.fly(400)[-1, 1]
    flight.enable(0.0, 0, keep=True)
    assert flight.fly(1)[0, 1] == known
    flight.enable(0.0, 0, keep=False)
    first, second = flight.fly(2)
    assert (first[1:] == 0).all()
    assert second[1] == pytest.approx(
        flight.acting, rel=0.1
    )  # the mean over a sample, and the part that the law does not compensate at DC


@pytest.mark.parametrize("name", LAWS)
def test_a_reset_in_flight_is_not_a_start(name) -> None:
    """``_reset`` sets the predictor to the case's initial state x = 0. Elsewhere the law's estimate contains the distance divided
    by T."""
    away = np.array([0.3, 0.5])
    found = []
    for enter in (Flight.enable, None):
        flight = Flight.of(LAWS[name])
        flight.fly(100)
        flight.x = away
        if enter is None:
            flight.law.reset()
        else:
            enter(flight, flight.rows[-1][0], 0, keep=False)
        found.append(np.abs(flight.fly(3)[:, 1:]).max())
    assert found[0] < 2 * ACTS
    assert found[1] > 0.5 * np.linalg.norm(away) / (T * np.linalg.norm(B))


@pytest.mark.parametrize("name", LAWS)
def test_the_predictor_is_told_what_is_put_out_while_the_start_fades(name) -> None:
    """The equations in NumPy, started at the plant's state and given the C's u, produce the same estimate at every sample."""
    flight = Flight.of(LAWS[name])
    flight.fly(100)
    flight.drift(3.0, 0.5)
    loop = ClosedLoop.of(replace(PROBLEM, plant=replace(PROBLEM.plant, x0=flight.x)), LAWS[name])
    acting = initial_acting(loop)
    flight.enable(3.0, 20, keep=False)
    for k in range(60):
        x = flight.x
        ((u, *sigma_hat),) = flight.fly(1)
        acting = loop.computer.act(acting, x, np.zeros(()))
        own = float(acting.held.u)
        np.testing.assert_allclose(acting.controller.sigma_hat, sigma_hat, rtol=1e-9, atol=1e-9)  # sums in a different order
        if k == 0:
            bump = 3.0 - own
        assert u == pytest.approx(own + bump * max(20 - k, 0) / 20, abs=1e-9)
        acting = acting._replace(held=acting.held._replace(u=np.asarray(u)))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.short(kept=lambda name: name == "as flown")
def test_at_the_limit_the_estimate_stays_what_acts(name) -> None:
    """The command is three times the limit for 2 s. If the law received the unlimited u instead of the output, it would take the
    clipped part for a disturbance."""
    largest = {}
    for saturated in (True, False):
        flight = Flight.of(LAWS[name] if saturated else replace(LAWS[name], saturated_predictor=False))
        flight.fly(100)
        limited = flight.fly(200, r=3 * LIMIT)
        assert np.abs(limited[:, 0]).max() > 2 * LIMIT
        largest[saturated] = np.abs(limited[5:, 1]).max()
    assert largest[True] < ACTS + np.abs(THETA).sum() * LIMIT < largest[False]


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.short(kept=lambda name: name == "as flown")
def test_at_the_limit_the_c_is_the_simulation_in_every_bit(name) -> None:
    problem = replace(PROBLEM, reference=Constant(3 * LIMIT))
    simulation = Simulation(t_end=3.0, dt=T / 2)
    origin = simulate(problem, [LAWS[name]], simulation)["law"]
    assert origin.metrics.max_abs_u > 2 * LIMIT
    assert simulate_export(problem, LAWS[name], simulation).differs_from(origin) == ""


@pytest.mark.parametrize("name", LAWS)
def test_the_first_sample_says_nothing_wherever_the_vehicle_is(name) -> None:
    flight = Flight.of(LAWS[name])
    flight.x = np.array([2.0, -1.0])
    assert (flight.fly(1)[0] == 0).all()
