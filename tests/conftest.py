"""Problems that many tests share, and the selection of the tests that run only with the full command."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest

from barbalat.problem.state_feedback import ParameterBox, Plant, Problem, ReferenceModel
from barbalat.signals import Sine, Sines
from turns import drawn, once

if TYPE_CHECKING:
    from barbalat.papers.jafari_2013.section_v import Runs


gc.set_threshold(50_000, 50)  # as every command sets it; scanning what is imported took a fifth of the collection's time
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")  # the duration of an example depends on the machine; a test that checks it is flaky


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="all tests, every random-problem test with all its problems")
    parser.addoption("--rest", action="store_true", help="what --full runs and the short command does not")
    parser.addoption("--one-in", type=int, default=1, help="of these tests one in so many, which the sources' commit draws")
    parser.addoption("--cases-in", type=int, default=1, help="of each test's cases one in so many, which the commit draws")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Without an option, tests marked ``full`` or outside a ``short`` mark are left out."""
    everything, rest, one_in = config.getoption("full"), config.getoption("rest"), config.getoption("one_in")
    cases_in = config.getoption("cases_in")
    if everything and rest:
        raise pytest.UsageError("--full runs everything, --rest what is left out without it: give one of them")
    for option, number in (("--one-in", one_in), ("--cases-in", cases_in)):
        if number < 1:
            raise pytest.UsageError(f"{option} takes 1, which keeps all, or more, but got {number}")
    kept = items if everything else [item for item in items if _left_out(item) == rest or (rest and _draws_samples(item))]
    kept = _cases_drawn(drawn(kept, -(-len(kept) // one_in)), cases_in)
    chosen = set(kept)
    config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
    items[:] = kept


def _cases_drawn(items: list[pytest.Item], one_in: int) -> list[pytest.Item]:
    """Every test with a draw from its cases, at least one, or with all cases if the test is cheap. Each test has a separate draw,
    and the expensive tests of all files share one draw."""
    cases: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("dear"):
            test = "the dear ones"
        else:
            test = item.nodeid if item.get_closest_marker("cheap") else item.nodeid.partition("[")[0]
        cases.setdefault(test, []).append(item)
    kept = {one for name, of_one in cases.items() for one in drawn(of_one, -(-len(of_one) // one_in), name)}
    return [item for item in items if item in kept]


def _left_out(item: pytest.Item) -> bool:
    """Whether only the full command runs the test."""
    if item.get_closest_marker("full"):
        return True
    parameters = item.callspec.params if hasattr(item, "callspec") else {}
    return not all(marker.kwargs["kept"](**parameters) for marker in item.iter_markers("short"))


def _draws_samples(item: pytest.Item) -> bool:
    return not {"sample", "by_turns"}.isdisjoint(getattr(item, "fixturenames", ()))


@pytest.fixture(autouse=True)
def _figures_closed() -> Iterator[None]:
    """After a test has imported pyplot, pyplot keeps every plotted figure and warns if there are too many."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")


@pytest.fixture(scope="session")
def sample(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """``sample(short, full)`` is the number of random problems that a test draws. With --rest it is a quarter of all, but no
    fewer than in the short tests.

    If ``full`` is smaller than ``short``, both are strides over a list, and with --rest the stride is four times ``full``.
    """
    if request.config.getoption("full"):
        return lambda short, full: full
    if request.config.getoption("rest"):
        return lambda short, full: max(short, full // 4) if full > short else min(short, 4 * full)
    return lambda short, full: short


@pytest.fixture(scope="session")
def by_turns(request: pytest.FixtureRequest) -> Callable[[Sequence[Any], int], list[Any]]:
    """``by_turns(items, few)`` returns ``few`` of the items in the short tests, a tenth with --rest, each selected by the commit,
    and all with --full."""
    if request.config.getoption("full"):
        return lambda items, few: list(items)
    if request.config.getoption("rest"):
        return lambda items, few: drawn(items, max(-(-len(items) // 10), few))
    return lambda items, few: list(items[:few])


@pytest.fixture(scope="session", autouse=True)
def _optimised_code(request: pytest.FixtureRequest) -> Iterator[None]:
    """Most tests have short runs, so their code is compiled without optimisation. The full command optimises all code, as for
    long runs."""
    with pytest.MonkeyPatch.context() as changed:
        if request.config.getoption("full") or request.config.getoption("rest"):
            changed.setattr("barbalat.run.kernel.step.STEPS_WORTH_OPTIMISING", 0)
        yield


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder through which pytest's processes share results: see ``turns.once``."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def section_v_runs(shared: Path) -> Runs:
    """All runs of Section V, as ``reproduce`` makes them; no test changes them."""
    from barbalat.papers.jafari_2013 import section_v

    return once(shared, "section-v", section_v.run)


def _section_v() -> Problem:
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-0.3, -1.0]], b=[0.0, 1.0], theta=[4.0, -3.0], x0=[1.0, 1.0]),
        reference_model=ReferenceModel(k_0=4.0),
        reference=Sine(amplitude=50.0, frequency=0.5),
        uncertainty=ParameterBox(lower=[-5.0, -5.0], upper=[5.0, 5.0]),
        name="Section V",
    )


def _first_order() -> Problem:
    return Problem(
        plant=Plant(A_m=[[-1.0]], b=[2.0], theta=[1.5], x0=[0.5]),
        reference_model=ReferenceModel(k_0=0.5),
        reference=Sine(amplitude=2.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-3.0], upper=[3.0]),
        name="first order",
    )


def _second_order() -> Problem:
    return Problem(
        plant=Plant(A_m=[[0.0, 1.0], [-2.0, -3.0]], b=[0.0, 1.0], theta=[1.0, -0.5], x0=[0.5, -0.5]),
        reference_model=ReferenceModel(k_0=2.0),
        reference=Sine(amplitude=2.0, frequency=1.0),
        uncertainty=ParameterBox(lower=[-2.0, -2.0], upper=[2.0, 2.0]),
        name="second order",
    )


def _third_order() -> Problem:
    return Problem(
        plant=Plant(
            A_m=[[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -11.0, -6.0]],  # poles -1, -2, -3
            b=[0.0, 0.0, 1.0],
            theta=[1.0, -1.0, 0.5],
            x0=[0.3, 0.0, -0.2],
        ),
        reference_model=ReferenceModel(k_0=6.0),
        reference=Sines(amplitudes=(1.0, 1.0), frequencies=(0.7, 2.3)),
        uncertainty=ParameterBox(lower=[-2.0, -2.0, -2.0], upper=[2.0, 2.0, 2.0]),
        name="third order",
    )


@pytest.fixture(scope="session")
def section_v() -> Problem:
    """Equations.md, section 9."""
    return _section_v()


@pytest.fixture(scope="session")
def first_order() -> Problem:
    return _first_order()


@pytest.fixture(scope="session")
def third_order() -> Problem:
    return _third_order()


@pytest.fixture(scope="session")
def problems() -> dict[int, Problem]:
    """One well-conditioned problem for each order, with all numbers of order one so that absolute errors are meaningful."""
    return {1: _first_order(), 2: _second_order(), 3: _third_order()}
