"""Explorers without a browser: the contents of a page, whose numbers must equal the simulator's. See ``browser_explorer.py``."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from barbalat import Mrac, Simulation, load_case
from barbalat.cases.load import CaseText, bundled, parse_case
from barbalat.cli import main
from barbalat.explorer.commands import Grid, smooth_module
from barbalat.explorer.describe import Described, outputs, page_members
from barbalat.explorer.explorer import Explorer
from barbalat.explorer.source import TextSource, toml
from barbalat.lowering.shape import ENTRY
from barbalat.open_numbers.numbers import in_tables
from barbalat.open_numbers.path import FieldPath
from barbalat.run.kernel.grid import signal_table
from barbalat.run.kernel.portable import run_times
from barbalat.signals import Constant, Sine, Sines, Square
from barbalat.studies import explore
from barbalat.validate import InputError, signal_values
from lowering.test_c99 import same_bits

CASE = """name = "</script><b> & \\"quoted\\""
[plant]
A_m = [[-4.0]]
b = [1.0]
theta = [5.0]
[reference_model]
k_0 = 4.0
[reference]
kind = "sine"
amplitude = 4.0
frequency = 3.0
[uncertainty]
lower = [-10.0]
upper = [10.0]
[simulation]
t_end = 4.0
dt = 1e-3
[[controller]]
name = "<i>L1</i>"
scheme = "l1"
gamma = 100.0
filter = { kappa = 0.05 }
"""


@pytest.fixture(scope="module")
def page() -> str:
    return Explorer(TextSource(CaseText(CASE))).html


def data_of(page: str):
    (text,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def test_names_and_texts_end_no_element(page) -> None:
    data = data_of(page)
    assert data["case"] == '</script><b> & "quoted"'
    assert data["controllers"][0]["name"] == "<i>L1</i>"
    assert "<b>" not in page
    assert "<i>" not in page
    assert "&lt;i&gt;L1&lt;/i&gt;" in page  # among the certificates


def test_a_page_asks_for_nothing_and_is_small(page) -> None:
    assert not re.findall(r'(?:src|href)\s*=\s*["\']?(?:https?:)?//', page)
    assert "default-src 'none'" in page
    assert len(page.encode()) < 1_000_000
    assert "The MIT License" in page


@pytest.mark.full
@pytest.mark.parametrize("name", bundled())
def test_every_bundled_case_has_a_page_with_all_its_controllers(name) -> None:
    case = load_case(name)
    page = explore(case.problem, case.controllers, case.simulation).html
    assert len(data_of(page)["controllers"]) == len(case.controllers)


def test_every_number_of_the_loop_has_a_slider(page) -> None:
    paths = {number["path"]: number for number in data_of(page)["numbers"]}
    wanted = {"controller[0].gamma", "controller[0].filter.kappa", "reference.amplitude", "reference.frequency", "plant.theta[0]"}
    assert wanted < set(paths)
    assert paths["controller[0].gamma"]["copied"]
    assert not paths["controller[0].filter.kappa"]["copied"]  # the module receives -1/kappa and 1/kappa
    assert paths["controller[0].gamma"]["log"]
    assert not paths["plant.theta[0]"]["log"]


@pytest.mark.parametrize(
    "controller",
    [
        'scheme = "mrac"\ngamma = 20\nsample_time = 0.01',
        'scheme = "l1"\ngamma = 20\nfilter = { kappa = 0.1 }\nsample_time = 0.01\ndiscretization = "euler"',
    ],
)
def test_gains_of_sampled_controllers_have_sliders(controller) -> None:
    text = (
        'name = "sampled"\n[plant]\nA_m = [[0, 1], [-4, -3]]\nb = [0, 2]\ntheta = [1, -0.5]\n[reference_model]\nk_0 = 2\n'
        '[reference]\nkind = "constant"\nvalue = 1\n[uncertainty]\nlower = [-2, -2]\nupper = [2, 2]\n'
        f"[simulation]\nt_end = 2\ndt = 0.01\n[[controller]]\n{controller}\n"
    )
    described = Described.of(TextSource(CaseText(text)))
    assert {"controller[0].gamma", "uncertainty.upper[0]"} <= {str(one.number.path) for one in described.sliders}


def test_numbers_that_move_the_same_entries_name_each_other() -> None:
    """P depends on all entries of A_m, so a page changes only one of them at a time. b, gamma and kappa are independent."""
    text = CASE.replace("[[-4.0]]", "[[0.0, 1.0], [-4.0, -2.8]]").replace("[1.0]", "[0.0, 1.0]").replace("[5.0]", "[1.0, -0.5]")
    sliders = Described.of(TextSource(CaseText(text.replace("[-10.0]", "[-3.0, -3.0]").replace("[10.0]", "[3.0, 3.0]")))).sliders
    excludes = {str(one.number.path): sum(one.excludes(other) for other in sliders if other is not one) for one in sliders}
    assert {path: count for path, count in excludes.items() if count} == {
        f"plant.A_m{at}": 2 for at in ("[0][1]", "[1][0]", "[1][1]")
    }
    assert "plant.b[1]" in excludes


@pytest.mark.full
def test_the_copied_case_file_is_the_case() -> None:
    source = TextSource(CaseText(CASE))
    described = Described.of(source)
    numbers = [slider.number for slider in described.sliders]
    text = "".join(
        part
        if isinstance(part, str)
        else repr(([n.value for n in numbers] + [4.0, 1e-3])[part["number"]])
        if "number" in part
        else '"rk4"'
        if "solver" in part
        else "true"
        for part in source.case_file(described.slots(), described.toggles)
    )
    found, given = tomllib.loads(text), tomllib.loads(CASE)
    given["simulation"] |= {"fused": False, "solver": "rk4"}
    given["controller"][0]["projection"] = True
    assert found == given


ENCODER = """
name = "encoder"
[parameters]
k = { value = 2.0, between = [1.0, 3.0] }
[plant]
A = [[0, 1], ["-k", -0.5]]
b = [0, 1.0]
input = { delay = 0.02, saturation = [-3.0, 3.0] }
[observer]
kind = "luenberger"
poles = [[-8, 3]]
measured = ["x_1"]
[reference_model]
poles = [-3, -4]
follow = "x_1"
[reference]
kind = "constant"
value = 1.0
[simulation]
t_end = 1.0
dt = 0.01
[[controller]]
scheme = "mrac"
gamma = 1.0
sample_time = 0.02
"""
WITHOUT_PARAMETERS = ENCODER.replace("[parameters]\nk = { value = 2.0, between = [1.0, 3.0] }\n", "").replace('"-k"', "-2.0")


@pytest.mark.parametrize("given", [ENCODER, WITHOUT_PARAMETERS], ids=["parameters", "without"])
def test_what_the_page_varies_around_an_observer_is_the_truth_in_the_copied_file_too(given):
    """The delay, the limits and the parameters on the page belong to the simulated plant. The model and the observer stay as
    designed."""
    source, design = TextSource(CaseText(given)), parse_case(given).problem
    slots = [FieldPath.parse(one) for one in ("plant.input.delay", "plant.input.saturation[1]")]
    values = [0.05, 2.5]
    if given is ENCODER:
        slots, values = [*slots, FieldPath.parse("parameters.k")], [*values, 1.5]
    parts = source.case_file(slots, ())
    text = "".join(p if isinstance(p, str) else repr(values[p["number"]]) if "number" in p else '"rk4"' for p in parts)
    copied, page = parse_case(text).problem, source.at(dict(zip(slots, values, strict=True))).problem
    for found in (copied, page):
        assert found.delay == 0.05 and found.fixed_observer.delay == 0.02
        np.testing.assert_array_equal(found.surroundings.paths[0].saturation, [-3.0, 2.5])
        np.testing.assert_array_equal(found.known.saturation, [-3.0, 3.0])
        np.testing.assert_array_equal(found.plant.theta, design.plant.theta)
        np.testing.assert_array_equal(found.simulated.A[1], [-1.5 if given is ENCODER else -2.0, -0.5])


def test_estimates_are_called_what_they_are():
    """As in pictures and tables, the names are feedback and feedforward of direct MRAC. The textbook's ideal gains are 2 and
    4."""
    described = Described.of(TextSource(CaseText.read("astrom-wittenmark")))
    case = described.case
    found = outputs(case, page_members(case, described.variants[0].target, case.simulation.solver))
    assert found["estimates"] == ["k\u0302ₓ"] and found["true"] == [2.0]
    assert found["beside"] == [{"label": "k\u0302ᵣ", "row": found["reported"]["k_r_hat"][0], "true": 4.0}]


@pytest.mark.parametrize("case", sorted(bundled()))
def test_tables_are_written_as_they_were_read(case) -> None:
    tables = CaseText.read(case).data()
    assert tomllib.loads(toml(tables)) == tables
    assert dict(in_tables(tables))


def test_a_module_s_commands_have_a_run_s_bits() -> None:
    wasmtime = pytest.importorskip("wasmtime", reason="wasmtime is not installed")
    signals = (Sine(3.0, 0.7, 0.2, -1.0), Constant(2.5), Square(1.0, 1.0), Sines((1.0, 0.3), (2.0, 16.1)))
    simulation = Simulation(t_end=60.0, dt=1e-2, fused=False)
    t = simulation.time(np.arange(simulation.steps + 1))
    module, parameters = smooth_module(signals)
    engine = wasmtime.Engine()
    store = wasmtime.Store(engine)
    exports = wasmtime.Instance(store, wasmtime.Module(engine, module), []).exports(store)
    memory, begin = exports["memory"], exports["memory"].data_len(store)
    p, rows, out = (begin, begin + parameters.nbytes, begin + parameters.nbytes + t.nbytes)
    memory.grow(store, 8)
    memory.write(store, parameters.tobytes(), p)
    memory.write(store, t.tobytes(), rows)
    exports[ENTRY](store, len(t), 1, p, p, rows, out, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1)
    found = np.frombuffer(bytes(memory.read(store, out, out + 3 * t.nbytes))).reshape(-1, 3)
    smooth = [signal for signal in signals if not isinstance(signal, Square)]
    expected = [np.asarray(signal_values(signal, run_times(simulation, t))) for signal in smooth]
    assert same_bits(found, np.column_stack(expected))


def test_what_jumps_is_kept_as_runs_of_rows() -> None:
    """The reassembled rows equal a run's table, including jumps within steps."""
    signals = (Square(1.5, 0.7),)
    simulation = Simulation(t_end=20.0, dt=1e-2, fused=False)
    grid = Grid.of(signals, simulation)
    table = signal_table(signals, simulation, 0, simulation.steps, in_pieces=True)
    assert 0 < len(grid.cuts) < len(grid.starts) + 1 < 20
    lengths = np.diff([*grid.starts, len(table)])
    assert same_bits(np.repeat(grid.values, lengths, axis=0), table[:, :-3])
    assert len(table) == simulation.steps + len(grid.cuts)


