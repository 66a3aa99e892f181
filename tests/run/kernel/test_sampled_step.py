"""The controller by itself, compared with the simulation and the exported C."""

import numpy as np
import pytest

from barbalat import (
    InputError,
    L1Adaptive,
    L1PiecewiseConstant,
    Mrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Sampled,
    Simulation,
    input_filter,
)
from barbalat.export.layout import Layout
from barbalat.run.engine.simulate import recorded
from barbalat.run.kernel.sampled_controller import SampledList, SampledStep, controller_program
from barbalat.signals import Sine

PROBLEM = Problem(
    plant=Plant(A_m=[[0, 1], [-4, -3]], b=[0, 2], theta=[1, -0.5], x0=[0.2, 0]),
    reference_model=ReferenceModel(k_0=2),
    reference=Sine(amplitude=1, frequency=2),
    uncertainty=ParameterBox(lower=[-2, -2], upper=[2, 2]),
)
CONTROLLERS = (
    Sampled(Mrac(gamma=20), 0.01),
    Sampled(L1Adaptive(gamma=100, filter=input_filter(kappa=0.1)), 0.01),
    L1PiecewiseConstant(sample_time=0.01, filter=input_filter(kappa=0.1)),
)


@pytest.mark.parametrize("controller", CONTROLLERS, ids=lambda one: one.name)
def test_sample_by_sample_it_is_the_simulated_one_in_every_bit(controller):
    expected = recorded(PROBLEM, controller, Simulation(t_end=2, dt=1e-3), 200)
    step, loop = SampledStep(SampledList.of(PROBLEM, controller)), expected.loop
    kept = Layout.of(controller_program(loop), loop).rows  # the part of the state that an export keeps
    for _ in range(2):  # a reset leaves nothing behind
        for y, r, state in zip(expected.measured, expected.commands, expected.states, strict=True):
            u = step(y, r)
            np.testing.assert_array_equal(step.state[kept], state[kept])
            assert u == state[loop.unpack(np.arange(loop.size)).held.u - loop.size]  # counted from the end
        step.reset()


def test_a_continuous_controller_is_refused():
    with pytest.raises(InputError, match="MRAC is continuous"):
        SampledList.of(PROBLEM, Mrac(gamma=20))
