"""Explorers in a real browser: every slider is moved, and every metric must be identical to the metric from a run of the copied
case file.

    python tests/browser_explorer.py [CASE ...] [--one-in N]

A case is the name of a bundled case or a file; without cases all bundled ones are checked. With --one-in the commit draws
one in so many of them. Each fault is printed on a line, and the exit code is then 1.
"""

from __future__ import annotations

import argparse
import math
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
from turns import drawn

Figures = dict[str, float | list[float] | None]
ROUNDS = 3
"""Number of settings of every case in which all sliders are moved, each with a different solver."""
SOLVERS = ("rk4", "heun", "euler")
MOST_TRIES = 20
"""The moves of a single slider. At its end it can move in one direction only."""
MOVE = """([i, share]) => {
    const slider = document.querySelectorAll('#controls input[type=range]')[i];
    const before = slider.value;
    slider.value = Number(slider.value) + Math.sign(share) * Math.ceil(Math.abs(share) * slider.max);
    slider.dispatchEvent(new Event('input'));
    return [before, slider.value];
}"""
SWITCHED = "() => document.querySelectorAll('input[id^=projection-]').forEach(box => box.click())"
ROWS = """() => Object.fromEntries([...document.querySelectorAll('#figures tr')]
    .map(row => [row.cells[0].textContent, JSON.parse(row.dataset.figures)]))"""
NUMERICS = """() => Object.fromEntries([...document.querySelectorAll('#figures tr')]
    .map(row => [row.cells[0].textContent, JSON.parse(row.dataset.numerics)]))"""
EIGENVALUES_WITHIN = 1e-6
"""Relative tolerance of h|lambda|. The page and the run evaluate the same states with different routines. A double eigenvalue is
accurate to only half of the digits, about 1e-8."""
READY = "() => document.body.dataset.state === 'ready' && document.querySelector('#figures tr')"


def main(arguments: list[str]) -> int:
    """Check the cases and return the exit code."""
    parser = argparse.ArgumentParser(prog="browser_explorer.py")
    parser.add_argument("cases", nargs="*")
    parser.add_argument("--one-in", type=int, default=1, help="of the cases one in so many, which the commit draws")
    given = parser.parse_args(arguments)
    if given.one_in < 1:
        parser.error(f"--one-in takes 1, which keeps all, or more, but got {given.one_in}")
    cases = given.cases or list(bundled())
    chosen = drawn(cases, -(-len(cases) // given.one_in), "explorers")
    with tempfile.TemporaryDirectory() as made:
        return look(lambda browser: [one for case in chosen for one in of_case(browser, case, Path(made))])


def of_case(browser: Browser, case: str, folder: Path) -> Iterator[str]:
    """The faults of a case's explorer."""
    file = Explorer(TextSource(CaseText.read(case))).save(folder / f"{Path(case).stem}.html")
    tab = browser.new_page()
    said = overheard(tab, ("file:", "blob:", "data:"))
    tab.goto(file.as_uri())
    settled(tab)
    sliders = tab.locator("#controls input[type=range]").count()
    said += compared(tab, "as given")
    draw, seen = random.Random(case), [set[str]() for _ in range(sliders)]
    for k in range(ROUNDS):
        tab.click("#reset")
        for i in draw.sample(range(sliders), sliders):  # if two exclude each other, the first one is moved
            _move(tab, i, seen, draw)
        tab.select_option("#solver", SOLVERS[k])
        if k % 2:
            tab.evaluate(SWITCHED)
        settled(tab)
        said += compared(tab, f"setting {k + 1}")
    for i in (i for i, places in enumerate(seen) if len(places) == 1):
        tab.click("#reset")
        for _ in (number for number in range(MOST_TRIES) if len(seen[i]) == 1):
            _move(tab, i, seen, draw)
        settled(tab)
        said += compared(tab, f"slider {i} alone")
    said += [f"slider {i} never moved" for i, places in enumerate(seen) if len(places) == 1]
    tab.close()
    yield from (f"{case}: {one}" for one in said)


def _move(tab: Page, slider: int, seen: list[set[str]], draw: random.Random) -> None:
    """Move the slider by a part of its length; ``seen`` lists all its earlier positions."""
    seen[slider] |= set(tab.evaluate(MOVE, [slider, draw.choice((-1, 1)) * draw.uniform(0.03, 0.1)]))


def settled(tab: Page) -> None:
    """Wait until every run is finished and drawn."""
    tab.wait_for_function(READY, timeout=120_000).dispose()


def copied(tab: Page) -> str:
    """The text that *copy as case file* produces."""
    tab.click("#case-file")
    text = tab.input_value("#copied")
    tab.click("#close")
    return text


def compared(tab: Page, when: str) -> Iterator[str]:
    """Compares every metric on the page with a run of the copied case."""
    text, rows = copied(tab), tab.evaluate(ROWS)
    if len(rows) != tab.locator("input[id^=shown-]:checked").count():
        yield f"{when}: rows for {', '.join(rows) or 'nothing'}"
    yield from differences(text, rows, when)


def differences(text: str, rows: dict[str, Figures], when: str) -> Iterator[str]:
    """Differences between the metrics of each controller and a run of the case file's text."""
    assert tomllib.loads(text)["simulation"]["fused"] is False
    try:
        case = parse_case(text)
    except ValueError as error:
        yield f"{when}: the copied case is refused: {error}"
        return
    shown = [controller for controller in case.controllers if controller.name in rows]
    if len(rows) != len(shown):
        yield f"{when}: rows for {', '.join(rows) or 'nothing'}"
    runs = simulate(case.problem, shown, case.simulation)
    for name, figures in rows.items():
        run = runs[name]
        for key, value in run.figures.items():
            if figures.get(key) != value:
                yield f"{when}: {name}: {key} is {figures.get(key)}, and {value} in barbalat run"


def judged_alike(tab: Page, when: str) -> Iterator[str]:
    """Whether the page's statement on the step agrees with a run of the copied case."""
    case, said = parse_case(copied(tab)), tab.evaluate(NUMERICS)
    shown = [controller for controller in case.controllers if controller.name in said]
    for name, run in simulate(case.problem, shown, case.simulation).items():
        found = run.stiffness
        if not math.isclose(said[name]["hLambda"], found.h_lambda_max, rel_tol=EIGENVALUES_WITHIN):
            yield f"{when}: {name}: h|lambda| is up to {said[name]['hLambda']}, and {found.h_lambda_max} in barbalat run"
        if said[name]["unstable"] != found.unstable_from:
            yield f"{when}: {name}: unstable from {said[name]['unstable']}, and from {found.unstable_from} in barbalat run"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