def test_a_simulation_that_is_none_is_told() -> None:
    case = load_case("first-order")
    with pytest.raises(InputError, match="simulation must be a Simulation, got 5"):
        explore(case.problem, Mrac(gamma=2.0), 5)  # type: ignore[arg-type]


def test_the_page_of_a_case_with_a_tolerance_has_fixed_steps(tmp_path, capsys) -> None:
    text = re.sub(r"(?m)^dt = .*$", "tolerance = 1e-6", bundled()["first-order"].read_text())
    with pytest.raises(InputError, match=r"= 1e-06 does not determine a fixed step, but a page that simulates needs one"):
        _ = Explorer(TextSource(CaseText(text))).html
    path, page = tmp_path / "case.toml", tmp_path / "page.html"
    path.write_text(text)
    assert main(["explore", str(path), "--out", str(page), "--no-open"]) == 0
    assert "all runs here use fixed steps, rk4 with h = 0.002 s" in capsys.readouterr().err
    path.write_text(re.sub(r"(?m)^tolerance = .*$", "dt = 0.002", text))
    assert page.read_text() == Explorer(TextSource(CaseText.read(str(path), None))).html


@pytest.mark.full
def test_objects_of_python_get_a_page_too() -> None:
    case = load_case("first-order")
    made = explore(case.problem, Mrac(gamma=2.0), replace(case.simulation, t_end=1.0))
    paths = [str(path) for path, _ in made.source.numbers()]
    assert {"controller[0].gamma", "plant.theta[0]", "reference.amplitude"} <= set(paths)
    moved = made.at({"controller[0].gamma": 7.0, "simulation.dt": 5e-4}, solver="heun")
    assert moved.controllers[0].gamma == 7.0
    assert (moved.simulation.dt, moved.simulation.solver.name, moved.simulation.fused) == (5e-4, "heun", False)
    assert made._repr_html_().startswith("<iframe")
    with pytest.raises(InputError, match="solver must be one of"):
        made.at({}, solver="rk5")


