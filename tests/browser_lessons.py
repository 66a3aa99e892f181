"""The lessons of Section V in a real browser: no goal is reached at the start, each is reached by its example, and all metrics
equal the simulator's bit for bit.

    python tests/browser_lessons.py

Each fault is printed on a line, and the exit code is then 1.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, Page

from barbalat import certify
from barbalat.cases.load import parse_case
from barbalat.explorer.section_v import PAGES, explorer
from browser import at_both_widths, tabs
from browser_explorer import compared, copied, judged_alike, settled
from chromium import look, overheard

CONDITIONS = "() => [...document.querySelectorAll('#conditions [data-condition]')].map(one => one.dataset.condition)"
LONG, NEXT = "figure-4", "small-gain"
"""A lesson that takes seconds, and one that is chosen before they have passed."""
MARKED = "() => document.querySelectorAll('[aria-busy=true]').length"
CHOSEN = """async (lesson) => {
    const choice = document.querySelector('[data-part=choice]');
    choice.value = lesson;
    choice.dispatchEvent(new Event('change'));
    await new Promise((done) => setTimeout(done, 500));
    const marked = ['verdicts', 'charts', 'figures'].every((id) => document.getElementById(id).closest('[aria-busy=true]'));
    return [marked, document.getElementById('running')?.textContent ?? '', document.body.dataset.state === 'ready'];
}"""
ESTIMATE_ERROR = 1e-3
"""Tolerance of a trapezoidal sum with steps of 0.02 divided by the matrix's norm. The sum is inaccurate where a component changes
its sign."""


def main() -> int:
    """Check the lessons and return the exit code."""
    with tempfile.TemporaryDirectory() as made:
        return look(lambda browser: [one for file in PAGES for one in of_page(browser, explorer(file).save(Path(made) / file))])


def of_page(browser: Browser, file: Path) -> Iterator[str]:
    """The faults of a page and its lessons."""
    tab = browser.new_page()
    said = overheard(tab, ("file:", "blob:", "data:"))
    tab.goto(file.as_uri())
    settled(tab)
    for lesson in PAGES[file.name]:
        tab.select_option("[data-part=choice]", lesson.key)
        said += [f"{lesson.key}: {one}" for one in taught(tab)]
        if "kappa" in lesson.key or "bias" in lesson.key:
            said += [f"{lesson.key}: {one}" for one in estimated(tab)]
    said += by_address(tab, file)
    if LONG in {lesson.key for lesson in PAGES[file.name]}:
        said += hurried(tab)
    tab.close()
    yield from (f"{file.name}: {one}" for one in said)
    yield from at_both_widths(tabs(browser), file.name, f"{file.as_uri()}#lesson={PAGES[file.name][-1].key}")


def taught(tab: Page) -> Iterator[str]:
    """The faults of the chosen lesson, from its beginning to its example."""
    settled(tab)
    if goal(tab) != "open":
        yield f"its goal is {goal(tab)} from the beginning"
    yield from judged_alike(tab, "its beginning")
    tab.click("[data-part=example]")
    settled(tab)
    if goal(tab) != "reached":
        yield f"its example does not reach the goal: {tab.text_content('[data-part=said]')}"
    yield from compared(tab, "its example")
    yield from judged_alike(tab, "its example")


def estimated(tab: Page) -> Iterator[str]:
    """Compare the page's estimate of the condition on the filter with the certificate of the copied case."""
    case = parse_case(copied(tab))
    found = [float(value) for value in tab.evaluate(CONDITIONS)]
    certified = certify(case.problem, [one for one in case.controllers if one.name == "L1"], case.simulation)
    wanted = [certified["L1"].values["condition"]["value_upper"]]
    if len(found) != 1 or abs(found[0] / wanted[0] - 1) > ESTIMATE_ERROR:
        yield f"the condition is estimated as {found}, and certified as {wanted}"


def by_address(tab: Page, file: Path) -> Iterator[str]:
    """A lesson whose example is in the address opens with its goal reached. Shares refer to its initial state."""
    lesson = PAGES[file.name][0]
    numbers = "".join(f"&{path}={value}" for path, value in lesson.example.items())
    tab.goto("about:blank")
    tab.goto(f"{file.as_uri()}#lesson={lesson.key}{numbers}")
    settled(tab)
    if goal(tab) != "reached":
        yield f"the address of {lesson.key} with its example opens as {goal(tab)}"


def hurried(tab: Page) -> Iterator[str]:
    """The faults of a page on which a lesson is chosen while another one runs: it must mark the results that it still shows as
    earlier ones, and end with those of the last lesson."""
    for lesson in (LONG, NEXT):
        marked, said, ready = tab.evaluate(CHOSEN, lesson)
        if ready and lesson == LONG:
            yield f"{lesson} is too short to show what the page says while it runs"
        if not ready and not (marked and said.endswith("The panels show the previous setting.")):
            yield f"{lesson}: the results of the lesson before are not marked, and the page says {said!r}"
    settled(tab)
    if tab.evaluate(MARKED):
        yield f"{NEXT}: its own results are marked as earlier ones"
    yield from compared(tab, f"{NEXT} after {LONG}")


def goal(tab: Page) -> str | None:
    """Whether the page reports that the goal is reached."""
    return tab.get_attribute("#lessons", "data-goal")


if __name__ == "__main__":
    sys.exit(main())
