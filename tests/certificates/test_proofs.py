"""Proofs of certificates: ``barbalat-check`` accepts them as written and rejects them with any false part.

The checker imports nothing from the package, and nothing here computes a bound. Acceptance and rejection are the checker's
verdict alone.
"""

import ast
import copy
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import arb_mat, ctx, fmpq_mat

import barbalat_check
import fuzz
import plausible
from barbalat import certify
from barbalat.cases.load import CaseText, bundled, parse_case
from barbalat.certificates.entry import GUARANTEED
from barbalat.certificates.proof import proof
from barbalat.cli import main
from barbalat.linear.l1_norms import l1_norm
from barbalat.linear.l1_norms.witness import witness
from barbalat.problem.faults import Dropout
from barbalat.validate import InputError
from certificates.proof_attacks import attacks


def document_of(case, certificates):
    """The proof of a case, converted to JSON and back."""
    return json.loads(
        json.dumps(proof(case.name, case.problem, case.controllers, case.simulation, certificates), allow_nan=False)
    )


def test_the_checker_is_a_program_of_its_own():
    source = Path(barbalat_check.__file__).read_text(encoding="utf-8")
    imported = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(source))
        if isinstance(node, (ast.Import, ast.ImportFrom))
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names])
    }
    assert imported - sys.stdlib_module_names == {"flint"}
    package = Path(barbalat_check.__file__).parent / "barbalat"
    assert not [file for file in package.rglob("*.py") if "barbalat_check" in file.read_text(encoding="utf-8")]


@pytest.mark.parametrize("name", bundled())
@pytest.mark.short(kept=lambda name: name in ("paper", "first-order", "l1-output", "satellite-spin"))
def test_every_guaranteed_number_of_a_bundled_case_is_proven_or_named(name, certified):
    case, certificates = certified(name)
    document = document_of(case, certificates)
    before = ctx.prec
    barbalat_check.check(document)
    assert ctx.prec == before  # otherwise later bounds in this process would differ in their last digits
    for controller, certificate in certificates.items():
        found = document["controllers"][controller]
        proven = {line["key"]: line["value"] for line in found["lines"] if line["claimed"]}
        named = {sentence.split(":")[0] for sentence in found["not in the proof"]}
        claimed = {one.key: one.value for one in certificate.entries if one.kind in GUARANTEED and one.value is not None}
        assert proven.keys() | named == claimed.keys() and not proven.keys() & named
        assert all(claimed[key] == value for key, value in proven.items())


def drawn_documents(folder, seeds):
    plausible.write_files(folder)
    for seed in seeds:
        try:
            case = CaseText("", folder).case(fuzz.drawn(seed, None, folder))
        except InputError:
            continue
        document = document_of(case, certify(case.problem, case.controllers, case.simulation))
        of_all = document["controllers"]
        document["controllers"] = {
            name: one for name, one in of_all.items() if fuzz.samples_followed(one) <= fuzz.SAMPLES_CHECKED
        }
        if document["controllers"]:
            yield seed, document


@pytest.mark.dear
def test_the_guaranteed_numbers_of_random_cases_are_accepted(tmp_path, sample):
    claimed = 0
    for seed, document in drawn_documents(tmp_path, range(sample(12, 300))):
        said, _ = barbalat_check.check(document)
        claimed += sum(line["claimed"] for one in document["controllers"].values() for line in one["lines"])
        assert said, seed
    assert claimed >= 20


def without_cells(document, true):
    """The document without the unchanged bounds over cells, which take seconds. A line on which a different line depends is
    kept."""
    found = {}
    for name, one in document["controllers"].items():
        follows = any("follows_from" in line.get("witness", {}) for line in one["lines"])
        lines = [] if follows else true["controllers"][name]["lines"]
        cells = [line for line in lines if line["key"] == "error_bound_worst"]
        found[name] = one | {"lines": [line for line in one["lines"] if line not in cells]}
    return document | {"controllers": found}


