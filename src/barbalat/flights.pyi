from .vehicles.comparison import FlightComparison as FlightComparison
from .vehicles.f16.airframe import FlightCondition as FlightCondition
from .vehicles.f16.equipment import Equipment as Equipment
from .vehicles.flying import fly as fly
from .vehicles.isolated import SimulatorFailed as SimulatorFailed
