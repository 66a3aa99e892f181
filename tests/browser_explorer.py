"""Explorers in a real browser: every slider moved, and every figure equal in every bit to a run of the copied case file.

    python tests/browser_explorer.py [CASE ...]

Without names all bundled cases. What is wrong is printed, a line each, and the exit code is 1.
"""

from __future__ import annotations

import random
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, Page

from barbalat import simulate
from barbalat.cases.load import CaseText, bundled, parse_case
from barbalat.explorer.explorer import Explorer
from barbalat.explorer.source import TextSource
from chromium import look, overheard

ROUNDS = 3
"""Settings of every case in which all sliders stand elsewhere, each with a solver of its own."""
SOLVERS = ("rk4", "heun", "euler")
MOVE = """([i, share]) => {
    const slider = document.querySelectorAll('#controls input[type=range]')[i];
    slider.value = Number(slider.value) + Math.sign(share) * Math.ceil(Math.abs(share) * slider.max);
    slider.dispatchEvent(new Event('input'));
    return slider.value;
}"""
READY = "() => document.body.dataset.state === 'ready' && document.querySelector('#figures tr')"


def main(cases: list[str]) -> int:
    """Returns the exit code."""
    with tempfile.TemporaryDirectory() as made:
        return look(lambda browser: [one for case in cases or bundled() for one in of_case(browser, case, Path(made))])


def of_case(browser: Browser, case: str, folder: Path) -> Iterator[str]:
    """What is wrong with a bundled case's explorer."""
    file = Explorer(TextSource(CaseText.read(case))).save(folder / f"{case}.html")
    tab = browser.new_page()
    said = overheard(tab, ("file:", "blob:", "data:"))
    tab.goto(file.as_uri())
    settled(tab)
    sliders = tab.locator("#controls input[type=range]").count()
    said += compared(tab, "as given")
    draw, seen = random.Random(case), [set[str]() for _ in range(sliders)]
    for k in range(ROUNDS):
        for i, places in enumerate(seen):
            places.add(tab.evaluate(MOVE, [i, draw.choice((-1, 1)) * draw.uniform(0.03, 0.1)]))
        tab.select_option("#solver", SOLVERS[k])
        settled(tab)
        said += compared(tab, f"setting {k + 1}")
    said += [f"slider {i} never moved" for i, places in enumerate(seen) if len(places) == 1]
    tab.close()
    yield from (f"{case}: {one}" for one in said)


def settled(tab: Page) -> None:
    """Wait until every run is there and drawn."""
    tab.wait_for_function(READY, timeout=120_000)
    tab.wait_for_timeout(50)
    tab.wait_for_function(READY, timeout=120_000)


def copied(tab: Page) -> str:
    """What *copy as case file* gives."""
    tab.click("#case-file")
    text = tab.input_value("#copied")
    tab.click("#close")
    return text


def compared(tab: Page, when: str) -> Iterator[str]:
    """Every figure on the page against a run of the copied case."""
    text = copied(tab)
    assert tomllib.loads(text)["simulation"]["fused"] is False
    try:
        case = parse_case(text)
    except ValueError as error:
        yield f"{when}: the copied case is refused: {error}"
        return
    runs = simulate(case.problem, case.controllers, case.simulation)
    rows = tab.evaluate("[...document.querySelectorAll('#figures tr')].map(row => JSON.parse(row.dataset.figures))")
    if len(rows) != len(runs):
        yield f"{when}: {len(rows)} rows for {len(runs)} runs"
    for (name, run), figures in zip(runs.items(), rows, strict=False):
        for key, value in run.figures.items():
            if figures.get(key) != value:
                yield f"{when}: {name}: {key} is {figures.get(key)}, and {value} in barbalat run"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