def refused(false, true):
    """Whether the checker rejects a changed document. Controllers whose part is unchanged are not checked again."""
    changed = {name: one for name, one in false["controllers"].items() if one != true["controllers"][name]}
    try:
        barbalat_check.check(without_cells(false | {"controllers": changed or false["controllers"]}, true))
    except barbalat_check.Refused:
        return True
    return False


@pytest.mark.parametrize("name", ["paper", "third-order", "astrom-wittenmark", "satellite-spin", "first-order"])
@pytest.mark.short(kept=lambda name: name in ("paper", "astrom-wittenmark"))
@pytest.mark.dear
def test_what_does_not_follow_is_refused(name, certified):
    """There are some 200 false documents: a bound that the witnesses do not support, a witness whose inequality fails, or a
    missing premise."""
    document = document_of(*certified(name))
    barbalat_check.check(document)
    barbalat_check.check(without_cells(document, document))
    tried = [(what, refused(false, document)) for what, false in attacks(document)]
    assert len(tried) >= 10 and not [what for what, caught in tried if not caught]


@pytest.mark.full
def test_what_does_not_follow_of_random_cases_is_refused(tmp_path):
    accepted = []
    for seed, document in drawn_documents(tmp_path, range(60)):
        if any(map(fuzz.samples_followed, document["controllers"].values())):
            continue  # test_sampled_response.py attacks these
        accepted += [f"{seed}: {what}" for what, false in attacks(document) if not refused(false, document)]
    assert not accepted


BASELINE = """
name = "beside a PI controller"
[parameters]
a = { value = 1.0, between = [0.998, 1.002] }
[plant]
A = [["-a"]]
b = [1.0]
x0 = [0.1]
[reference_model]
follow = "x_1"
[reference]
kind = "square"
amplitude = 0.3
frequency = 0.4
[simulation]
t_end = 10.0
dt = 1e-3
[baseline]
kind = "lqi"
Q = [1.0, 4.0]
R = 1.0
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 20.0
[[controller]]
name = "Baseline"
scheme = "baseline"
[[controller]]
name = "Gain"
scheme = "linear"
controller = { num = [5.0], den = [1.0] }
[[controller]]
name = "Direct"
scheme = "mrac-direct"
gamma = 20.0
gamma_r = 5.0
"""
FILTERED = """
[[controller]]
name = "L1"
scheme = "l1"
gamma = 200.0
filter = { kappa = 0.1 }
"""


def beside_a_baseline(text):
    """The document of a case with three properties: the command also enters the integral of the error directly, the adaptive part
    of L1-AC departs from the baseline, and the linear controller is a gain without a state. All its guaranteed numbers are
    proven."""
    case = parse_case(text)
    document = document_of(case, certify(case.problem, case.controllers, case.simulation))
    barbalat_check.check(document)
    for name, found in document["controllers"].items():
        assert not found["not in the proof"], name
        assert {"error_bound", "error_bound_worst", "error_bound_command"} <= {line["key"] for line in found["lines"]}
    return document


def test_every_number_beside_a_baseline_is_proven():
    assert beside_a_baseline(BASELINE)


@pytest.mark.full
def test_what_does_not_follow_beside_a_baseline_is_refused():
    document = beside_a_baseline(BASELINE + FILTERED)
    tried = [(what, refused(false, document)) for what, false in attacks(document)]
    assert len(tried) >= 100 and not [what for what, caught in tried if not caught]


SQUARE = """
name = "square"
[plant]
A_m = [[-1.0]]
b = [1.0]
theta = [0.1]
[reference_model]
k_0 = 1.0
[reference]
kind = "square"
amplitude = 1.0
frequency = 1.0
phase = PHASE
[uncertainty]
lower = [-0.2]
upper = [0.2]
[simulation]
t_end = 5.0
dt = 1e-3
[[controller]]
name = "L1"
scheme = "l1"
gamma = 1000.0
filter = { kappa = 0.01 }
"""


