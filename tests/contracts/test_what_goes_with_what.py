"""The whole table of schemes, options, plants, signals and targets: each cell is either built or rejected as declared.

Registered names are included automatically. A setting of a scheme, of a plant's input or of a sensor without an example here
fails a test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, replace
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from barbalat import KnownParameters, Mrac, MracClosedLoop, Plant, Sampled, Simulation, TransferFunction
from barbalat.cases.build import Case, made
from barbalat.cases.keys import Context
from barbalat.cases.schema import json_schema, table_of
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.comparison.contest.contest import posed
from barbalat.comparison.contest.entrant import entrants_of
from barbalat.comparison.tradeoff.tradeoff import trade_off
from barbalat.controllers import SCHEMES
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.controllers.settings import PLANT_FEATURES
from barbalat.controllers.windup import ModifiedError
from barbalat.explorer.commands import grids_of, is_computed, is_formula, points_of, smooth_module
from barbalat.explorer.describe import Described
from barbalat.explorer.source import ObjectSource
from barbalat.export.parameters import Opened
from barbalat.export.plant import PlantContents
from barbalat.laws import CompositeLearning, DeadZone, EpsilonModification, FixedSigma, Normalization, SwitchingSigma
from barbalat.loop.closed_loop import ClosedLoop
from barbalat.open_numbers.kernel_numbers import Family
from barbalat.plants import Disturbance, LqiBaseline, Noise, PlantInput, Sensor
from barbalat.run.engine.simulate import simulate
from barbalat.signals import SIGNALS, Sine
from barbalat.targets import (
    CONTEST,
    EXPORTED_LOOP,
    KNOWN_SET,
    MEASURED_STATE,
    NO_CLOCK,
    TARGETS,
    TRADE_OFF,
    in_pages,
    is_tunable,
    left_out,
)
from barbalat.validate import InputError
from contracts import case_examples
from export.examples import GAIN, OUTPUT, POLYNOMIAL, SEVERAL, STATE
from export.made import files, units
from independent import example_controllers, example_output_controllers, refusal

T = 2.0**-6
SIMULATION = Simulation(t_end=32 * T, dt=T / 2)
LIMITED = PlantInput(saturation=[-3.0, 3.0])
"""Limits for every option against windup."""
PLAIN = replace(STATE, plant=replace(STATE.plant, input=LIMITED), sensor=None)
PLAIN_OUTPUT = replace(OUTPUT, plant=replace(OUTPUT.plant, input=LIMITED), sensor=None)

OPTIONS: dict[str, tuple[Any, ...]] = {
    "theta_hat0": (np.full(2, 0.1),),
    "projection": (False, True),
    "leakage": (FixedSigma(sigma=0.1), SwitchingSigma(sigma=0.1, M_0=0.5), EpsilonModification(nu=0.2)),
    "dead_zone": (DeadZone(g_0=0.01),),
    "learning": (CompositeLearning(gamma_c=2.0, time_constant=0.3, forgetting=0.1, capacity=2.0),),
    "modified_error": (ModifiedError(), ModifiedError(mu=0.5, margin=0.1)),
    "gamma_r": (2.0,),
    "k_r0": (2.5,),
    "gamma_v": (1.0,),
    "neurons": (2,),
    "scale": (np.array([1.0, 2.0]),),
    "seed": (3,),
    "spread": (0.5,),
    "V_hat0": (0.1 * np.ones((3, 3)),),
    "output": (np.array([1.0, 0.5]),),
    "normalization": (Normalization(), 1.0),
    "feedforward_only": (True,),
    "saturated_predictor": (True,),
    "as_flown": (AsFlown(predictor_poles=-2.0),),
    "nominal": (np.array([0.1, 0.1]),),
    "b_0": (0.8,),
    "unmodelled": (TransferFunction([0.1, 0.0], [0.1, 1.0]),),
    "anti_windup": (1.0,),
    "c_0": (np.array([1.0, 1.0]),),
    "tau": (0.3,),
    "filter_poles": ((),),
    "lower": (None,),
    "upper": (None,),
    "c_0_min": (0.1,),
    "sigma_bound": (20.0,),
    "lipschitz": (1.0,),
    "design_plant": (TransferFunction([1.0], [1.0, 2.0]),),
    "feedforward": (TransferFunction([1.0], [0.1, 1.0]),),
}
"""Values for each field of a scheme that has a default, including types that only the same field of other schemes accepts."""
INPUTS = {
    "quantization": 0.01, "saturation": [-2.0, 4.0], "rate_limit": 50.0, "actuator": TransferFunction([1.0], [0.05, 1.0]),
    "multiplicative": TransferFunction([0.1, 0.0], [0.05, 1.0]), "gain": 0.7, "delay": 1.5 * T, "history": 0.2,
}  # fmt: skip
SENSORS = {"lag": 0.02, "noise": Noise(std=0.01, sample_time=T), "quantization": 0.01}
FEATURED = {
    "several inputs": replace(SEVERAL, plant=replace(SEVERAL.plant, input=LIMITED)),
    "an unknown input gain": replace(GAIN, plant=PLAIN.plant, sensor=None),
    "a baseline": replace(
        PLAIN,
        plant=Plant(
            A=PLAIN.plant.A, b=PLAIN.plant.b, input=LIMITED, baseline=LqiBaseline(Q=np.ones(3), R=1.0, output=[1.0, 0.0])
        ),
        uncertainty=None,
    ),
    "a regressor other than x": replace(POLYNOMIAL, plant=replace(POLYNOMIAL.plant, input=LIMITED), sensor=None),
}


@dataclass(frozen=True)
class Cell:
    """A scheme combined with one option."""

    scheme: str
    beside: str
    problem: Any
    controller: Any

    def __str__(self) -> str:
        return f"{self.scheme}-{self.beside}"


def schemes(wanted: str = "") -> Iterator[tuple[str, type, tuple[Any, ...], Any]]:
    """Name, class, examples and a problem of every registered scheme, or of one."""
    found = {name: (kind, example_controllers(2)[name], PLAIN) for name, kind in SCHEMES.items()}
    of_y = {f"{name} of y": kind for name, kind in OUTPUT_SCHEMES.items()}
    found |= {
        name: (kind, example_output_controllers(1)[name.removesuffix(" of y")], PLAIN_OUTPUT) for name, kind in of_y.items()
    }
    yield from ((name, *one) for name, one in found.items() if wanted in ("", name))


def optional(kind: type) -> list[str]:
    """The optional settings, except names."""
    given = [one for one in fields(kind) if one.init and one.name != "name"]
    return [one.name for one in given if one.default is not MISSING or one.default_factory is not MISSING]


def with_options(scheme: str) -> Iterator[Cell]:
    """The options of a scheme. A value that no example of the scheme accepts makes no cell, because it belongs to a different
    scheme's setting of the same name."""
    for name, kind, examples, problem in schemes(scheme):
        for i, controller in enumerate(examples):
            yield Cell(name, f"example-{i + 1}", problem, controller)
        for option in optional(kind):
            for k, value in enumerate(OPTIONS[option]):
                fitting = next((one for one in examples if takes(one, option, value, problem)), None)
                if fitting is not None:
                    yield Cell(name, f"{option}-{k + 1}", problem, replace(fitting, **{option: value}))


