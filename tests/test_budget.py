"""The budget before work: rejections and their messages, suggested numbers that are accepted, and no work before the check."""

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from barbalat import (
    Case,
    InputError,
    Mrac,
    NetworkMrac,
    ParameterBox,
    Plant,
    Problem,
    ReferenceModel,
    Simulation,
    TransferFunction,
    certify,
    simulate,
)
from barbalat.adaptation.modifications import FixedSigma
from barbalat.budget import DEFAULT_MEMORY, DEFAULT_SECONDS, Estimate, in_force, in_time, largest, require
from barbalat.comparison.tradeoff.tradeoff import trade_off
from barbalat.laws import LeastSquares
from barbalat.linear import systems
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.systems import StateSpace, input_filter
from barbalat.plants import PlantInput
from barbalat.processes import processes
from barbalat.run.engine.check_numerics import check_numerics
from barbalat.run.engine.engine import Batch
from barbalat.run.kernel.members import Reader
from barbalat.signals import Constant
from barbalat.studies import Budget, sweep, tune
from barbalat.studies import contest as hold
from barbalat.study.delay_margin import delay_margins

SHORT, LONG = Simulation(t_end=1.0, dt=1e-3), Simulation(t_end=20.0, dt=1e-4)


def problem(p: int = 2, **plant) -> Problem:
    A_m = np.array([[0.0, 1.0], [-1.0, -2.0]])
    given = {"A_m": A_m, "b": [0.0, 1.0], "theta": np.full(p, 0.1)} | plant
    return Problem(
        plant=Plant(**given),
        reference_model=ReferenceModel(k_0=1.0),
        reference=Constant(1.0),
        uncertainty=ParameterBox(lower=[-1.0] * p, upper=[1.0] * p),
    )


def test_a_budget_is_written_as_people_write_it():
    assert Budget.parse("16GiB,5h") == Budget(memory=2.0**34, seconds=18000.0)
    assert Budget.parse("90 min") == Budget(seconds=5400.0)
    assert Budget.parse(" 0.5 gb ") == Budget(memory=5e8)
    assert Budget() == Budget(memory=DEFAULT_MEMORY, seconds=DEFAULT_SECONDS) == Budget.parse("4GiB,1h")


@pytest.mark.parametrize("text", ["", "5", "h", "5 parsecs", "1h,2h", "-1h", "0h", "nan h", "1e999h", "1GiB;1h", "1GiB,"])
def test_what_is_no_budget_is_refused(text):
    with pytest.raises(InputError, match="--budget"):
        Budget.parse(text)


@pytest.mark.parametrize("given", [{"memory": 0.0}, {"seconds": -1.0}, {"seconds": np.inf}, {"memory": "4GiB"}])
def test_limits_are_positive_numbers(given):
    with pytest.raises(InputError, match=r"budget\."):
        Budget(**given)


def test_the_innermost_budget_is_in_force_and_ends_with_its_statement():
    outer, inner = Budget(seconds=10.0), Budget(seconds=20.0)
    assert in_force() == Budget()
    with outer:
        with inner:
            assert in_force() is inner
        assert in_force() is outer
        with pytest.raises(KeyError), inner:
            raise KeyError
        assert in_force() is outer
    assert in_force() == Budget()


def test_the_number_that_would_do_is_the_largest_that_does():
    def cost(n):
        return Estimate(memory=n**3, seconds=0.01 * n)

    for limits, last in ((Budget(memory=1000.0), 10), (Budget(memory=1e15, seconds=0.52), 52), (Budget(memory=7.0), 1)):
        with limits:
            require("it", last, cost)
            with pytest.raises(InputError, match=rf"^it = {last + 1} would .*: at most {last} would do; --budget"):
                require("it", last + 1, cost)
            with pytest.raises(InputError, match=rf"at most {last} would do"):
                require("it", 10**400, cost)
    with Budget(memory=0.5), pytest.raises(InputError, match=r"1 h: --budget \(in Python Budget\) raises it$"):
        require("it", 3, cost)


