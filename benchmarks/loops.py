"""The two loops of Section V of the paper that the benchmarks run singly and as an ensemble."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from barbalat import L1Adaptive, ParameterBox, Plant, Problem, ReferenceModel, RobustMrac, Simulation, input_filter
from barbalat.controllers.l1 import Equations
from barbalat.laws import LeastSquares
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.loop.packing import symbols
from barbalat.lowering.operations import Program, read
from barbalat.problem.known_set import Gain
from barbalat.protocols import Controller
from barbalat.run.kernel.grid import signal_table
from barbalat.run.kernel.step import StepProgram, step_function, step_program
from barbalat.signals import Sine
from barbalat.solvers import RK4

STEP = 1e-4
"""Step in Section V, Figs. 2 and 3 [s]."""

PROBLEM = Problem(
    plant=Plant(A_m=[[0, 1], [-0.3, -1]], b=[0, 1], theta=[4, -3], x0=[1, 1]),
    reference_model=ReferenceModel(k_0=4.0),
    reference=Sine(amplitude=50, frequency=0.5),
    uncertainty=ParameterBox(lower=[-5, -5], upper=[5, 5]),
    name="Section V",
)


LONGEST = 50_000
"""Steps of the longest timed call. They are 5 s of the loop, in which no state comes near divergence."""


@cache
def command_table() -> np.ndarray:
    """The command at the nodes 0, 1/2 and 1 of every step, with the shape (LONGEST, 3). It is the same for every contestant."""
    return signal_table(PROBLEM.signals, Simulation(t_end=LONGEST * STEP, dt=STEP), 0, LONGEST)


@dataclass(frozen=True, eq=False)
class Case:
    """A loop and its members, with their initial states (size, M) and parameters (p, M). ``loop_of`` builds the loop with
    parameters or with symbols."""

    name: str
    controller: Controller
    states: np.ndarray
    parameters: np.ndarray
    loop_of: Callable[[Any], ClosedLoop]

    @property
    def members(self) -> int:
        return self.states.shape[1]

    @property
    def loop(self) -> ClosedLoop:
        """The loop of the first member."""
        return self.loop_of(self.parameters[:, 0])

    def optimised(self, *, figures: bool = False) -> StepProgram:
        column, values = symbols("parameters", len(self.parameters))
        return step_program(self.loop_of(values), RK4, STEP, column, figures=figures)

    def as_read(self, *, figures: bool = False) -> Program:
        """The kernel's step in CasADi's order, without the package's optimisations."""
        column, values = symbols("parameters", len(self.parameters))
        return read(step_function(self.loop_of(values), RK4, STEP, column, figures=figures)[0])


def l1(members: int = 1) -> Case:
    """The L1 loop with 9 states. An ensemble varies the adaptive gain, which is a parameter, between 5e3 and 2e4."""
    controller = L1Adaptive(gamma=1e4, filter=input_filter(0.02))
    loop = ClosedLoop.of(PROBLEM, controller)
    equations = loop.equations
    if not isinstance(equations, Equations):
        raise TypeError("this loop's gain can't be varied")
    states = np.repeat(loop.initial()[:, None], members, axis=1)
    if members == 1:
        return Case("L1, 9 states", controller, states, np.zeros((0, 1)), lambda _: loop)

    def with_gain(values: Any) -> ClosedLoop:
        return replace(loop, equations=replace(equations, gamma=Gain(values[0])))

    return Case("L1, 9 states", controller, states, np.geomspace(5e3, 2e4, members)[None], with_gain)


def robust_mrac(members: int = 1) -> Case:
    """The robust MRAC loop with 21 states. An ensemble varies the initial plant state."""
    controller = RobustMrac(c_0=[1, 1], tau=0.5, law=LeastSquares(covariance0=500))
    loop = ClosedLoop.of(PROBLEM, controller)
    states = np.repeat(loop.initial()[:, None], members, axis=1)
    states[0] += np.linspace(0, 1, members)
    return Case("robust MRAC, 21 states", controller, states, np.zeros((0, members)), lambda _: loop)


CASES = (l1, robust_mrac)