def takes(controller: Any, option: str, value: Any, problem: Any) -> bool:
    try:
        replace(controller, **{option: value}).bind(problem.known)
    except InputError:
        return False
    return True


def with_plants(scheme: str) -> Iterator[Cell]:
    """Everything between controller and plant, disturbances, and plants that not every scheme accepts."""
    for name, kind, (controller, *_), problem in schemes(scheme):
        made = {f"input-{key}": input_of(problem, key, value) for key, value in INPUTS.items()}
        made |= {f"sensor-{key}": replace(problem, sensor=Sensor(**{key: value})) for key, value in SENSORS.items()}
        wave = Sine(amplitude=0.1, frequency=2.0)
        made["disturbance"] = replace(problem, disturbance=wave)
        if problem is PLAIN:
            made["unmatched"] = replace(problem, unmatched=(Disturbance(direction=[1.0, 0.0], signal=wave),))
            made |= {feature: one for feature, one in FEATURED.items() if feature not in kind.beyond}
        else:
            made["output_disturbance"] = replace(problem, output_disturbance=wave)
        sampled = {"sensor-quantization": at_samples(Cell(name, "", problem, controller))}
        yield from (Cell(name, beside, one, fitted(sampled.get(beside, controller), one)) for beside, one in made.items())


def input_of(problem: Any, key: str, value: Any) -> Any:
    given = {"saturation": LIMITED.saturation} | ({"delay": INPUTS["delay"]} if key == "history" else {}) | {key: value}
    return replace(problem, plant=replace(problem.plant, input=PlantInput(**given)))


def at_samples(cell: Cell) -> Any:
    """The sampled form of a controller. Every scheme has Euler's step."""
    loop = ClosedLoop.of(cell.problem, cell.controller)
    return cell.controller if loop.sampled else Sampled(controller=cell.controller, sample_time=T, discretization="euler")


def traced(cell: Cell) -> None:
    """Trace a cell as for a page and an FMU, with symbols in place of numbers, which reveals a branch on a value."""
    opened = replace(SIMULATION, fused=False)
    Family.of([(cell.problem, cell.controller)], opened)
    sampled = at_samples(cell)
    if sampled is not cell.controller:
        Family.of([(cell.problem, sampled)], opened)
    PlantContents.of(cell.problem, Opened.of(cell.problem, sampled, SIMULATION, tunable=True)).step  # noqa: B018


