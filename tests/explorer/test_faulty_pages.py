"""A page with a shell and faults: its random numbers are the package's, and its runs are identical to the results of
``simulate``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from barbalat import simulate
from barbalat.cases.load import CaseText
from barbalat.explorer.describe import Described
from barbalat.explorer.faults import DRAWN, ENTRY, uniform_module
from barbalat.explorer.source import TextSource
from barbalat.problem.faults import FAULTS, GRID, LARGEST_SEED, SIGNS, uniform
from explorer.in_node import figures, needs_node
from explorer.test_stability import compare, judged
from lowering.test_c99 import same_bits

CASE = (Path(__file__).parent / "faults.toml").read_text("utf-8")
JITTER = CASE[CASE.index('[[faults]]\nkind = "jitter"') : CASE.index("[[controller]]")]
MOVED = {
    "faults[0].share": 0.25, "faults[1].size": 0.31, "faults[1].burst": 0.13, "faults[2].times[0][0]": 0.9,
    "faults[2].times[0][1]": 1.73, "faults[4].size": 0.21, "faults[6].share": 0.8, "faults[1].seed": 5.0,
    "faults[5].seed": 41.0,
}  # fmt: skip


def described(jitter: str = JITTER) -> Described:
    return Described.of(TextSource(CaseText(CASE.replace(JITTER, jitter))))


def compared(found: dict, case) -> None:
    runs = simulate(case.problem, case.controllers, case.simulation)
    for name, run in runs.items():
        assert {key: found[name].get(key) for key in run.figures} == run.figures


@pytest.mark.parametrize(("seed", "place"), [(0, 0), (7, 3), (LARGEST_SEED, SIGNS + 2)])
def test_a_page_s_hash_is_the_package_s(seed, place) -> None:
    wasmtime = pytest.importorskip("wasmtime", reason="wasmtime is not installed")
    slots = np.random.default_rng(0).integers(0, 10**13, 3000).astype(float)
    engine = wasmtime.Engine()
    store = wasmtime.Store(engine)
    exports = wasmtime.Instance(store, wasmtime.Module(engine, uniform_module()), []).exports(store)
    memory = exports["memory"]
    begin = memory.data_len(store)
    memory.grow(store, 2)
    memory.write(store, slots.tobytes(), begin)
    out = begin + slots.nbytes
    exports[ENTRY](store, seed - 2**64 if seed >= 2**63 else seed, place, len(slots), begin, out)
    found = np.frombuffer(bytes(memory.read(store, out, out + slots.nbytes)))
    assert same_bits(found, uniform(seed, place, slots.astype(np.int64)))


@needs_node
@pytest.mark.parametrize("jitter", [JITTER, pytest.param("", marks=pytest.mark.full)])
def test_every_fault_and_a_shell_have_the_bits_of_a_run(tmp_path, jitter) -> None:
    page = described(jitter=jitter)
    assert {one.kind for one in page.case.problem.faults} | {"jitter"} == set(FAULTS)
    compared(figures(page.as_data(), tmp_path), page.case)


@needs_node
def test_sliders_of_faults_and_of_the_shell_move_them_at_another_step(tmp_path) -> None:
    page = described()
    paths = [str(one.number.path) for one in page.sliders]
    assert set(MOVED) <= set(paths)
    assert all(page.sliders[paths.index(path)].copied for path in MOVED)
    moved = dict(MOVED)
    for path in ("shell.rate.x_2", "shell.longest_outage"):  # tabulated in a kernel by the sample time
        values = page.sliders[paths.index(path)].number.values
        moved[path] = float(values[len(values) // 4])
    assert "faults[0].seed" not in paths  # 2^64 - 1, whereas a page's numbers have 53 bits
    values = [moved.get(path, one.number.value) for path, one in zip(paths, page.sliders, strict=True)]
    found = figures(page.as_data(), tmp_path, values=values, dt=2.5e-3, tEnd=6.0)
    case = page.source.at({page.sliders[paths.index(path)].number.path: value for path, value in moved.items()})
    compared(found, replace(case, simulation=replace(case.simulation, dt=2.5e-3, t_end=6.0)))


def test_a_verdict_is_the_judge_s_with_faults_that_come_and_go(tmp_path: Path) -> None:
    """A varying limit cycle is confirmed with constant faults. A dropout must not be held too, because that would open the
    loop."""
    compare(*judged(CASE, tmp_path))


def test_numbers_of_faults_are_called_what_they_are() -> None:
    data = described().as_data()
    said = {one["path"]: (one["group"], one["label"]) for one in data["numbers"]}
    assert said["faults[1].size"] == ("Fault 2: spike", "size")
    assert said["shell.rate.x_2"] == ("Shell", "rate of x_2")
    assert said["faults[2].times[0][1]"][1] == "from, to [1,2], s"
    assert said["faults[1].seed"] == ("Fault 2: spike", "seed")
    assert data["fixed"].startswith("The time of a latency has no slider") and "stuck" not in data["fixed"]
    assert data["signals"]["drawing"]["grid"] == GRID
    for fault in data["signals"]["faults"][-len(described().case.problem.faults) :]:
        assert fault.keys() == {"kind", "place", "seed", *DRAWN}
