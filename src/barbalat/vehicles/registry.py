"""What can be flown: the vehicles of the folders here, and those of other distributions' entry points."""

from __future__ import annotations

from functools import cache
from typing import Any

from barbalat.discovery import slices
from barbalat.validate import InputError, show
from barbalat.vehicles.vehicle import Vehicle

GROUP = "barbalat.vehicles"
"""The entry points by which vehicles from outside this package are found."""


@cache
def vehicles() -> dict[str, Vehicle[Any, Any, Any]]:
    """All by the names of the command line; InputError where two have one name, or an entry point can't be imported."""
    found: dict[str, Vehicle[Any, Any, Any]] = {}
    for module in slices(__package__, GROUP, "vehicle"):
        for vehicle in module.VEHICLES:
            if vehicle.name in found:
                raise InputError(f"two vehicles are called {vehicle.name!r}, the second in {module.__name__}")
            found[vehicle.name] = vehicle
    return found


def vehicle_of(name: str) -> Vehicle[Any, Any, Any]:
    """InputError for a name that is none."""
    if name not in vehicles():
        raise InputError(f"NAME must be one of {', '.join(vehicles())}, got {show(name)}")
    return vehicles()[name]