@pytest.mark.parametrize("phase", [-1.0, 1.0])
def test_square_waves_of_any_phase_are_accepted_and_an_unknown_gain_is_refused(phase):
    """With a gain between 0.01 and 3 the error of this loop reaches 0.25, more than the bounds for a known gain."""
    case = parse_case(SQUARE.replace("PHASE", str(phase)))
    document = document_of(case, certify(case.problem, case.controllers, case.simulation))
    barbalat_check.check(document)
    document["plant"] |= {"gain": [0.05], "input_gain": {"lower": [0.01], "upper": [3.0]}}
    found = document["controllers"]["L1"]
    found["facts"]["theta_hat0"].append(1.0)
    every, dropped = found["lines"], ("nu_", "reference_error_bound", "error_bound")
    for key in ("error_bound", "error_bound_worst", "error_bound_command"):
        found["lines"] = [line for line in every if line["key"] == key or not line["key"].startswith(dropped)]
        with pytest.raises(barbalat_check.Refused, match="the input's gain must be known"):
            barbalat_check.check(document)


SECOND_ORDER = """
name = "second order"
[plant]
A = [[0.0, 1.0], [0.4, -0.3]]
b = [0.0, 2.0]
[plant.input]
gain = 1.0
[reference_model]
A_m = [[0.0, 1.0], [-9.0, -6.0]]
k_0 = 4.5
[reference]
kind = "sine"
amplitude = 1.0
frequency = 1.0
[uncertainty]
lower = [4.6, 2.8]
upper = [4.8, 2.9]
[simulation]
t_end = 5.0
dt = 1e-3
[[controller]]
name = "ADRC"
scheme = "adrc"
bandwidth = 20.0
OUTPUT
"""


def test_the_premises_of_an_unknown_gain_and_of_nu_1_are_looked_up(certified):
    document = document_of(*certified("paper"))
    found = document["controllers"]["L1"]
    bounds = {"error_bound", "error_bound_worst", "error_bound_command"}
    found["lines"] = [line for line in found["lines"] if line["key"] not in bounds]
    document["controllers"] = {"L1": found}
    barbalat_check.check(document)
    for key in ("nu_1", "nu_2", "reference_error_bound"):
        others = {"nu_1", "nu_2", "reference_error_bound"} - {key}
        alone = found | {"lines": [line for line in found["lines"] if line["key"] not in others]}
        unprojected = alone | {"facts": alone["facts"] | {"projection": False}}
        with pytest.raises(barbalat_check.Refused, match=f"{key}: theta_hat must be projected"):
            barbalat_check.check(document | {"controllers": {"L1": unprojected}})
        both = alone | {"facts": alone["facts"] | {"theta_hat0": [*alone["facts"]["theta_hat0"], 1.0]}}
        for interval, why in (([0.5, 2.0], f"{key}: the input's gain must be known"), ([-5.0, 3.0], "gain must be positive")):
            plant = document["plant"] | {"input_gain": {"lower": interval[:1], "upper": interval[1:]}}
            lines = [line for line in both["lines"] if line["key"] not in ("nu_0", "nu_0_worst", "initial_parameter_error")]
            with pytest.raises(barbalat_check.Refused, match=why):
                barbalat_check.check(document | {"plant": plant, "controllers": {"L1": both | {"lines": lines}}})


def test_the_matrix_of_a_closed_loop_model_belongs_to_that_scheme_alone(certified):
    """With A_m - 100 I in place of A_m a much smaller bound would follow, also for an unstable A_m."""
    document = document_of(*certified("paper"))
    of_mrac = document["controllers"]["MRAC"]
    facts = of_mrac["facts"] | {"L": [[-100.0, 0.0], [0.0, -100.0]], "P": [[100.0, 0.0], [0.0, 100.0]]}
    lines = [
        {"key": "lambda_min", "value": 99.9, "claimed": True},
        {"key": "lyapunov", "value": True, "claimed": False},
        {"key": "error_bound", "value": 0.51, "claimed": True},
    ]
    with pytest.raises(barbalat_check.Refused, match="mrac has no L"):
        barbalat_check.check(document | {"controllers": {"MRAC": of_mrac | {"facts": facts, "lines": lines}}})


