"""Mutated case files: each one runs and is certified or is rejected in one sentence, within a time limit, and the JSON is
strict."""

import copy
import json
import random
import signal
import sys
import tomllib
from contextlib import contextmanager

import pytest

from barbalat.cases.bundled import bundled
from barbalat.cli import main
from independent import as_toml

SECONDS = 60
"""Time limit for a mutant. The slowest known one takes a few seconds on an idle machine."""
EXTREMES = (
    0, 1, -1, 0.0, -0.0, 5e-324, 1e-300, 1e-12, 1e12, 1e200, 1.7e308, -1e300, 2**31, 2**63, 2**64, 2**64 + 1, 10**400,
    float("inf"), float("nan"), True, "", "x", "1e3", [], [[]], {}, [1.0], [1e300, -1e300], "[/b]", "$\\frac{$", "\x1b[31m",
    "x" * 300, "日本語", "0.5*sin(y)", "x1/0", "sine", "midpoint", "l1", "euler",
)  # fmt: skip
"""Values that have caused a failure or might cause one."""
EARLY = {"t_end": 0.1, "dt": 0.001}
"""Simulation settings of every mutant, unless they are mutated themselves. A run is so short that the tests mainly cover
everything else."""
MOST_STEPS = 1000
EARLY_OUTPUT = {"t_end": 0.01, "dt": 0.0001}
"""The corresponding value for output feedback, where the plants are fast."""


def places(table, path=()):
    """The paths of all values of nested tables and lists."""
    keys = table.keys() if isinstance(table, dict) else range(len(table))
    for key in keys:
        yield (*path, key)
        if isinstance(table[key], (dict, list)):
            yield from places(table[key], (*path, key))


def mutated(rng, case, donors):
    """A case with up to three changes: a value is scaled or replaced, a key is left out, or a key of a different case is
    inserted."""
    case = copy.deepcopy(case)
    for _ in range(rng.randint(1, 3)):
        paths = [path for path in places(case) if path != ("controller",)]
        *above, last = rng.choice(paths)
        table = case
        for key in above:
            table = table[key]
        value, change = table[last], rng.random()
        if isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300 and change < 0.6:
            factor = 10.0 ** rng.uniform(-300, 300) if change < 0.3 else rng.choice((-1, 2, 0.5, 1e3, 1e-3, 1e6))
            table[last] = value * factor
        elif change < 0.75:
            table[last] = copy.deepcopy(rng.choice(EXTREMES))
        elif change < 0.85:
            del table[last]
        else:
            graft(rng, case, rng.choice(donors))
    return within_reason(case)


def within_reason(case):
    """Whether a run is short enough. A run of 10^8 steps is valid but too long for a test."""
    simulation = case.get("simulation")
    times = [simulation.get(key) for key in ("t_end", "dt")] if isinstance(simulation, dict) else [None]
    if all(type(time) in (int, float) and 0 < time < 1e300 for time in times) and times[0] > MOST_STEPS * times[1]:
        simulation["t_end"] = MOST_STEPS * times[1]
    return case


def graft(rng, case, donor):
    """A key of the donor case for a table that the case also has, or one of the donor's controllers."""
    key = rng.choice(list(donor))
    if key == "controller" and isinstance(case.get(key), list):
        case[key].append(copy.deepcopy(rng.choice(donor[key])))
    elif isinstance(donor[key], dict) and isinstance(case.get(key), dict) and donor[key]:
        inner = rng.choice(list(donor[key]))
        case[key][inner] = copy.deepcopy(donor[key][inner])
    else:
        case[key] = copy.deepcopy(donor[key])


class TooSlowError(BaseException):
    """Raised after the time limit. It is not an Exception, because code that catches exceptions would hide it."""


@contextmanager
def time_limit(seconds):
    """Make the test fail on an endless loop. On systems without an alarm only the time limit of the whole test run ends it."""
    if sys.platform == "win32":
        yield
        return

    def stop(*_):
        raise TooSlowError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def originals():
    found = []
    for path in bundled().values():
        case = tomllib.loads(path.read_text(encoding="utf-8"))
        case["simulation"] |= EARLY_OUTPUT if "transfer_function" in case["plant"] else EARLY
        case["simulation"].pop("record_points", None)
        found.append(case)
    return found


def written(case):
    return "\n".join(f"{as_toml(key)} = {as_toml(value)}" for key, value in case.items())


def refuse(constant):
    raise AssertionError(f"{constant} is no JSON")


@pytest.mark.parametrize("part", range(10))
@pytest.mark.short(kept=lambda part: part == 0)
def test_mutants_run_or_are_refused_in_one_sentence(part, by_turns, tmp_path, capsys):
    """There are 1500 mutants, in parts for several workers."""
    cases = originals()
    for seed in by_turns(range(150 * part, 150 * (part + 1)), 16):
        rng = random.Random(seed)
        text = written(mutated(rng, rng.choice(cases), cases))
        file = tmp_path / f"{seed}.toml"
        file.write_text(text, encoding="utf-8")
        commands = [("run",), ("certify",)] if seed % 15 else [("certify",), ("run", "--out", str(tmp_path / f"out-{seed}"))]
        for command, *options in commands:
            try:
                with time_limit(SECONDS):
                    code = main([command, str(file), "--json", *options])
            except BaseException as error:  # noqa: BLE001 (also what no program should end by)
                pytest.fail(f"{command}, mutant {seed}: {type(error).__name__}: {error}\n{text}")
            said = capsys.readouterr()
            if code == 0:
                json.loads(said.out, parse_constant=refuse)
            else:
                lines = [line for line in said.err.splitlines() if line.startswith("barbalat: ")]
                assert code == 2 and len(lines) == 1 and lines[0].isprintable() and not said.out, (seed, said.err, text)
                assert len(lines[0]) < 600, (seed, lines[0])
