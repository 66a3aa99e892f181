"""The scaling of the states in sets derived from ranges of parameters: the largest motions of the model, or the judge's bands."""

from __future__ import annotations

import numpy as np
from scipy.signal import lsim

from barbalat import Plant, ReferenceModel
from barbalat.cases.physical_tables import scale_of_states
from barbalat.judge.settings import Judge
from barbalat.signals import Constant, Square

A, A_m, b = np.array([[0.0, 1.0], [0.0, -2.0]]), np.array([[0.0, 1.0], [-9.0, -1.2]]), np.array([0.0, 5.0])
COMMAND = Square(amplitude=2.0, frequency=0.5)


def test_without_bands_it_is_the_largest_motion_of_the_model():
    scale, said = scale_of_states(Plant(A=A, b=b, A_m=A_m), ReferenceModel(k_0=1.8), COMMAND, None, Judge(), 30.0)
    t = np.linspace(0, 30, 30001)
    r = 2.0 * np.sign(np.sin(0.5 * t))
    _, _, x = lsim((A_m, (1.8 * b)[:, None], np.eye(2), np.zeros((2, 1))), r, t)
    np.testing.assert_allclose(scale, np.abs(x).max(axis=0), rtol=0.02)
    assert said == "the largest motions of the reference model"


def test_bands_of_all_states_come_first_and_a_resting_state_has_1():
    judge = Judge(follows={"x_1": 0.1, "x_2": 0.7})
    scale, said = scale_of_states(Plant(A=A, b=b, A_m=A_m), ReferenceModel(k_0=1.8), COMMAND, None, judge, 30.0)
    assert scale.tolist() == [0.1, 0.7] and said == "the bands of judge.follows"
    scale, said = scale_of_states(Plant(A=A, b=b, A_m=A_m), ReferenceModel(k_0=1.8), Constant(0.0), None, Judge(), 30.0)
    assert scale.tolist() == [1.0, 1.0] and said.endswith("or 1 for states that it does not move")