@pytest.mark.parametrize("output", ["", "output = [1.0, 0.0]"])
def test_the_theta_0_of_a_fixed_loop_is_that_of_its_observer_or_baseline(output):
    """The error of these loops is driven by theta - theta_0, so that any other theta_0 would give a bound of zero."""
    text = SECOND_ORDER.replace("OUTPUT", output)
    case = parse_case(text)
    document = document_of(case, certify(case.problem, case.controllers, case.simulation, keys=["condition", "error_bound"]))
    said, assumed = barbalat_check.check(document)
    assert "condition" in said[1]
    assert assumed == ["the parts of controller, actuator and sensor in the linear loop are those of the case"]
    facts = document["controllers"]["ADRC"]["facts"]
    for name in "FGHMN":
        other = copy.deepcopy(facts)
        other["observer"][name][0][0] += 0.5
        one = barbalat_check.Controller(barbalat_check.Case(document["plant"]), other)
        with pytest.raises(barbalat_check.Refused, match="the observer"):
            barbalat_check.require_fixed_loop(one)
    moved = barbalat_check.Controller(barbalat_check.Case(document["plant"]), facts | {"theta_0": [0.3, 0.1]})
    with pytest.raises(barbalat_check.Refused, match="the observer"):
        barbalat_check.require_fixed_loop(moved)
    around = document["plant"] | {"baseline": {"theta_0": [0.0, 0.0], "enters": [[0.0], [0.0]]}}
    alone = {"scheme": "baseline", "theta_0": [0.3, 0.1]}
    with pytest.raises(barbalat_check.Refused, match="theta_0 must be that of the baseline"):
        barbalat_check.require_fixed_loop(barbalat_check.Controller(barbalat_check.Case(around), alone))


def test_what_the_file_does_not_cover_is_said_and_nothing_unknown_is_read_over(certified, tmp_path, capsys):
    case, certificates = certified("first-order")
    document = document_of(case, certificates)
    value = certificates["MRAC"].values["error_bound"]
    said, _ = barbalat_check.check(document)
    assert said[0] == f"case: {case.name}" and any(f"error_bound = {value!r}" in one for one in said)
    assert not any("holds only if" in one for one in said)
    lost = replace(case.problem, faults=(Dropout(times=((1.0, 1.1),)),))
    written = json.loads(json.dumps(proof(case.name, lost, case.controllers, case.simulation, certificates)))
    said, _ = barbalat_check.check(written)
    assert "what is accepted holds only if every sample arrives as it was measured" in said
    with pytest.raises(barbalat_check.Refused, match="these differ: shell"):
        barbalat_check.check(document | {"plant": document["plant"] | {"shell": {}}})
    file = tmp_path / "twice.json"
    file.write_text(json.dumps(document).replace('"format":', '"format": "other", "format":'))
    assert barbalat_check.main([str(file)]) == 2
    assert "a key is repeated" in capsys.readouterr().err


def test_weaker_numbers_follow_too(certified):
    document = document_of(*certified("first-order"))
    (line,) = [one for one in document["controllers"]["MRAC"]["lines"] if one["key"] == "error_bound"]
    line["value"] *= 2
    barbalat_check.check(document)


def exact(matrix):
    return fmpq_mat([[barbalat_check.number(float(value)) for value in row] for row in matrix])


