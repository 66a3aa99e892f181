"""A number or sentence that a run contradicts is never called guaranteed, on random mixtures of disturbances."""

from __future__ import annotations

import json
import re
from itertools import combinations

import numpy as np
import pytest
from contradictions import CLAIMS, OF_THE_LOOP, at_stake, claims_where_nothing_holds, exceeded, judged
from mixtures import (
    FEATURES,
    SIMULATION,
    disturbed,
    state_controllers,
    state_feedback,
)
from output_mixtures import output_controllers, output_feedback

from barbalat import simulate
from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case
from barbalat.cli import main
from barbalat.solvers.simulation import Simulation

DRAWN = {"state": (state_feedback, state_controllers), "output": (output_feedback, output_controllers)}


@pytest.mark.parametrize("part", range(2))
@pytest.mark.parametrize("feedback", DRAWN)
def test_no_mixture_does_what_is_denied(feedback, part, sample, by_turns, no_searches):
    """Seeded problems with all schemes that fit them. The short tests use one scheme for each problem."""
    problem_of, controllers_of = DRAWN[feedback]
    for seed in by_turns(range(50 * part, 50 * (part + 1)), 7):
        random = np.random.default_rng([seed, list(DRAWN).index(feedback)])
        problem = problem_of(random)
        controllers = controllers_of(random, problem)
        few = sample(1, len(controllers))
        for controller in [controllers[(seed + i) % len(controllers)] for i in range(min(few, len(controllers)))]:
            certificate, column = judged(problem, controller)
            where = f"{feedback} {seed}: {controller}"
            assert not claims_where_nothing_holds(certificate, column), where
            if not at_stake(certificate, column):
                continue
            (run,) = simulate(problem, [controller], SIMULATION).values()
            assert not exceeded(certificate, column, run), where


PAIRS = list(combinations(FEATURES, 2))
ERROR_BOUNDS = ("error_bound", "error_bound_worst", "error_bound_command")


@pytest.mark.parametrize("name", bundled())
def test_no_pair_of_disturbing_features_leaves_a_guarantee(name, by_turns, no_searches):
    """For the bundled cases, each remaining guarantee by small gain or Theorem 1 is compared with a run.

    With projected estimates e is bounded despite bounded disturbances, also with an unknown gain in its interval, but e need not
    vanish.
    """
    case = load_case(name)
    horizon = Simulation(t_end=min(case.simulation.t_end, 10.0), dt=5e-4)  # whole steps in every case's sample time
    random = np.random.default_rng(len(name))
    for pair in by_turns([PAIRS[i] for i in random.permutation(len(PAIRS))], 1):
        problem = disturbed(case.problem, pair)
        for controller in case.controllers:
            certificate, column = judged(problem, controller, horizon)
            where = f"{name}, {controller.name}, {pair}"
            assert not claims_where_nothing_holds(certificate, column), where
            held = [row for row in OF_THE_LOOP if column.cells[row].kind == "guaranteed"]
            bounded = certificate.guaranteed & {*ERROR_BOUNDS, "reference_error_bound", "output_bound"}
            if not held and not bounded:
                continue
            projected = "error_bound" in certificate.guaranteed and set(held) == {"stability", "transient"}
            by_theorem_1 = set(pair) <= {"gain", "disturbance"} and (not held or projected)
            assert by_theorem_1 or certificate.guaranteed & {"output_bound", "state_bound"}, where
            (run,) = simulate(problem, [controller], horizon).values()
            assert not exceeded(certificate, column, run), where


DELAYED = """
name = "P2"
[plant]
A_m = [[0.0, 1.0], [-4.0, -1.2]]
b = [0.5, 1.0]
theta = [0.8, -0.5]
x0 = [0.2, -0.3]
[plant.input]
delay = 0.02
[reference_model]
k_0 = -2.0
[reference]
kind = "sine"
amplitude = 3.0
frequency = 0.8
[uncertainty]
lower = [-1.0, -2.0]
upper = [1.5, 0.5]
[simulation]
t_end = 0.2
dt = 0.0001
solver = "rk4"
[[controller]]
name = "M"
scheme = "mrac"
gamma = 200.0
[[controller]]
name = "L"
scheme = "l1"
gamma = 200.0
filter = { num = [900.0], den = [1.0, 42.0, 900.0] }
"""
PROMISES = re.compile("proven|proof|guaranteed", re.IGNORECASE)


@pytest.mark.dear
def test_beside_a_delay_no_promise_stands_anywhere(tmp_path, capsys):
    """The rows of stability, tracking and transient and the bounds on e contain no promise, neither in the terminal nor on the
    page nor in the JSON."""
    case = tmp_path / "delayed.toml"
    case.write_text(DELAYED)
    assert main(["certify", str(case)]) == 0
    lines = re.findall(r"^  (?:condition|bound of).*$", capsys.readouterr().out, re.MULTILINE)
    assert len(lines) == 4 and not any(PROMISES.search(line) or CLAIMS.search(line) for line in lines)
    assert main(["certify", str(case), "--full"]) == 0
    terminal = capsys.readouterr().out
    assert main(["run", str(case), "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text().replace("<wbr>", "").replace("\xa0", " ")
    rows = re.findall(r"<tr>.*?</tr>", page, re.DOTALL)
    table = terminal[terminal.index("Signals bounded") : terminal.rindex("\nEstimates\n")]
    assert table.count("does not apply") == 6 and table.count("delay 0.02 s") + table.count("0.02 s") >= 6
    assert not PROMISES.search(table) and not CLAIMS.search(table)
    shown = [row for row in rows if re.search("Signals bounded|Tracking error|Transient|error_bound", row)]
    assert len(shown) == 3 + 6 + 1  # both have three bounds on e, and L has one on the distance to its reference system
    for row in shown:
        assert "does not apply" in row and "delay 0.02 s" in row and not PROMISES.search(row) and not CLAIMS.search(row)
    written = json.loads((tmp_path / "out" / "run.json").read_text())
    for column in written["table_1"]["columns"]:
        for row in OF_THE_LOOP:
            assert column[row]["kind"] == "does not apply" and column[row]["why"] == "delay 0.02 s"
            assert not PROMISES.search(json.dumps(column[row])) and not CLAIMS.search(json.dumps(column[row]))
    for controller in written["certificates"].values():
        assert not {*ERROR_BOUNDS, "reference_error_bound", "nu_1", "nu_2"} & {
            *controller,
            *controller["guaranteed"],
        }
