"""The elevator and the sensors, compared with their exact responses."""

import numpy as np
import pytest

from barbalat.vehicles.f16.equipment import Actuator, Equipment, Sensors

STEP = 1 / 400


def test_a_small_step_arrives_after_the_delay_and_follows_the_lag_exactly():
    equipment = Equipment(actuator_lag=0.05, transport_delay=0.02)
    elevator = Actuator(equipment, STEP, start=-1.0)
    found = [elevator.advance(0.5) for _ in range(200)]
    t = STEP * np.arange(1, 201)
    expected = -1 + 1.5 * -np.expm1(-np.clip(t - 0.02, 0, None) / 0.05)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)  # rounding


def test_it_moves_no_faster_and_no_further_than_it_can():
    elevator = Actuator(Equipment(rate_limit=60, limit=25), STEP, start=0.0)
    found = np.array([0.0, *(elevator.advance(1e3) for _ in range(400))])
    assert np.diff(found).max() == pytest.approx(60 * STEP)
    assert 24.9 < found[-1] <= 25


def test_a_longer_delay_holds_what_arrived_and_loses_nothing():
    equipment = Equipment(actuator_lag=1e-9, rate_limit=1e9, transport_delay=2 * STEP)  # the deflection equals the input
    elevator = Actuator(equipment, STEP, start=0.0)
    sent = [0.1 * k for k in range(12)]
    found = []
    for k, command in enumerate(sent):
        if k == 4:
            elevator.delay_more(3 * STEP)
        found.append(elevator.advance(command))
    assert found[:4] == pytest.approx([0.0, 0.0, *sent[:2]])
    assert found[4:7] == pytest.approx([sent[2]] * 3)
    assert found[7:] == pytest.approx(sent[2:7])


def test_sensors_lag_by_their_time_constant():
    sensors = Sensors(Equipment(sensor_lag=0.02), STEP)
    for _ in range(8):  # 0.02 s
        found = sensors.advance(np.array([1.0, -2.0]))
    np.testing.assert_allclose(found, -np.expm1(-1.0) * np.array([1.0, -2.0]), rtol=1e-12)


def test_a_runaway_goes_nose_up_at_its_rate_to_the_limit_and_then_follows_again():
    elevator = Actuator(Equipment(rate_limit=60, limit=25), STEP, start=5.0)
    elevator.run_away(0.2)
    found = [elevator.advance(5.0) for _ in range(400)]
    assert found[79] == pytest.approx(5 - 0.2 * 60)
    assert found[-1] == pytest.approx(5, abs=1e-3)
    elevator.run_away(2.0)
    assert min(elevator.advance(5.0) for _ in range(400)) == -25
