"""The exported controller is the simulated one: with the same samples, the compiled C gives the same results bit for bit."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from barbalat.controllers import SCHEMES, Sampled
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.export.contents import Contents
from barbalat.export.source import header, source
from barbalat.export.texts import Printed
from barbalat.loop.packing import flatten, unflatten
from barbalat.lowering.c99 import DOUBLE
from barbalat.run.engine.simulate import recorded
from barbalat.run.kernel.sampled_controller import initial_acting
from export.examples import LONG, OUTPUT, SIMULATION, STATE, sampled_examples, schemes_covered
from export.targets import ISO, drive, needs, needs_gcc, same_bits, write
from turns import drawn

EXAMPLES = {name: (problem, controller) for name, problem, controller in sampled_examples()}
SHORT = [name for i, name in enumerate(EXAMPLES) if i % 61 == 0 or name == "L1PiecewiseConstant-state-0"]
SAMPLES, LONG_SAMPLES = 10_000, 100_000


def kinds(name: str) -> tuple[str, ...]:
    """The class of an example: scheme, problem, form, and the kinds of law and modifications, without their numbers."""
    problem, controller = EXAMPLES[name]
    inner = controller.controller if isinstance(controller, Sampled) else controller
    fields = [getattr(controller, "discretization", ""), *(f"{key}:{type(vars(inner).get(key)).__name__}" for key in KINDS)]
    law = vars(inner).get("law")
    return type(inner).__name__, problem.name, *fields, *(f"{key}:{type(vars(law).get(key)).__name__}" for key in KINDS if law)


KINDS = ("law", "leakage", "dead_zone", "learning", "modified_error", "auxiliary", "tau")
ONE_OF_EACH = frozenset({kinds(name): name for name in reversed(EXAMPLES)}.values())
"""The first example of every combination of kinds. ``./dev test --full`` also replays those that differ only in numbers."""
MORE_OF_THEM = 24
"""Number of other examples that are replayed too, which takes half a minute on one core. Each commit draws different ones, so in
time all are tested."""

REPLAYED = {*ONE_OF_EACH, *drawn([name for name in EXAMPLES if name not in ONE_OF_EACH], MORE_OF_THEM)}


def exported(name, folder):
    problem, controller = EXAMPLES[name]
    printed = Printed(Contents.of(problem, controller, SIMULATION, DOUBLE))
    write(folder, {"controller.h": header(printed), "controller.c": source(printed)})
    return printed


def test_every_scheme_is_among_the_examples() -> None:
    assert schemes_covered() | {Sampled} >= {*SCHEMES.values(), *OUTPUT_SCHEMES.values()}


def replayed(name, folder, simulation, samples, compiler=("gcc", *ISO, "-O2")) -> None:
    """Samples measured with noise, lag, delay and limits by the simulation are passed to C: u and the estimates equal the
    simulation's."""
    printed = exported(name, folder)
    layout = printed.contents.layout
    run = recorded(*EXAMPLES[name], simulation, samples)
    assert len(run.states) == samples
    found = drive(printed, folder, run.measured, run.commands, compiler=compiler)
    assert (found.status == 0).all()
    assert same_bits(found.u, run.states[:, list(layout.u.rows)])
    assert same_bits(found.estimates, run.states[:, list(layout.theta_hat.rows)])
    assert np.ptp(found.u) > 0


@needs_gcc
@pytest.mark.parametrize("name", [pytest.param(x, marks=() if x in REPLAYED else pytest.mark.bulk) for x in EXAMPLES])
@pytest.mark.short(kept=lambda name: name in SHORT)
def test_the_simulation_replayed_in_c(name, tmp_path) -> None:
    replayed(name, tmp_path, SIMULATION, SAMPLES)


LEVELS = ("-O0", "-O1", "-O2", "-O3")
FEW = [name for i, name in enumerate(EXAMPLES) if i % 61 == 5]


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("compiler", [pytest.param(c, marks=needs(c)) for c in ("gcc", "clang")])
@pytest.mark.parametrize("name", FEW)
@pytest.mark.short(kept=lambda name, compiler, level: name == FEW[0] and level == ("-O3" if compiler == "gcc" else "-O0"))
def test_every_compiler_at_every_level(name, compiler, level, tmp_path) -> None:
    replayed(name, tmp_path, SIMULATION, SAMPLES, compiler=(compiler, *ISO, level))


