"""``_set`` accepts the same values as the case: random values of one, two and three numbers, for all parameters."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, ParameterBox, RobustMrac, Sampled, Simulation
from barbalat.cases.load import bundled, load_case
from barbalat.controllers.windup import ModifiedError
from barbalat.export.acceptance import Norm, Order
from barbalat.export.c99.files import made_of
from barbalat.export.parameters import Opened, _explicit_estimates
from barbalat.export.texts import Printed
from barbalat.laws import LeastSquaresBounded
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.lowering.c99 import DOUBLE, FLOAT
from barbalat.open_numbers.varied import VariedObjects
from barbalat.validate import InputError
from export.examples import SIMULATION, STATE, sampled_examples
from export.targets import needs_gcc
from export.test_baseline_fallback import RUN, SCHEMES
from export.test_baseline_fallback import problem as problem_with_baseline
from export.test_settable import loaded

BOUNDED = LeastSquaresBounded(covariance0=5.0, forgetting=0.2, covariance_bound=20.0)
OWN = {
    "modified error": (STATE, Sampled(Mrac(gamma=2.0, modified_error=ModifiedError(mu=1.0)), 0.01)),
    "one bound is 0": (
        replace(STATE, uncertainty=ParameterBox(lower=[-2.0, 0.0], upper=[2.0, 1.0])),
        Sampled(Mrac(gamma=2.0, theta_hat0=[0.6, 0.25]), 0.01),
    ),
    "covariance": (STATE, Sampled(RobustMrac(tau=0.1, law=BOUNDED), 0.01)),
    "covariance by numbers": (
        STATE,
        Sampled(RobustMrac(tau=0.1, law=replace(BOUNDED, covariance0=np.array([5.0, 3.0]))), 0.01),
    ),
    **{f"baseline {kind}": (problem_with_baseline(kind), SCHEMES["mrac"]) for kind in ("lqi", "state")},
}
EXAMPLES = {name: (problem, controller, SIMULATION) for name, problem, controller in sampled_examples()}
EXAMPLES |= {name: (problem, controller, RUN) for name, (problem, controller) in OWN.items()}
KINDS = (
    *OWN,
    "Mrac-gain-midpoint-42",
    "NormalizedMrac-ball-midpoint-82",
    "MracOutput-output-midpoint-73",
    "Adrc-state-midpoint-67",
)
DRAWS = 60


class CaseOf:
    """The values that the case itself accepts, and random numbers for it."""

    def __init__(self, opened: Opened, problem, controller, simulation) -> None:
        self.paths = tuple(one.path for one in opened.parameters)
        self.values = np.array([one.value for one in opened.parameters])
        self.case = VariedObjects.around(problem, _explicit_estimates(problem, controller), simulation).case

    def accepts(self, values: np.ndarray) -> bool:
        moved = np.flatnonzero(values != self.values)
        try:
            other = VariedObjects(self.case, tuple(self.paths[i] for i in moved)).at(values[moved])
            ClosedLoop.of(other.problem, other.controllers[0]).initial()
        except InputError:
            return False
        return True

    def drawn(self, random: np.random.Generator, i: int, others: np.ndarray) -> float:
        """A random new value of a number: near or far, with the other sign, a special value, or the value of a different
        number."""
        own = self.values[i] or random.choice([0.1, 1.0])
        kinds = (
            own * 10.0 ** random.uniform(-1, 1),
            own * random.uniform(-3, 3),
            random.choice([0.0, 0.6, 1.0, -1.0, 50.0, 1000.0]),
            float(random.choice(others)),
            float(random.choice(others)) * random.uniform(0.8, 1.2),
        )
        return float(kinds[random.integers(len(kinds))])

    def listed(self, i: int) -> list[int]:
        """The numbers of the list that begins with this number; empty if no list begins with it."""
        *parent, last = self.paths[i].keys
        return [
            j for j, one in enumerate(self.paths) if last == 0 and isinstance(one.keys[-1], int) and [*one.keys[:-1]] == parent
        ]

    def neighbours(self, i: int) -> list[int]:
        """The following numbers of the same kind in the case."""
        return [j for j in range(len(self.paths)) if j != i and self.paths[j].keys[0] == self.paths[i].keys[0]] or [i]


def on_a_sphere(conditions, values: np.ndarray) -> bool:
    """Whether the numbers are so close to a norm's largest value that rounding decides on which side they are."""
    norms = [one for one in conditions if isinstance(one, Norm)]
    near = [replace(one, weight=one.weight * factor).holds(values) for one in norms for factor in (1 - 1e-9, 1 + 1e-9)]
    return any(a != b for a, b in zip(near[::2], near[1::2], strict=True))