GAIN = (
    CASE.replace("[reference_model]", "[plant.input]\ngain = 0.5\n[reference_model]")
    .replace('"l1"', '"mrac-direct"')
    .replace("filter = { kappa = 0.05 }\n", "k_r0 = 0.0\n")
)
JUMPING = CASE.replace('kind = "sine"', 'kind = "square"').replace("dt = 1e-3", "dt = 1e-2")


@pytest.mark.full
def test_the_amplitude_of_a_command_that_jumps_multiplies_its_rows_and_its_frequency_has_a_grid_for_each_value() -> None:
    source = TextSource(CaseText(JUMPING))
    described = Described.of(source)
    sliders = {str(one.number.path): one for one in described.sliders}
    assert sliders["reference.amplitude"].signals.scales == [0]
    frequency = sliders["reference.frequency"]
    assert not frequency.copied
    for value, grid in zip(frequency.number.values, frequency.signals.grids, strict=True):
        case = source.at({FieldPath.parse("reference.frequency"): float(value)})
        table = signal_table(case.problem.signals, case.simulation, 0, case.simulation.steps, in_pieces=True)
        assert same_bits(np.repeat(grid.values, np.diff([*grid.starts, len(table)]), axis=0), table[:, :-3])
    own, other = (source.at({FieldPath.parse("reference.amplitude"): v}) for v in (4.0, 6.5))
    before, after = (Grid.of(case.problem.signals, case.simulation) for case in (own, other))
    assert same_bits(before.values / 4.0 * 6.5, after.values)