def paged(problem: Any, controller: Any) -> None:
    """Write a whole page without its sliders."""
    described = Described.of(ObjectSource(Case(problem, (controller,), SIMULATION)))
    described.__dict__["sliders"] = []
    described.as_data()


TARGETS_BUILT: dict[str, Callable[[Any, Any], object]] = {
    "run": lambda problem, controller: simulate(problem, [controller], SIMULATION),
    "certify": lambda problem, controller: table_1(problem, [controller], certify(problem, [controller], SIMULATION)),
    "explore": paged,
    "export c99": lambda problem, controller: files(problem, controller, SIMULATION, closed_loop=True),
    "export --float32": lambda problem, controller: files(problem, controller, SIMULATION, float32=True),
    "export fmu2": lambda *given: units(*given, SIMULATION, version=2, closed_loop=True, compiled=False),
    "export fmu3": lambda *given: units(*given, SIMULATION, version=3, closed_loop=True, compiled=False),
}


def cells_of(scheme: str) -> list[Cell]:
    return [*with_options(scheme), *with_plants(scheme)]


NAMES = [*SCHEMES, *(f"{name} of y" for name in OUTPUT_SCHEMES)]
EVERY = 8
"""Number of cells of which the short command traces one. Every scheme begins with a different cell."""


def test_every_setting_of_a_scheme_has_an_example_that_it_takes():
    lacking = []
    for name, kind, examples, problem in schemes():
        for option in optional(kind):
            values = OPTIONS.get(option, ())
            if not any(takes(one, option, value, problem) for value, one in product(values, examples)):
                lacking.append(f"{name}: {option}")
    assert not lacking
    assert {one.name for one in fields(PlantInput)} == set(INPUTS)
    assert {one.name for one in fields(Sensor)} == set(SENSORS)


@pytest.mark.parametrize("which", range(EVERY))
@pytest.mark.short(kept=lambda scheme, which: which == 0)
@pytest.mark.parametrize("scheme", NAMES)
def test_every_scheme_tolerates_open_numbers_with_every_option_and_plant(scheme, which):
    """The schemes are continuous and sampled, as in a page's module and an FMU. Everything else computes only with numbers."""
    cells = cells_of(scheme)
    assert len(cells) > EVERY
    for cell in cells[(which + NAMES.index(scheme)) % EVERY :: EVERY]:
        traced(cell)


@pytest.mark.full
@pytest.mark.parametrize("scheme", NAMES)
def test_every_target_builds_every_scheme(scheme):
    """Successive cells of a scheme are built for successive targets. A target that accepts continuous time builds both forms."""
    for (k, cell), (target, build) in zip(enumerate(cells_of(scheme)), cycle(TARGETS_BUILT.items()), strict=False):
        sampled = at_samples(cell)
        if sampled is not cell.controller and target.startswith("export"):
            assert "is continuous" in refusal(lambda build=build, cell=cell: build(cell.problem, cell.controller))
        build(cell.problem, sampled if target.startswith("export") or k % 2 else cell.controller)


@pytest.mark.parametrize("feature", PLANT_FEATURES)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_scheme_takes_a_plant_or_declares_that_it_does_not(scheme, feature):
    problem, kind = FEATURED[feature], SCHEMES[scheme]
    assert PLANT_FEATURES[feature].found(problem.known) and not PLANT_FEATURES[feature].found(PLAIN.known)
    controller = fitted(example_controllers(2)[scheme][0], problem)
    if feature not in kind.beyond:
        controller.bind(problem.known)
        return
    said = refusal(lambda: controller.bind(problem.known))
    assert said.startswith(f"{scheme} {PLANT_FEATURES[feature].refusal.format(inputs=2)}; ")
    others = said[said.index(";") + 2 : said.index(f" {PLANT_FEATURES[feature].others}")]
    named = others.removeprefix("all schemes but ").replace(" and ", ", ").split(", ")
    refusing = others.startswith("all schemes but ")
    assert named == [name for name in SCHEMES if (feature in SCHEMES[name].beyond) == refusing]


def fitted(controller: Any, problem: Any) -> Any:
    """A controller with as many known parameters and a model of the same size as the problem has."""
    if isinstance(controller, MracClosedLoop):
        return replace(controller, model_feedback=-np.eye(problem.known.n))
    if not isinstance(controller, KnownParameters):
        return controller
    return replace(controller, theta=np.append(problem.plant.theta, [1.0] * (problem.input_gain is not None)))