def disagreements(problem, controller, simulation, draws: int) -> tuple[list[dict[str, float]], int, int]:
    """Random values that only one of the two accepts, and the numbers of values that both accept and that both reject."""
    problem = problem.nominal
    opened = Opened.of(problem, controller, simulation, tunable=True)
    case, random = CaseOf(opened, problem, controller, simulation), np.random.default_rng(5)
    found, counts = [], [0, 0]
    lists = [whole for i in range(len(case.paths)) if len(whole := case.listed(i)) > 1]
    for k in range(draws + len(lists) if len(case.paths) else 0):
        values = case.values.copy()
        first = k % len(values)
        several = lists[k - draws] if k >= draws else [first, *random.choice(case.neighbours(first), random.integers(0, 3))]
        for i in several:
            values[i] = 0.0 if k >= draws else case.drawn(random, i, values)
        told, accepts = all(one.holds(values) for one in opened.conditions), case.accepts(values)
        counts[accepts] += 1
        if told != accepts and not on_a_sphere(opened.conditions, values):
            found.append({opened.parameters[i].name: values[i] for i in several} | {"accepted": accepts})
    return found, *counts


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.short(kept=lambda name: name in KINDS)
def test_the_conditions_are_those_of_the_case(name) -> None:
    found, refused, accepted = disagreements(*EXAMPLES[name], DRAWS)
    assert not found
    assert refused and accepted


SAMPLED = [
    (name, controller.name)
    for name in bundled()
    for controller in load_case(name).controllers
    if isinstance(controller, Sampled) or getattr(controller, "sample_time", None) is not None
]


@pytest.mark.parametrize(("case", "name"), SAMPLED)
@pytest.mark.short(kept=lambda case, name: name == "L1" and case != "flexible-joint")
def test_the_conditions_are_those_of_a_bundled_case(case, name) -> None:
    loaded_case = load_case(case)
    controller = next(one for one in loaded_case.controllers if one.name == name)
    assert not disagreements(loaded_case.problem, controller, loaded_case.simulation, DRAWS)[0]


WALK = """\
#include "controller.h"

void walk(int count, const int *which, const double *value, int *taken)
{{
    static {name}_controller c;
    {name}_init(&c);
    for (int k = 0; k < count; ++k) {{
        taken[k] = {name}_set(&c, which[k], ({real})value[k], 0L) == {macro}_OK;
    }}
}}
"""


@needs_gcc
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("real", [DOUBLE, FLOAT], ids=["double", "float"])
@pytest.mark.short(kept=lambda name, real: real is DOUBLE and name in ("modified error", "covariance"))
def test_c_accepts_in_a_walk_what_the_case_accepts(name, real, tmp_path) -> None:
    """Numbers are set one after another. An accepted number stays, so the next one is checked against it."""
    problem, controller, simulation = EXAMPLES[name]
    simulation = replace(simulation, t_end=2.0) if isinstance(simulation, Simulation) else simulation
    contents = made_of(problem, controller, simulation, real, parameters=True)
    made, random = Printed(contents), np.random.default_rng(6)
    places = [contents.opened.parameters.index(one) for one in contents.parameters]
    case = CaseOf(contents.opened, problem.nominal, controller, simulation)
    values, which, value, expected = case.values.copy(), [], [], []
    for k in range(4 * DRAWS):
        i = k % len(places)
        there = values.copy()
        there[places[i]] = float(real.numbers(case.drawn(random, places[i], values)))
        if abs(there[places[i]]) > contents.parameter_range or on_a_sphere(contents.opened.conditions, there):
            continue
        which, value, expected = [*which, i], [*value, there[places[i]]], [*expected, case.accepts(there)]
        values = there if expected[-1] else values
    taken = np.zeros(len(which), np.int32)
    arrays = (np.array(which, np.int32), np.array(value), taken)
    loaded(tmp_path, made, WALK, real=real.name).walk(len(which), *(ctypes.c_void_p(one.ctypes.data) for one in arrays))
    wrong = [(contents.parameters[which[k]].name, value[k], told) for k, told in enumerate(expected) if taken[k] != told]
    assert not wrong
    assert 0 < sum(expected) < len(expected)


def test_equal_numbers_are_no_relation() -> None:
    """The margin's bound of 1 has nothing to do with mu = 1, and a bound at 0 need not be positive."""
    found = {name: Opened.of(*EXAMPLES[name], tunable=True) for name in ("modified error", "one bound is 0", "covariance")}
    names = {name: [one.path.keys[-1] for one in opened.parameters] for name, opened in found.items()}
    margin = names["modified error"].index("margin")
    about = [one for one in found["modified error"].conditions if margin in one.entries and isinstance(one, Order)]
    assert set(about) == {Order(0.0, margin, strict=False), Order(margin, 1.0, strict=True)}
    opened = found["one bound is 0"]
    lower = [one.name for one in opened.parameters].index("uncertainty.lower[1]")
    upper = [one.name for one in opened.parameters].index("uncertainty.upper[1]")
    assert not [one for one in opened.conditions if 0.0 in one.entries and {lower, upper} & set(one.entries)]
    assert any(isinstance(one, Norm) and one.weight == 2.0 for one in found["covariance"].conditions)