def test_a_gain_of_one_is_another_kernel_and_no_slider_s_value() -> None:
    """With a gain of 1 the multiplication used to be left out and sums were reordered, so the copied case differed in its last
    bits."""
    (gain,) = [
        one.number for one in Described.of(TextSource(CaseText(GAIN))).sliders if str(one.number.path) == "plant.input.gain"
    ]
    assert gain.values[0] < 1 < gain.values[-1]
    assert 1.0 not in gain.values
    assert gain.without == (1.0,)


def test_of_the_amplitude_and_what_shifts_a_jumping_command_one_moves_at_a_time() -> None:
    """For another amplitude a page multiplies the stored rows. This is right with a different frequency or phase, but wrong with
    a different constant part."""
    text = JUMPING.replace("frequency = 3.0", "frequency = 3.0\nphase = 0.0\nconstant = 0.0")
    source = TextSource(CaseText(text.replace('"l1"', '"mrac"').replace("filter = { kappa = 0.05 }\n", "")))
    sliders = {str(one.number.path).removeprefix("reference."): one for one in Described.of(source).sliders}
    amplitude = sliders["amplitude"]

    def multiples(key: str) -> bool:
        number = sliders[key].number
        own, other = float(amplitude.number.values[0]), float(number.values[-1])
        found = [
            Grid.of(case.problem.signals, case.simulation)
            for case in (source.at({FieldPath.parse(f"reference.{key}"): other, amplitude.number.path: v}) for v in (4.0, own))
        ]
        return same_bits(found[0].values / 4.0 * own, found[1].values)

    for key in ("frequency", "phase", "constant"):
        assert multiples(key) == (key != "constant")
        assert sliders[key].excludes(amplitude) == amplitude.excludes(sliders[key]) == (key == "constant")


@pytest.mark.full
def test_what_follows_from_another_controller_s_numbers_follows_in_the_page_too() -> None:
    described = Described.of(TextSource(CaseText.read("l1-output")))
    (gamma,) = [one for one in described.sliders if str(one.number.path) == "controller[0].gamma"]
    assert [effect.nothing for effect in gamma.effects[:4]] == [False, False, True, True]  # its equivalent and not the limit
