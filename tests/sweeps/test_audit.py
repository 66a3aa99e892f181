"""What a sweep says beside its shares: the solver's artefacts, limit cycles, what is not examined, other designs."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.judge.judged import CLASSES
from barbalat.judge.verdict import Class
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.studies import sweep
from barbalat.sweeps.audit import FINER_BY, MOST_AUDITED
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.spread import Axis
from barbalat.sweeps.study import OSCILLATED, Study
from barbalat.sweeps.sweep import replay, run_study

STIFF = """
name = "Section V's plant, whose estimates ring at this step and not at a finer one"
[plant]
A_m = [[0.0, 1.0], [-0.3, -1.0]]
b = [0.0, 1.0]
theta = [4.0, -3.0]
x0 = [1.0, 1.0]
[reference_model]
k_0 = 4.0
[reference]
kind = "sine"
amplitude = 50.0
frequency = 0.5
[uncertainty]
lower = [-5.0, -5.0]
upper = [5.0, 5.0]
[simulation]
t_end = 10.0
dt = 1e-3
[[controller]]
name = "L1"
scheme = "l1"
gamma = 100.0
filter = { kappa = 0.02 }
"""
JOINT = """
name = "A flexible joint with limits and a delay"
[plant]
A = [[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 623.7, -40.3, 0.0], [0.0, -965.3, 40.3, 0.0]]
b = [0.0, 0.0, 61.7, -61.7]
[plant.input]
gain = 0.8
saturation = [-10.0, 10.0]
delay = 0.012
[reference_model]
poles = [-8.0, -20.0, [-12.0, 22.0]]
k_0 = 4.76735
[reference]
kind = "constant"
value = 0.5
[uncertainty]
lower = [2.0, -6.0, -0.5, -0.5]
upper = [8.0, 0.0, 1.0, 1.0]
input_gain = [0.6, 1.4]
[simulation]
t_end = 20.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
theta_hat0 = [5.0, -3.0, 0.2, 0.2]
gamma = 1.0
sample_time = 0.005
[[controller]]
name = "ADRC"
scheme = "adrc"
bandwidth = 20.0
sample_time = 0.005
"""


def study(text: str, draws: dict[str, str], members: int) -> Study:
    found = sampled(CaseText(text), list(draws.items()))
    plan = Plan({}, found, members, Design.RANDOM)
    return Study(VariedCase(CaseText(text), plan.paths), plan)


def test_an_artefact_of_the_solver_is_found():
    """The verdicts at the finer step are those of the case file with that step; 124 of the 128 are others."""
    draws = {"plant.theta": "known-set"}
    coarse, fine = study(STIFF, draws, 128), study(STIFF.replace("dt = 1e-3", "dt = 2.5e-4"), draws, 128)
    assert FINER_BY == 4
    found = run_study(coarse, bounds=False)
    rings, truly = (one.run(0, 128)[f"L1/{OSCILLATED}"] for one in (coarse, fine))
    members = list(found.audit.members)
    assert len(set(members)) == MOST_AUDITED and found.evidence.shares[OSCILLATED]["L1"].count == rings.sum() == 128
    assert found.audit.changed == (rings != truly)[members].sum() > MOST_AUDITED / 2
    (sentence, *_) = found.audit.sentences
    assert sentence.startswith(f"of 32 members run again with a step 4 times smaller, {found.audit.changed} changed a verdict")
    assert "artefacts of the solver" in sentence
    document = found.as_json()
    assert document["audit"]["changed"] == document["audit"]["verdicts"][OSCILLATED]["L1"]["changed"] == found.audit.changed
    assert document["audit"]["share"] == found.audit.changed / MOST_AUDITED
    again, plain = run_study(coarse, bounds=False), run_study(coarse, bounds=False, audit=0)
    assert again.as_json() == document
    assert plain.as_json() | {"audit": None} == document | {"audit": None}
    assert plain.audit.sentences == [
        "no member was run again with a finer step, so that any share may be the solver's: none was asked for"
    ]


def test_a_step_that_is_fine_enough_changes_no_verdict():
    found = run_study(study(STIFF.replace("gamma = 100.0", "gamma = 0.1"), {"plant.theta": "known-set"}, 64), bounds=False)
    assert found.audit.changed == 0 and found.audit.sentences == [
        "of 32 members run again with a step 4 times smaller, none changed a verdict"
    ]


def test_failures_and_others_are_run_again_and_the_largest_errors():
    """Of a requirement that few members break, half of the audit does."""
    case = study(CaseText.read("first-order").text.replace("t_end = 60.0", "t_end = 6.0"), {"plant.theta": "known-set"}, 256)
    errors = case.run(0, 256)["L1/max_abs_e[0]"]
    limit = float(np.sort(errors)[-20])
    found = run_study(case, requirements=[Requirement.parse(f"L1/max_abs_e[0] < {limit!r}")], bounds=False, audit=24)
    members = np.array(found.audit.members)
    assert len(members) == 24 and int(errors.argmax()) in members
    assert 11 <= found.evidence.failed[members].sum() <= 14 and (errors[members] >= limit).sum() > 24 / 256 * 20


@pytest.mark.parametrize("members", [-1, 1.5])
def test_an_audit_of_no_number_of_members(members):
    with pytest.raises(InputError, match="audit must be"):
        sweep("first-order", vary={"controller[0].gamma": "1:2:2"}, audit=members)


def test_a_limit_cycle_is_found_where_the_estimates_rest():
    """The command is held and nothing is noisy: only the control of a loop that does not come to rest still moves."""
    joint = study(JOINT, {"plant.theta": "known-set", "plant.input.gain": "uniform:0.6:1.4"}, 12)
    found = run_study(joint, bounds=False, audit=12)
    kinds, swinging = joint.run(0, 12)["MRAC/verdict"], set()
    for member in range(12):
        (mrac, _) = replay(joint, member).results
        last = np.clip(mrac.u[mrac.t >= 19.0], -10.0, 10.0)
        if mrac.diverged_at is None and np.ptp(last) > 0.025 * 20.0:
            swinging.add(member)
    assert set(np.flatnonzero(kinds == CLASSES.index(Class.CYCLE))) == swinging and 0 < len(swinging) < 12
    assert found.evidence.shares["limit cycle"]["MRAC"].count == len(swinging)
    assert found.evidence.shares[OSCILLATED]["MRAC"].count == 0


def test_what_has_no_estimates_is_not_examined():
    joint = study(JOINT.replace("t_end = 20.0", "t_end = 0.5"), {"plant.theta": "known-set"}, 4)
    found = run_study(joint, bounds=False, audit=0).as_json()
    assert found["shares"][OSCILLATED].keys() == {"MRAC"}
    assert found["examined"][OSCILLATED]["not_examined"] == {"ADRC": "it has no estimates"}
    assert found["examined"][OSCILLATED]["what"].startswith("the estimates alone")


@pytest.mark.parametrize(
    ("path", "designs"),
    [
        ("plant.A[2][1]", ("the reference model", "MRAC", "ADRC")),
        ("plant.b[2]", ("the reference model", "MRAC", "ADRC")),
        ("plant.theta[1]", ()),
        ("plant.input.gain", ()),
        ("controller[0].gamma", ()),
        ("reference_model.poles[0]", ()),
    ],
)
def test_what_is_designed_anew_for_each_member(path, designs):
    """By the case: A_m has these poles in the coordinates of A. Who varies a controller's own numbers asks for other designs."""
    tables = VariedCase(CaseText(JOINT), (FieldPath.parse(path),))._tables
    given = FieldPath.parse(path).of(tables)
    plan = Plan({FieldPath.parse(path): Axis(0.99 * given, 1.01 * given, 3)})
    varied = VariedCase(CaseText(JOINT), plan.paths)
    assert Study(varied, plan).redesigned == ({path: designs} if designs else {})
    first, last = (varied.at([share * given]).problem.known for share in (0.99, 1.01))
    differs = max(np.abs(first.A_m - last.A_m).max(), np.abs(first.b - last.b).max())
    assert differs > 1e-3 or path.startswith(("plant.theta", "plant.input", "controller"))