OF_EACH_SCHEME = {kinds(name)[0]: name for name in reversed(EXAMPLES)}.values()
HOW = [pytest.param((compiler, *ISO, level), marks=needs(compiler)) for level in LEVELS for compiler in ("gcc", "clang")]
LONG_RUNS = [pytest.param(name, *how.values, marks=how.marks) for name, how in zip(OF_EACH_SCHEME, itertools.cycle(HOW))]


@pytest.mark.full
@pytest.mark.parametrize(("name", "compiler"), LONG_RUNS)
def test_a_hundred_thousand_samples(name, compiler, tmp_path) -> None:
    """Every scheme is tested; the tests alternate between both compilers and all levels of optimisation."""
    replayed(name, tmp_path, LONG, LONG_SAMPLES, compiler=compiler)


@needs_gcc
@pytest.mark.parametrize("name", FEW)
@pytest.mark.short(kept=lambda name: name in FEW[:2])
def test_c_against_the_equations_evaluated_on_numbers(name, tmp_path) -> None:
    """NumPy evaluates the scheme's equations sample by sample, with the freeze switch on and off, as a second computation of the
    same numbers.

    The tolerance 1e-7 is for the same sums in a different order over 400 samples with given measurements, without a closed loop.
    """
    printed = exported(name, tmp_path)
    contents = printed.contents
    run = recorded(*EXAMPLES[name], SIMULATION, 400)
    freeze = np.arange(400) // 50 % 2
    found = drive(printed, tmp_path, run.measured, run.commands, freeze)
    computer, template = contents.loop.computer, initial_acting(contents.loop)
    acting, estimates, u = template, [], []
    for y, r, frozen in zip(run.measured, run.commands, freeze, strict=True):
        command = r if contents.loop.commands else r[0]
        acting = computer.act(acting, y.reshape(template.held.measured.shape), command, np.float64(frozen))
        acting, _ = unflatten(template, np.asarray(flatten(acting), dtype=float), 0)
        estimates.append(acting.controller.theta_hat.reshape(-1))
        u.append(acting.held.u.reshape(-1))
    np.testing.assert_allclose(found.estimates, estimates, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.u, u, rtol=1e-7, atol=1e-7)
    resting = np.flatnonzero(freeze)
    assert same_bits(found.estimates[resting], found.estimates[resting - 1])


def test_the_model_from_sample_to_sample_is_the_continuous_one_under_a_held_command() -> None:
    """x_m of the controller is compared with the exact solution for a command that is held between samples."""
    from scipy.linalg import expm

    for problem, name in ((STATE, "Mrac-state-euler"), (OUTPUT, "LinearOutput-output-midpoint")):
        found = next(key for key in EXAMPLES if key.startswith(name))
        run = recorded(*EXAMPLES[found], SIMULATION, 200)
        A, B, _ = problem.model.matrices
        T = run.loop.sample_time
        x_m = np.array([run.loop.computer.initial(np.zeros(run.measured.shape[1])).held.x_m])
        rows = [unflatten(initial_acting(run.loop), state, 0)[0].held.x_m for state in run.states]
        np.testing.assert_array_equal(rows[0], x_m[0])
        steps = 64  # with this many pieces Gauss's rule gives the integral to rounding
        nodes, weights = np.polynomial.legendre.leggauss(8)
        s = (T / steps) * (np.arange(steps)[:, None] + (nodes + 1) / 2)
        integral = sum(w * T / steps / 2 * expm(A * float(t)) @ B[:, 0] for row in s for t, w in zip(row, weights, strict=True))
        for k in range(1, 200):
            np.testing.assert_allclose(
                rows[k], expm(A * T) @ rows[k - 1] + integral * run.commands[k - 1, 0], rtol=1e-12, atol=1e-14
            )