@pytest.mark.parametrize("last", [0, 1, 2, 3, 17, 10**9, 10**30 - 1])
def test_the_largest_number_is_found(last):
    assert largest(lambda n: n <= last, 0, 10**30) == last


def test_only_what_is_exceeded_is_named():
    with Budget(memory=100.0, seconds=100.0):
        with pytest.raises(InputError, match="about 200 bytes of memory, more than"):
            require("it", 1, lambda _: Estimate(200.0, 1.0))
        with pytest.raises(InputError, match=r"about 3\.33 min of computing, more than"):
            require("it", 1, lambda _: Estimate(1.0, 200.0))
        with pytest.raises(InputError, match=r"about 200 bytes of memory and 3\.33 min of computing, more than"):
            require("it", 1, lambda _: Estimate(200.0, 200.0))


def test_long_work_is_told_once_and_short_work_never():
    told: list[str] = []
    with Budget(told=told.append):
        for seconds in (1.0, 4.9, 40.0, 30.0, 40.0, 100.0):
            require("n", 1, lambda _, seconds=seconds: Estimate(2.0**30, seconds), what=f"{seconds} s of work")
        require("n", 1, lambda _: Estimate(seconds=1000.0))  # without a word for it nothing is reported
    assert told == [
        "40.0 s of work: estimated at about 40 s of computing and 1 GiB of memory",
        "100.0 s of work: estimated at about 100 s of computing and 1 GiB of memory",
    ]


def test_times_are_read_in_their_own_unit():
    times = [1.0, 119.0, 120.0, 3600.0, 2 * 86400.0, 1e9]
    assert [in_time(t) for t in times] == ["1 s", "119 s", "2 min", "1 h", "2 days", "31.7 years"]


@dataclass(frozen=True)
class Size:
    """A number that determines a size, and its use.

    huge    value that is rejected within the budget, without a change
    said    in the rejection
    budget  within which ``small`` is rejected, and less is quickly done; none where a limit is no budget's
    """

    use: Callable[[int], object]
    huge: int
    said: str
    small: int = 0
    budget: Budget | None = None


def recorded(points: int) -> Simulation:
    """Its own check is left out for a loop of common size."""
    with Budget(memory=1e30):
        return Simulation(t_end=10.0, dt=1e-6, record_points=points)


def network(neurons: int) -> NetworkMrac:
    return NetworkMrac(gamma=1.0, leakage=FixedSigma(0.1), neurons=neurons)


def stable(n: int) -> StateSpace:
    return StateSpace(-np.eye(n), np.ones(n), np.ones(n), 0.0)


