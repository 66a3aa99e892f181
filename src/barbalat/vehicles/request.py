"""What somebody asks to be flown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from barbalat.protocols import Controller
from barbalat.run.progress import Progress
from barbalat.run.stepwise import Maker
from barbalat.vehicles.f16.airframe import FlightCondition
from barbalat.vehicles.f16.equipment import Equipment


@dataclass(frozen=True, eq=False, kw_only=True)
class Request:
    """The arguments of ``fly``, which says what they mean."""

    name: str
    schemes: Sequence[str] | None = None
    controllers: Sequence[Controller] = ()
    failures: Sequence[str] | None = None
    condition: FlightCondition | None = None
    equipment: Equipment | None = None
    delays: bool = False
    software_in_the_loop: Maker | None = None
    progress: Progress | None = None