def test_a_plant_whose_model_does_not_depend_on_it_is_not_designed_anew():
    """In companion form the poles alone make A_m: what varies with A is theta, of which no controller knows."""
    text = STIFF.replace("A_m = [[0.0, 1.0], [-0.3, -1.0]]", "A = [[0.0, 1.0], [3.7, -4.0]]").replace("theta = [4.0, -3.0]\n", "")
    text = text.replace("k_0 = 4.0", "k_0 = 4.0\npoles = [-0.5, -0.6]")
    plan = Plan({FieldPath.parse("plant.A[1][0]"): Axis(3.0, 4.0, 3)})
    found = Study(VariedCase(CaseText(text), plan.paths), plan)
    assert found.redesigned == {}


def test_designs_that_are_not_kept_are_said():
    found = sweep_of_joint("plant.A[2][1]=620:630:2")
    (note,) = found.redesign_notes
    assert note.startswith("the reference model, MRAC, ADRC are designed anew for each member, from its own plant.A[2][1]")
    assert found.as_json()["redesigned"] == {"plant.A[2][1]": ["the reference model", "MRAC", "ADRC"]}


def sweep_of_joint(axis: str):
    path, values = axis.split("=")
    text = JOINT.replace("t_end = 20.0", "t_end = 0.5")
    plan = Plan({FieldPath.parse(path): Axis.parse(values)})
    return run_study(Study(VariedCase(CaseText(text), plan.paths), plan), bounds=False, audit=0)
