"""Units and names of a case in its exports."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from barbalat.export.contents import Contents
from barbalat.export.fmu.base_units import base_unit
from barbalat.export.source import header
from barbalat.export.texts import Printed
from barbalat.lowering.c99 import DOUBLE
from barbalat.problem.labels import Labels
from export.examples import SIMULATION, STATE
from export.test_name import CONTROLLER


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("rad", {"rad": "1"}),
        ("deg", {"rad": "1", "factor": repr(math.pi / 180)}),
        ("rad/s", {"s": "-1", "rad": "1"}),
        ("m/s^2", {"m": "1", "s": "-2"}),
        ("N m", {"kg": "1", "m": "2", "s": "-2"}),
        ("1/s", {"s": "-1"}),
        ("%", {"factor": "0.01"}),
        ("furlong", None),
        ("g", None),  # a gram, or the load factor of an aircraft
        ("m/", None),
    ],
)
def test_base_units_are_the_sis(unit, expected) -> None:
    """By the SI brochure: N = kg m s^-2, 1 degree = pi/180 rad."""
    assert base_unit(unit) == expected


def test_the_header_has_the_cases_names_and_units() -> None:
    labelled = replace(STATE, labels=Labels(names=["alpha", "q"], units=["rad", "rad/s"], input_units=["deg"]))
    text = header(Printed(Contents.of(labelled, CONTROLLER, SIMULATION, DOUBLE)))
    assert "double x[L1_MEASURED]; /* measured state: alpha [rad], q [rad/s] */" in text
    assert "double u[L1_INPUTS]; /* control [deg] before the actuator, as simulated */" in text