SIZES = {
    "filter.order": Size(lambda n: input_filter(0.1, n), 10**18, "filter.order must be a whole number from 1 to 100"),
    "num": Size(
        lambda n: TransferFunction(np.ones(n), [1.0]), 10**6, "num has 1000000 coefficients", 30, Budget(memory=20_000.0)
    ),
    "den": Size(
        lambda n: TransferFunction([1.0], np.ones(n)), 10**6, "den has 1000000 coefficients", 30, Budget(memory=20_000.0)
    ),
    "states of a plant": Size(
        lambda n: Plant(A_m=-np.eye(n), b=np.eye(n), theta=np.zeros((n, n))),
        3000, "plant.A_m is 3000 x 3000", 12, Budget(memory=7000.0),
    ),
    "neurons": Size(lambda n: network(n).bind(problem().known), 10**9, "neurons = 1000000000", 40, Budget(seconds=0.6)),
    "estimates of a least-squares law": Size(
        lambda n: LeastSquares(covariance0=1.0).initial(n), 3000, "law has a matrix for 3000 parameters", 12, Budget(seconds=0.6)
    ),
    "steps": Size(
        lambda n: Simulation(t_end=2.0, dt=2.0 / n, record_points=2), 10**200, "simulation.dt = 2e-200 makes 1e+200 steps", 1000,
        Budget(seconds=1e-5),
    ),
    "steps of a run": Size(
        lambda n: simulate(problem(), Mrac(gamma=1.0), Simulation(t_end=n * 1e-3, dt=1e-3, record_points=10)), 3 * 10**10,
        "simulation.t_end = 3e+07 s has 3e+10 steps of 0.001 s", 4_000_000, Budget(seconds=0.6),
    ),
    "record_points": Size(
        lambda n: Simulation(t_end=1.0, dt=1e-9, record_points=n), 10**8, "simulation.record_points = 100000000", 1000,
        Budget(memory=1e5),
    ),
    "record_points of a run": Size(
        lambda n: simulate(problem(), [Mrac(gamma=1.0), Mrac(gamma=2.0)], recorded(n)), 3 * 10**6,
        "simulation.record_points = 3000000 for 2 controllers", 10_000, Budget(memory=6e6),
    ),
    "delay": Size(
        lambda n: simulate(problem(input=PlantInput(delay=n * 2.0**-10)), [Mrac(gamma=1.0, name=f"{i}") for i in range(20)],
                           Simulation(t_end=1.0, dt=2.0**-10)),
        9_000_000, "delay = 8789.06 s, 9000000 steps of 0.000976562 s that each of 20 runs", 10**6, Budget(memory=1e8),
    ),
    "scanned delays": Size(
        lambda n: delay_margins(problem(), Mrac(gamma=1.0), LONG, scan=n, longest=0.05), 10**12, "scan = 1000000000000 delays",
        300, Budget(seconds=0.25),
    ),
    "states of an L1 norm": Size(
        lambda n: l1_norm(stable(n)), 3000, "the system of an L1 norm has 3000 states", 6, Budget(memory=26_000.0)
    ),
    "states and frequencies": Size(
        lambda n: stable(n).response(np.linspace(1, 2, 1000)), 2000, "has 2000 states, and 1000 frequency responses", 20,
        Budget(seconds=0.01),
    ),
    "drawn members": Size(
        lambda n: sweep(CASE, sample={"plant.theta[0]": "uniform:-1:1"}, members=n, bounds=False), 10**9,
        "the sweep of 1000000000 members", 20_000, Budget(seconds=0.1),
    ),
    "points of a grid": Size(
        lambda n: sweep(CASE, vary={"plant.theta[0]": f"-1:1:{n // 5}", "controller[0].gamma": "1:2:5"}, bounds=False),
        5 * 10**7,
        "the sweep of 50000000 members at 50000000 points of a grid", 20_000, Budget(seconds=0.1),
    ),
    "plants of a tuning": Size(lambda n: tune(CASE, "rms_e", vary=GAIN, plants=n), 10**9, "plants = 1000000000"),
    "trials of a tuning": Size(lambda n: tune(CASE, "rms_e", vary=GAIN, trials=n), 10**9, "trials = 1000000000"),
    "plants of a trade-off": Size(lambda n: trade_off(problem(), SHORT, plants=n), 10**9, "plants = 1000000000"),
    "density": Size(lambda n: trade_off(problem(), SHORT, density=n), 10**9, "density = 1000000000"),
    "plants of a contest": Size(lambda n: hold(CASE, plants=n), 10**9, "plants = 1000000000"),
    "trials of a contest": Size(lambda n: hold(CASE, trials=n), 10**9, "trials = 1000000000"),
    "members of a contest": Size(lambda n: hold(CASE, members=n), 10**9, "members = 1000000000"),
}  # fmt: skip
CASE = Case(problem(), (Mrac(gamma=1.0),), SHORT)
GAIN = {"controller[0].gamma": "1:10"}


@pytest.mark.parametrize("name", SIZES)
def test_a_huge_number_is_refused_before_anything_is_built(name, monkeypatch):
    """Tracing, compiling, searching and drawing would fail here. The test below detects mere allocation."""
    for kind, work in ((Reader, "_trace"), (Batch, "__post_init__")):
        monkeypatch.setattr(kind, work, lambda *_: pytest.fail("work was begun"))
    with pytest.raises(InputError, match=re.escape(SIZES[name].said)) as refused:
        SIZES[name].use(SIZES[name].huge)
    assert len(refused.value.sentences) == 1
    assert SIZES[name].budget is None or "--budget (in Python Budget) raises it" in str(refused.value)


