"""How fast Section V's page follows a slider in Chromium compared with the native kernel, and whether its memory grows.

    python tests/browser_speed.py

Times are printed and not judged, because they depend on this machine and its load. Growing memory is a finding, with exit code 1.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import CDPSession, Page

from barbalat.explorer.section_v import explorer
from barbalat.explorer.source import Source
from barbalat.problem.tracking import TrackingProblem
from barbalat.protocols import Controller
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel.grid import segments_of, signal_table
from barbalat.solvers.simulation import Simulation
from browser_explorer import settled
from chromium import launched

MRAC = 2
"""The controller's index in the case."""
MOVES, RUNS, PARTS = 21, 500, 5
"""Moves of a slider for a median, and for the memory, which is measured PARTS times."""
MOST_GROWTH = 400_000
"""Largest growth of the heap in bytes over RUNS runs, after garbage collection. A single run records more than this, so this
limit shows that no run is kept."""
MOVE = """([id, by]) => {
    const slider = document.getElementById(id);
    slider.value = Number(slider.value) + by;
    slider.dispatchEvent(new Event('input'));
}"""
FOLLOWED = """async ([id, runs]) => {
    const slider = document.getElementById(id);
    for (let k = 0; k < runs; k++) {
        slider.value = Number(slider.value) + (k % 2 ? 1 : -1);
        slider.dispatchEvent(new Event('input'));
        do await new Promise(requestAnimationFrame); while (document.body.dataset.state !== 'ready');
    }
}"""
"""Make this many runs without messages in between, because the memory that the driver keeps for each message would be counted."""
SLIDERS = """() => Object.fromEntries([...document.querySelectorAll('#controls .number')].map(one => [
    `${one.parentElement.querySelector('summary').textContent}, ${one.querySelector('label').textContent}`,
    one.querySelector('input[type=range]').id]))"""
ALONE = """(i) => document.querySelectorAll('input[id^=shown-]').forEach((box, k) => {
    if (box.checked !== (k === i)) box.click();
})"""
"""Simulate only this controller."""
TOLD = "() => ({...document.body.dataset})"
PAINT = "() => performance.getEntriesByName('first-contentful-paint')[0].startTime"
MOVED = {"L1": "L1, Γ", "MRAC": "MRAC, Γ", "all three": "Plant, θ [1]"}
"""The sliders that are moved, and the number of controllers that follow."""


def main() -> int:
    """Measure and return the exit code."""
    made_from = explorer("explorer.html")
    began = time.perf_counter()
    text = made_from.html
    print(f"the page is made in {time.perf_counter() - began:.1f} s and has {len(text.encode()) / 1e3:.0f} kB")  # noqa: T201
    with tempfile.TemporaryDirectory() as folder:
        file = made_from.save(Path(folder) / "explorer.html")
        with launched() as browser:
            tab = browser.new_page()
            tab.goto(file.as_uri())
            settled(tab)
            print(f"first paint after {tab.evaluate(PAINT):.0f} ms")  # noqa: T201
            _follows(tab)
            _beside_native(tab, made_from.source)
            return _grows(tab, tab.context.new_cdp_session(tab))


def _follows(tab: Page) -> None:
    sliders = tab.evaluate(SLIDERS)
    for name, label in MOVED.items():
        times = []
        for k in range(MOVES):
            tab.evaluate(MOVE, [sliders[label], -1 if k % 2 else 1])
            settled(tab)
            times.append(float(tab.evaluate(TOLD)["milliseconds"]))
        told = tab.evaluate(TOLD)
        print(f"{name}: workers took {told['simulating']} ms, kernels {told['stepping']} ms of them, the last time")  # noqa: T201
        print(f"{name}: the picture follows in {statistics.median(times):.0f} ms at the median, {min(times):.0f} at best")  # noqa: T201


def _beside_native(tab: Page, source: Source) -> None:
    """Nanoseconds for each step, the best of several runs, one controller after the other. The page and the kernel alternate."""
    case = source.at({})
    sliders, steps = tab.evaluate(SLIDERS), case.simulation.steps
    for i, controller in enumerate(case.controllers):
        tab.evaluate(ALONE, i)
        settled(tab)
        page, native = [], []
        for k in range(7):
            tab.evaluate(MOVE, [sliders["Plant, θ [1]"], -1 if k % 2 else 1])
            settled(tab)
            page.append(float(tab.evaluate(TOLD)["stepping"]) * 1e6 / steps)
            native.append(_native(case.problem, controller, case.simulation) * 1e9 / steps)
        ratio = min(page) / min(native)
        print(f"{controller.name}: {min(page):.0f} ns a step in the page, {min(native):.0f} native: {ratio:.2f} times")  # noqa: T201


def _native(problem: TrackingProblem, controller: Controller, simulation: Simulation) -> float:
    """Seconds in the kernel for the same run, divided into the same calls."""
    batch = Batch.of([(problem, controller)], simulation, record=True)
    (group,), spent = batch.groups, 0.0
    for segment in segments_of(simulation, recorded=True):
        in_pieces = batch.program.shape.in_pieces
        table = signal_table(problem.signals, simulation, segment.start, segment.steps, in_pieces=in_pieces)
        began = time.thread_time()  # without the time used by other programs
        group.call(segment.start, segment.blocks, segment.length, group.state, table)
        spent += time.thread_time() - began
    return spent


def _grows(tab: Page, tools: CDPSession) -> int:
    tab.evaluate(ALONE, MRAC)
    slider = tab.evaluate(SLIDERS)["MRAC, Γ"]
    heap = []
    for _ in range(PARTS + 1):
        tab.evaluate(FOLLOWED, [slider, RUNS // PARTS])
        tools.send("HeapProfiler.collectGarbage")
        heap.append(tools.send("Runtime.getHeapUsage")["usedSize"])
    grown = heap[-1] - heap[0]
    told = ", ".join(f"{used / 1e6:.2f}" for used in heap)
    print(f"the heap every {RUNS // PARTS} runs: {told} MB, {grown / 1e3:+.0f} kB after the first {RUNS // PARTS}")  # noqa: T201
    return int(grown > MOST_GROWTH)


if __name__ == "__main__":
    sys.exit(main())
