"""The step that is flown with software in the loop: the compiled C is compared with the simulation's step sample by sample, and
the report is checked."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import (
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
from barbalat.cli import main
from barbalat.export import exported_step
from barbalat.export.compiler import require_compiler, shared_library
from barbalat.export.exported_step import exported_c
from barbalat.laws import AsFlown
from barbalat.plants import PlantInput
from barbalat.run.engine.simulate import recorded
from barbalat.run.kernel.sampled_controller import Agreement
from barbalat.signals import Constant, Sine
from export.examples import SEVERAL
from export.made import files
from export.targets import ISO, needs_gcc, run_selftest, write
from independent import refusal

PROBLEM = Problem(
    plant=Plant(A_m=[[0, 1], [-4, -3]], b=[0, 2], theta=[1, -0.5], x0=[0.2, 0], input=PlantInput(saturation=[-0.5, 0.5])),
    reference_model=ReferenceModel(k_0=2),
    reference=Sine(amplitude=1, frequency=2),
    disturbance=Constant(0.3),
    uncertainty=ParameterBox(lower=[-2, -2], upper=[2, 2]),
)
CONTROLLERS = (
    Sampled(Mrac(gamma=20), 0.01),
    Sampled(L1Adaptive(gamma=100, filter=input_filter(kappa=0.1), saturated_predictor=True), 0.01),
    L1PiecewiseConstant(sample_time=0.01, filter=input_filter(kappa=0.1), saturated_predictor=True),
)
pytestmark = needs_gcc


@pytest.mark.parametrize("controller", CONTROLLERS, ids=lambda one: one.name)
@pytest.mark.short(kept=lambda controller: controller is CONTROLLERS[2])
def test_sample_by_sample_it_is_the_simulated_one_in_every_bit(controller) -> None:
    """The samples are equal also at the actuator's limits and after a reset. Each of several loaded libraries has a separate
    state."""
    expected = recorded(PROBLEM, controller, Simulation(t_end=2, dt=1e-3), 200)
    loop = expected.loop
    u = expected.states[:, loop.unpack(np.arange(loop.size)).held.u - loop.size]  # counted from the end
    assert (np.abs(u) > 0.5).any()
    flyable = pickle.loads(pickle.dumps(exported_c(PROBLEM, controller)))
    step, other = flyable.step(), flyable.step()
    for _ in range(2):
        for y, r, wanted in zip(expected.measured, expected.commands, u, strict=True):
            assert step(y, r).tobytes() == np.atleast_1d(wanted).tobytes()
            other(np.zeros(2), 0.0)
        assert step.agreement() == Agreement(samples=200)
        step.reset()
    assert step.agreement() == Agreement()


def test_several_inputs() -> None:
    controller = L1PiecewiseConstant(sample_time=0.01, filter=input_filter(0.05), as_flown=AsFlown())
    flyable = exported_c(replace(SEVERAL, plant=replace(SEVERAL.plant, input=PlantInput())), controller)
    step = flyable.step()
    for x in np.random.default_rng(5).standard_normal((50, flyable.simulated.measured)):
        u = step(x, np.ones(flyable.simulated.signals - flyable.simulated.measured - 1))
    assert len(u) == 2
    assert step.agreement() == Agreement(samples=50)


def test_it_is_the_c_that_a_user_gets(monkeypatch) -> None:
    """The two sources are equal except for the prefix of names and the number that marks the files of one export."""
    seen = {}

    def keeping(compiler, texts, *options, **named):
        seen.update(texts)
        return shared_library(compiler, texts, *options, **named)

    monkeypatch.setattr(exported_step, "shared_library", keeping)
    controller = CONTROLLERS[0]
    exported_c(PROBLEM, controller)
    written = files(PROBLEM, controller, Simulation(t_end=10.0, dt=0.01))
    for name in ("controller.h", "controller.c"):
        a, b = (
            [line.replace("exported", "mrac").replace("EXPORTED", "MRAC") for line in text.splitlines() if "_EXPORT " not in line]
            for text in (seen[name], written[name])
        )
        assert a == b


@pytest.mark.parametrize("controller", CONTROLLERS, ids=lambda one: one.name)
@pytest.mark.short(kept=lambda controller: controller is CONTROLLERS[0])
def test_without_fused_sums_the_c_has_the_bits_of_such_a_run(controller, tmp_path) -> None:
    """These runs use symbols for the controller's numbers, which yields different operations than constants do."""
    folder = write(tmp_path / "made", files(PROBLEM, controller, Simulation(t_end=2.0, dt=0.01, fused=False)))
    done = run_selftest(folder, "gcc", *ISO, "-O2")
    assert done.returncode == 0, done.stdout
    assert "200 samples agree in every bit" in done.stdout


def test_a_last_bit_in_the_c_is_told(monkeypatch) -> None:
    """The control differs from the list's, so the C was really used."""
    right = exported_step.source

    def wrong(printed):
        text = right(printed)
        line = next(line for line in text.splitlines() if line.startswith("    c->held_u[0] = t"))
        return text.replace(line, line.replace(";", " * (1 + 0x1p-52);"), 1)

    step = exported_c(PROBLEM, CONTROLLERS[0]).step()
    monkeypatch.setattr(exported_step, "source", wrong)
    faulty = exported_c(PROBLEM, CONTROLLERS[0]).step()
    x, r = np.array([0.2, 0.1]), 0.7
    apart = float(abs(faulty(x, r) - step(x, r))[0])
    assert 0 < apart <= 2 * np.spacing(step(x, r))
    found = faulty.agreement()
    assert found.equal is False
    assert found.difference == f"held_u[0] differs from sample 1 of a flight on, u by at most {apart:.1e}"
    assert faulty.agreement() == Agreement()
    assert step.agreement().equal


def test_what_the_export_refuses_is_counted() -> None:
    step = exported_c(PROBLEM, CONTROLLERS[0]).step()
    before = step(np.array([0.2, 0.1]), 0.7)
    assert step(np.array([np.nan, 0.1]), 0.7) == before
    found = step.agreement()
    assert (found.samples, found.refused, found.equal) == (2, 1, False)


def test_flights_are_counted_together() -> None:
    one = Agreement(samples=10)
    assert Agreement.together([one, None, replace(one, difference="here")]) == Agreement(flights=2, samples=20, difference="here")
    assert Agreement.together([None]).equal is None
    assert Agreement.together([one, one], flights=1).flights == 1


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        ("no-such-cc -O1", "CC names 'no-such-cc', which is not on this machine's PATH"),
        ("'cc", "a quotation mark is not closed"),
        ("true", "true does not compile the export: it wrote no library"),
        ("false", "exit code 1"),
    ],
)
def test_another_compiler_is_taken_or_one_sentence(choice, sentence, monkeypatch) -> None:
    monkeypatch.setenv("CC", choice)
    assert sentence in refusal(lambda: exported_c(PROBLEM, CONTROLLERS[0]))


def test_options_go_with_the_compiler(monkeypatch, tmp_path, capsys) -> None:
    monkeypatch.setenv("CC", "cc -O1")
    program, *options = require_compiler()
    assert Path(program).is_absolute() and options == ["-O1"]
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["fly", "f16-pitch", "--sil"]) == 2
    assert capsys.readouterr().err == (
        "barbalat: --sil flies the exported C, and none of cc, gcc, clang is on this machine's PATH: install a C compiler\n"
    )
    assert list(tmp_path.iterdir()) == []
