"""Problems that many tests share."""

from __future__ import annotations

import pytest

from barbalat.problem.state_feedback import ParameterBox, Plant, Problem, ReferenceModel
from barbalat.signals import Sine, Sines


def _section_v() -> Problem:
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[4.0, -3.0], x0=[1.0, 1.0]),
        reference_model=ReferenceModel(k_0=4.0),
        reference=Sine(amplitude=50.0, frequency=0.5),
        uncertainty=ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]),
        name="Section V",
    )


def _first_order() -> Problem:
    return Problem(
        plant=Plant(A_m=[[-1.0]], b=[2.0], theta=[1.5], x0=[0.5]),
        reference_model=ReferenceModel(k_0=0.5),
        reference=Sine(amplitude=2.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-3.0], upper=[3.0]),
        name="first order",
    )


def _second_order() -> Problem:
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5], x0=[0.5, -0.5]),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=2.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]),
        name="second order",
    )


def _third_order() -> Problem:
    return Problem(
        plant=Plant(
            A_m=[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -11.0, -6.0]],  # poles -1, -2, -3
            b=[0.0, 0.0, 1.0],
            theta=[1.0, -1.0, 0.5],
            x0=[0.3, 0.0, -0.2],
        ),
        reference_model=ReferenceModel(k_0=6.0),
        reference=Sines(amplitudes=(1.0, 1.0), frequencies=(0.7, 2.3)),
        uncertainty=ParameterBox(lower=[-2.0, -2.0, -2.0], upper=[2.0, 2.0, 2.0]),
        name="third order",
    )


@pytest.fixture(scope="session")
def section_v() -> Problem:
    """Equations.md, section 9."""
    return _section_v()


@pytest.fixture(scope="session")
def first_order() -> Problem:
    return _first_order()


@pytest.fixture(scope="session")
def third_order() -> Problem:
    return _third_order()


@pytest.fixture(scope="session")
def problems() -> dict[int, Problem]:
    """One gentle problem for each order; all numbers of the order of one, so that absolute errors mean something."""
    return {1: _first_order(), 2: _second_order(), 3: _third_order()}