@pytest.mark.parametrize("name", SIGNALS)
def test_a_page_keeps_a_signal_as_it_is_declared(name, tmp_path):
    """Rows, points and the module are made for the signal as a command and as a disturbance."""
    signal = signal_of(name, tmp_path)
    assert in_pages(signal) == in_pages(SIGNALS[name])
    assert is_formula(signal) == (in_pages(signal) == "formula") and is_computed(signal) == (in_pages(signal) != "rows")
    for signals in ((signal,), (Sine(1.0, 1.0), signal)):
        grids_of(signals, SIMULATION, whole=False, most_steps=10**6)
        assert [points_of(one, 1.0) is not None for one in signals] == [in_pages(one) == "points" for one in signals]
        module, numbers = smooth_module(signals)
        assert module and (len(numbers) > 0) == any(in_pages(one) == "formula" for one in signals)


@pytest.mark.full
@pytest.mark.parametrize("name", SIGNALS)
def test_every_target_builds_every_signal(name, tmp_path):
    """Every signal is built as a command and as a disturbance."""
    signal = signal_of(name, tmp_path)
    sampled = Sampled(controller=Mrac(gamma=5.0), sample_time=T)
    for problem in (replace(PLAIN, reference=signal), replace(PLAIN, disturbance=signal)):
        for build in TARGETS_BUILT.values():
            build(problem, sampled)


def signal_of(name: str, tmp_path: Path) -> Any:
    """The signal of an example."""
    (tmp_path / "r.csv").write_text(case_examples.CSV)
    savemat(tmp_path / "r.mat", {"t": [0.0, 1.0], "r": [1.0, 2.0]})
    table = table_of(SIGNALS[name], "kind", name).model_validate({"kind": name, **case_examples.SIGNALS[name]})
    return made(table, Context(tmp_path), name)


def test_targets_ask_for_what_they_declare():
    """For each requirement a problem that violates it is rejected. A problem that meets all requirements is accepted."""
    clocked = replace(PLAIN_OUTPUT, plant=replace(PLAIN_OUTPUT.plant, nonlinear="0.1*sin(t)*y"))
    lacking = {MEASURED_STATE: PLAIN_OUTPUT, KNOWN_SET: replace(PLAIN, uncertainty=None), NO_CLOCK: clocked}
    assert lacking.keys() == {need for target in TARGETS for need in target.problem}
    for target in TARGETS:
        target.require(PLAIN)
        for need in target.problem:
            assert not need.met(lacking[need])
            assert refusal(lambda target=target, need=need: target.require(lacking[need])).startswith(f"{target.called} needs ")
    for problem in (PLAIN_OUTPUT, lacking[KNOWN_SET]):
        for target, refused in ((CONTEST, posed), (TRADE_OFF, lambda it: trade_off(it, SIMULATION))):
            said = [refusal(lambda ask=ask, problem=problem: ask(problem)) for ask in (refused, target.require)]
            assert said[0] == said[1]
    sampled = Sampled(controller=example_output_controllers(1)["mrac-output"][0], sample_time=T, discretization="euler")
    files(clocked, sampled, SIMULATION)
    said = refusal(lambda: files(clocked, sampled, SIMULATION, closed_loop=True))
    assert said == refusal(lambda: EXPORTED_LOOP.require(clocked))


def test_who_takes_part_in_a_contest_is_who_says_what_is_tuned():
    """The exceptions are the schemes that do not accept the plant, each of which is listed as left out."""
    found, left = entrants_of(FEATURED["several inputs"], Simulation(t_end=2.0, dt=1e-2))
    taking = [name for name, kind in SCHEMES.items() if is_tunable(kind) and "several inputs" not in kind.beyond]
    assert len(found) == len(taking) - 1  # "baseline alone" takes part only in cases with a baseline
    beside, _ = entrants_of(FEATURED["a baseline"], Simulation(t_end=2.0, dt=1e-2), schemes=["mrac", "baseline"])
    assert [one.name for one in beside] == ["MRAC", "Baseline"]
    assert all(any(one.startswith(f"{name} is omitted") for one in left) for name in SCHEMES if not is_tunable(SCHEMES[name]))


def test_the_schema_says_where_a_scheme_and_a_signal_do_not_go():
    tables = json_schema()["$defs"].values()
    said = [one.get("description", "") for table in tables for one in table["properties"].values() if "const" in one]
    for kind in [*SCHEMES.values(), *OUTPUT_SCHEMES.values()]:
        assert any(left_out(kind) in one for one in said)
    assert left_out(SCHEMES["linear"]) == "Does not support plants with several inputs or a regressor other than x."
    assert (
        left_out(SCHEMES["mit-rule"])
        == "Does not support plants with several inputs or a baseline. Not for contest, design, tradeoff and tune without --vary."
    )
    assert left_out(OUTPUT_SCHEMES["l1-output-piecewise"]) == "Not for contest, design and tradeoff."
    assert sum("A page of explore keeps" in one for one in said) >= len(SIGNALS)
