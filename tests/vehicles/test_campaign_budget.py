"""The number of draws that a campaign may have, by its flights, which several processes share."""

from types import SimpleNamespace

import pytest

from barbalat import InputError
from barbalat.studies import Budget
from barbalat.vehicles.dispersed import Campaign
from barbalat.vehicles.vehicle import Aboard


def campaign(schemes: int) -> Campaign:
    """A campaign of flights of half a second each, so a process flies 60 in half a minute."""
    vehicle = SimpleNamespace(drawing=SimpleNamespace(chunk=60))
    aboard = (tuple(Aboard(name="scheme", loops=()) for _ in range(schemes)),)
    return Campaign(vehicle=vehicle, failures=("failure",) * 5, models=(None,), aboard=aboard, plan=None)


def test_flights_are_counted_and_shared_by_processes():
    with Budget(seconds=1000.0):
        campaign(schemes=4).require(100, processes=1)  # 2000 flights
        campaign(schemes=4).require(200, processes=2)
        for schemes, processes, most in ((4, 1, 100), (4, 2, 200), (8, 2, 100)):
            with pytest.raises(InputError, match=rf"the campaign of {most + 1} draws would .*: at most {most} draws would do"):
                campaign(schemes).require(most + 1, processes)
