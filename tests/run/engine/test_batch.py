"""A kernel with dt, the delay's weights and the sampling counts as arguments, compared with kernels in which these values are
compiled in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from barbalat import InputError
from barbalat.controllers import L1Adaptive, Mrac, Sampled
from barbalat.linear.systems import input_filter
from barbalat.lowering.llvm.machine import Kernel
from barbalat.lowering.operations import read
from barbalat.lowering.shape import LoopShape
from barbalat.problem.actuation import PlantInput
from barbalat.problem.measurement import Noise, Sensor
from barbalat.run.engine.engine import Batch, run
from barbalat.run.engine.ensemble import simulate_ensemble
from barbalat.run.engine.simulate import simulate
from barbalat.solvers.simulation import Simulation

STEPS = (2.0**-7, 2.0**-8)
SAMPLE_TIME = 2.0**-5
NOISE = Sensor(noise=Noise(std=0.01, sample_time=SAMPLE_TIME, seed=3))


def cases(problem):
    """By name, members that differ in a gain, for everything that a step can contain."""
    law = [L1Adaptive(gamma=gamma, filter=input_filter(0.1), name="c") for gamma in (1.0, 2.0, 3.0)]
    sampled = [Sampled(controller=controller, sample_time=SAMPLE_TIME) for controller in law]

    def with_input(**path):
        return replace(problem, plant=replace(problem.plant, input=PlantInput(**path)))

    delays = [with_input(delay=delay) for delay in (0.03, 0.05, 0.0611)]
    return {
        "plain": [(problem, controller) for controller in law],
        "one member": [(problem, law[0])],
        "sampled": [(problem, controller) for controller in sampled],
        "noisy": [(replace(problem, sensor=NOISE), controller) for controller in law],
        "limited rate": [(with_input(rate_limit=0.5), controller) for controller in law],
        "delayed": list(zip(delays, law, strict=True)),
        "all": [(replace(with_input(rate_limit=0.5, delay=0.05), sensor=NOISE), controller) for controller in sampled],
    }


def made(members, simulation, *, adjustable):
    batch = Batch.of(members, simulation, adjustable=adjustable)
    run([batch], members[0][0].signals, simulation)
    return batch


@pytest.mark.parametrize("name", ["plain", "one member", "sampled", "noisy", "limited rate", "delayed", "all"])
def test_one_kernel_for_two_steps(problems, name):
    """The tolerance 1e-10 is for roundings of sums in a different order in 512 steps of loops that do not amplify."""
    members, kernels = cases(problems[2])[name], []
    for dt in STEPS:
        simulation = Simulation(t_end=4.0, dt=dt)
        fixed, adjustable = (made(members, simulation, adjustable=choice) for choice in (False, True))
        np.testing.assert_allclose(adjustable.final_states, fixed.final_states, rtol=1e-10, atol=1e-10)
        one, other = (batch.metrics(simulation) for batch in (adjustable, fixed))
        np.testing.assert_allclose(one.max_abs_e, other.max_abs_e, rtol=1e-10)
        kernels.append(adjustable.groups[0].kernel)
    assert kernels[0] is kernels[1]


def test_a_count_is_given_where_it_is_open_and_nowhere_else():
    import casadi as ca

    x, n = ca.SX.sym("x"), ca.SX.sym("n")
    nothing = ca.SX(0, 1)
    step = read(ca.Function("step", [x, nothing, nothing, nothing, nothing, n], [x + n, nothing, nothing]))
    noise, out = np.arange(8.0), np.empty((1, 1, 1))
    arrays = (np.zeros(0), np.zeros(0), out)
    for hold, given, expected in ((None, 2, 2 * (0 + 1 + 2 + 3)), (4, None, 4 * (0 + 1)), (4, 4, 4 * (0 + 1))):
        kernel, state = Kernel(step, LoopShape(1, 0, 0, 0, noise=1, noise_hold=hold), (), 1), np.zeros(1)
        kernel(1, 8, state, *arrays, noise=noise, noise_hold=given)
        assert state[0] == expected
    for hold, given in ((None, None), (None, 0), (4, 2)):
        kernel = Kernel(step, LoopShape(1, 0, 0, 0, noise=1, noise_hold=hold), (), 1)
        with pytest.raises(ValueError, match="noise_hold"):
            kernel(1, 8, np.zeros(1), *arrays, noise=noise, noise_hold=given)


@pytest.mark.parametrize("count", [2**63, 2**64 + 4096, 10**80, -1])
@pytest.mark.parametrize("name", ["noise_hold", "sample_every"])
def test_a_count_that_machine_code_would_cut_is_refused(name, count):
    """2**64 + 4096 truncated to 64 bits is 4096: uninitialised rows of noise would be read."""
    with pytest.raises(ValueError, match=name):
        LoopShape(1, 0, 0, 0, noise=1, **{name: count})
    import casadi as ca

    x, n, nothing = ca.SX.sym("x"), ca.SX.sym("n"), ca.SX(0, 1)
    step = read(ca.Function("step", [x, nothing, nothing, nothing, nothing, n], [x + n, nothing, nothing]))
    kernel = Kernel(step, LoopShape(1, 0, 0, 0, noise=1, noise_hold=None), (), 1)
    with pytest.raises(ValueError, match="noise_hold"):
        kernel(1, 8, np.zeros(1), np.zeros(0), np.zeros(0), np.empty((1, 1, 1)), noise=np.zeros(8), noise_hold=count)


@pytest.mark.parametrize("time", [2.0**-7 * (2**63 + 4096), 2.0**-7 * (2**64 + 4096), 1e200, 4.5])
def test_a_sample_time_beyond_the_run_is_refused(problems, time):
    """The event would never occur; 2**64 + 4096 steps truncated to 64 bits would be 4096."""
    simulation, controller = Simulation(t_end=4.0, dt=2.0**-7), Mrac(gamma=1.0)
    noisy = replace(problems[2], sensor=Sensor(noise=Noise(std=0.1, sample_time=time)))
    for problem, chosen in ((noisy, controller), (problems[2], Sampled(controller=controller, sample_time=time))):
        for attempt in (
            lambda p=problem, c=chosen: simulate(p, [c], simulation),
            lambda p=problem, c=chosen: simulate_ensemble([(p, c)] * 2, simulation),
        ):
            with pytest.raises(InputError, match="sample_time must not exceed"):
                attempt()


def test_members_of_two_structures_are_refused(problems):
    simulation = Simulation(t_end=1.0, dt=2.0**-7)
    with pytest.raises(InputError, match="member 2 differs"):
        Batch.of([(problems[2], Mrac(gamma=1.0)), (problems[2], Mrac(gamma=1.0, projection=False))], simulation)
    two_times = [(problems[2], Sampled(controller=Mrac(gamma=1.0), sample_time=T)) for T in (2.0**-5, 2.0**-4)]
    with pytest.raises(InputError, match="the controller's sample time"):
        Batch.of(two_times, simulation)


def test_recorded_blocks_of_members_that_stop_at_different_times(problems):
    """There is one lane for each member. Instants after divergence are NaN, and the other member is complete."""
    members = [(problems[2], Mrac(gamma=gamma, projection=False)) for gamma in (1e9, 1.0)]
    simulation = Simulation(t_end=2.0**12, dt=2.0**-3)
    batch = Batch.of(members, simulation, record=True, lanes=1)
    run([batch], problems[2].signals, simulation)
    blocks = batch.blocks(simulation)
    assert np.isfinite(batch.diverged_step).tolist() == [True, False]
    assert blocks.starts[0] == 0 and (np.diff(blocks.starts) == blocks.lengths[:-1]).all()
    assert blocks.starts[-1] + blocks.lengths[-1] == simulation.steps
    assert np.isfinite(blocks.states[:, :, 1]).all() and np.isnan(blocks.states[-1, :, 0]).all()
    largest = np.maximum(-blocks.figure("e", "min"), blocks.figure("e", "max"))[:, :, 1].max(axis=0)
    assert (batch.metrics(simulation).max_abs_e[1] >= largest).all()


def test_a_step_is_traced_once_for_all_that_it_depends_on(problems):
    """Other arguments of the kernel use the same program. A different constant, step or option, or a user-defined class, has a
    separate program."""

    def program(members, dt=STEPS[0], **how):
        return Batch.of(members, Simulation(t_end=4.0, dt=dt, **how)).program

    members, problem, other = cases(problems[2])["delayed"], problems[2], problems[3]
    first = program(members)
    assert program(members[::-1]) is first  # the same numbers differ
    assert program([(one, Mrac(gamma=2.0)) for one, _ in members]) is not first
    assert program(members, dt=STEPS[1]) is not first and program(members, fused=False) is not first
    assert program([(problem, Mrac(gamma=2.0))]) is program([(replace(problem), Mrac(gamma=2.0, name="another"))])
    constant = replace(problem, plant=replace(problem.plant, theta=2 * problem.plant.theta))
    assert program([(problem, Mrac(gamma=2.0))]) is not program([(constant, Mrac(gamma=2.0))])
    assert program([(other, Mrac(gamma=2.0))]) is not program([(problem, Mrac(gamma=2.0))])

    class Own(type(Mrac(1.0).bind(problem.known))):
        """A class from outside the package."""

    class Controller:
        name = "own"

        def bind(self, known):
            given = vars(Mrac(gamma=2.0).bind(known))
            return Own(**given)

    assert program([(problem, Controller())]) is not program([(problem, Controller())])