@pytest.mark.parametrize("name", [name for name, size in SIZES.items() if size.budget is not None])
def test_the_number_that_would_do_does(name):
    """The suggestion is in the terms of the number: entries, states, steps, members, or the step and the horizon with as many
    steps."""
    size = SIZES[name]
    with size.budget:
        with pytest.raises(InputError) as refused:
            size.use(size.small)
        most = would_do(str(refused.value))
        assert most < size.small
        size.use(most)
        with pytest.raises(InputError):
            size.use(2 * most + 2)


def would_do(sentence: str) -> int:
    """The number in a rejection."""
    if found := re.search(r"at most (\d+)", sentence):
        return int(found[1])
    if found := re.search(r"or a step of (\S+) s, would do", sentence):
        return round(2.0 / float(found[1]))
    return int(float(re.search(r"a t_end of ([\d.]+) s", sentence)[1]) / 1e-3)


LIMITED = """
import resource, sys
sys.path.insert(0, {tests!r})
import test_budget as t
resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30,) * 2)
for name, size in t.SIZES.items():
    try:
        size.use(size.huge)
    except t.InputError as error:
        assert size.said in str(error), error
        print(name)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit a process's memory so")
def test_no_refusal_takes_memory():
    """Every rejection is raised in one process that may use at most 3 GiB of address space, libraries included."""
    script = LIMITED.format(tests=str(Path(__file__).parent))
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=300)
    assert run.stdout.splitlines() == list(SIZES), run.stderr[-2000:]


def test_a_smaller_budget_reaches_processes():
    with Budget(seconds=7.0, memory=2.0**33, told=print), processes(1) as pool:
        assert pool.submit(in_force).result() == Budget(seconds=7.0, memory=2.0**33)


def test_the_finer_run_of_a_check_keeps_to_the_budget():
    """An additional check never rejects a computed run but continues as far as the budget allows."""
    stiff = Simulation(t_end=2.0, dt=1e-3)
    results = simulate(problem(), Mrac(gamma=1e9), stiff)
    assert results["MRAC"].label is not None
    with Budget(seconds=0.2):  # the loop's equations alone take 0.03 s by estimate
        check = check_numerics(results)["MRAC"].check
    assert check is not None and check_numerics(results)["MRAC"].check is not None


def test_a_margin_beyond_the_budget_is_left_out_with_the_reason():
    with Budget(seconds=1.1):
        (found,) = certify(problem(), network(30), SHORT).values()
    with Budget(seconds=2.0):
        (large,) = certify(problem(), network(60), SHORT).values()
    beyond = large.entry("delay_margin")
    assert beyond is not None and beyond.value is None
    assert "states, and its equilibrium and modes would take" in beyond.why
    entry = found.entry("delay_margin_adapting")
    assert entry is not None and entry.value is None
    assert re.search(r"the linear loop has \d+ states, and \d+ frequency responses would take", entry.why)


def test_many_frequencies_are_solved_in_parts_with_the_same_bits(monkeypatch):
    system, w = (
        StateSpace(np.array([[0.0, 1.0], [-2.0, -0.1]]), np.array([0.0, 1.0]), np.array([1.0, 0.0]), 0.5),
        np.geomspace(1e-2, 1e2, 1001),
    )
    whole = system.response(w)
    monkeypatch.setattr(systems, "SOLVED_AT_ONCE", 40)
    assert (system.response(w) == whole).all()
    assert np.allclose(whole, system.transfer_function().at(1j * w), rtol=1e-12)  # ten thousand roundings
    assert system.response(np.zeros(0)).shape == (0,)


def test_too_many_controllers_are_told_how_many_would_do():
    """The same budget allows this many, and one more is rejected."""

    def ran(count, budget):
        with budget:
            return simulate(problem(), [Mrac(gamma=1.0 + i, name=f"{i}") for i in range(count)], recorded(10))

    budget = Budget(memory=2e7)
    with pytest.raises(InputError, match="the case has 60 controllers, each with a separate kernel") as refused:
        ran(60, budget)
    most = int(re.search(r"at most (\d+) controllers would do", str(refused.value))[1])
    assert len(ran(most, budget)) == most
    with pytest.raises(InputError, match="controllers"):
        ran(most + 1, budget)