def test_norms_from_witnesses_lie_within_those_of_the_package(sample):
    """The norms of two programs agree for systems with real, complex, stiff and double poles."""
    random, kinds = np.random.default_rng(5), 0
    for _ in range(sample(12, 300)):
        n, m, p = random.integers(1, 5), random.integers(1, 3), random.integers(1, 3)
        A = random.normal(size=(n, n)) * 10.0 ** random.uniform(-1, 1)
        A -= np.eye(n) * (np.linalg.eigvals(A).real.max() + 10.0 ** random.uniform(-1, 1))
        if random.random() < 0.3:
            A = np.diag(-(10.0 ** random.uniform(-2, 3, n))) + np.triu(random.normal(size=(n, n)), 1)
        elif random.random() < 0.2:
            A = -np.eye(n) + np.diag(np.ones(n - 1), 1)
        B, C, D = random.normal(size=(n, m)), random.normal(size=(p, n)), random.normal(size=(p, m))
        found = l1_norm(A, B, C, D)
        proof_of_it = witness(*(arb_mat(part.tolist()) for part in (A, B, C)), found.lower)
        assert proof_of_it is not None
        with ctx.workprec(256):
            low, high = barbalat_check.Norms(*map(exact, (A, B, C, D)), proof_of_it).norm
        assert found.lower <= float(low) and float(high) <= found.upper
        kinds += 1
    assert kinds


def test_a_norm_that_is_known_in_closed_form():
    """1/(s^2 + 2 z s + 1) has the L1 norm coth(pi z/(2 sqrt(1 - z^2)))."""
    z = 0.1
    A, B, C = np.array([[0.0, 1.0], [-1.0, -2 * z]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    expected = 1 / math.tanh(math.pi * z / (2 * math.sqrt(1 - z * z)))
    found = witness(*(arb_mat(part.tolist()) for part in (A, B, C)), expected)
    with ctx.workprec(256):
        low, high = barbalat_check.Norms(exact(A), exact(B), exact(C), exact([[0.0]]), found).norm
    assert float(high - low) < 1e-15 and float(low) == pytest.approx(expected, rel=1e-14)


@pytest.mark.dear
def test_from_the_command_line_to_the_verdict(tmp_path, capsys):
    """The checker runs in a separate process. Its exit code is 0, or 1 with the first line that fails, or 2 without a file."""
    file = tmp_path / "made" / "paper.json"
    assert main(["certify", "paper", "--proof", str(file)]) == 0
    assert f"barbalat-check {file}" in " ".join(capsys.readouterr().out.split())
    program = [sys.executable, barbalat_check.__file__]
    done = subprocess.run([*program, str(file)], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.endswith("all lines hold\n")
    document = json.loads(file.read_text())
    lines = document["controllers"]["L1"]["lines"]
    (place,) = [i for i, line in enumerate(lines, start=1) if line["key"] == "error_bound"]
    lines[place - 1]["value"] *= 0.99
    file.write_text(json.dumps(document))
    done = subprocess.run([*program, str(file)], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stdout.startswith(
        f"refused: L1, line {place}, error_bound: the bound of |e| must be at least"
    )
    assert barbalat_check.main([str(tmp_path / "none.json")]) == 2
    assert main(["certify", "paper", "--proof", str(tmp_path)]) == 2


@pytest.mark.parametrize(
    "text", ["[]", "{}", '{"format": "barbalat proof 1"}', '{"format": "barbalat proof 1", "controllers": {"a": 3}}']
)
def test_what_is_no_proof_is_refused(tmp_path, capsys, text):
    file = tmp_path / "no.json"
    file.write_text(text)
    assert barbalat_check.main([str(file)]) == 1
    assert capsys.readouterr().out.startswith("refused: ")


def test_a_number_beyond_all_bounds_is_refused_in_a_sentence(tmp_path, capsys, certified):
    file = tmp_path / "infinite.json"
    document = document_of(*certified("first-order"))
    document["plant"]["A_m"][0][0] = "huge"
    file.write_text(json.dumps(document).replace('"huge"', "1e400"))
    assert barbalat_check.main([str(file)]) == 1
    assert capsys.readouterr().out == "refused: expected a finite number, got inf\n"


def test_a_closed_pipe_ends_the_checker_quietly(tmp_path, certified):
    file = tmp_path / "first-order.json"
    file.write_text(json.dumps(document_of(*certified("first-order"))))
    with subprocess.Popen(
        [sys.executable, barbalat_check.__file__, str(file)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        run.stdout.close()
        assert (run.wait(timeout=60), run.stderr.read()) == (0, b"")
