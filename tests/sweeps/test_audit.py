"""A sweep's remarks on its fractions: solver artefacts, limit cycles, members that were not checked, different designs."""

from __future__ import annotations

import numpy as np
import pytest

from barbalat import InputError
from barbalat.cases.load import CaseText
from barbalat.open_numbers.path import FieldPath
from barbalat.open_numbers.varied import VariedCase
from barbalat.report.sweep import meanings
from barbalat.studies import sweep
from barbalat.sweeps.audit import FEWEST_AUDITED, audit
from barbalat.sweeps.chunks import Chunk, UnstoredChunks
from barbalat.sweeps.evidence import evidence
from barbalat.sweeps.known_set_draws import sampled
from barbalat.sweeps.plan import Design, Plan
from barbalat.sweeps.requirement import Requirement
from barbalat.sweeps.settling import RERUN_COST, Settling, done_here
from barbalat.sweeps.spread import Axis
from barbalat.sweeps.study import OSCILLATED, Study, run_here
from barbalat.sweeps.sweep import replay, run_study
from case_texts import SECTION_V

STIFF = (
    'name = "Section V\'s plant, whose estimates ring at this step and not at a finer one"'
    + SECTION_V
    + """[simulation]
t_end = 10.0
dt = 1e-3
[[controller]]
name = "L1"
scheme = "l1"
gamma = 100.0
filter = { kappa = 0.02 }
"""
)
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


def test_an_artefact_of_the_solver_is_settled_by_a_finer_step():
    """All members oscillate at this step. The audit halves the steps that settled them and finds no other class.

    Steps of order eight are longer, and the path of an estimate along them is up to an eighth shorter, which is decisive for two
    of 128.
    """
    found = run_study(study(STIFF, {"plant.theta": "known-set"}, 128), bounds=False)
    shares = found.evidence.shares
    exact = study(STIFF.replace("dt = 1e-3", "dt = 2e-5"), {"plant.theta": "known-set"}, 128).run(0, 128)["L1/oscillated"]
    assert shares[OSCILLATED]["L1"].count == 128 and abs(shares["estimates ring"]["L1"].count - exact.sum()) <= 2
    assert shares["not settled"]["L1"].count == 0
    assert len(set(found.audit.members)) == FEWEST_AUDITED
    changed = {name: by["L1"].changed for name, by in found.audit.verdicts.items() if by["L1"].changed}
    assert found.audit.changed <= 1 and set(changed) <= {"estimates ring"}
    count = f"{found.audit.changed} of" if found.audit.changed else "no verdict changed in"
    assert found.audit.sentences[0].startswith(f"{count} 30 members repeated at half the step ")
    again, plain = (run_study(study(STIFF, {"plant.theta": "known-set"}, 128), bounds=False, audit=n) for n in (None, 0))
    assert again.as_json() == found.as_json()
    assert plain.as_json() | {"audit": None} == found.as_json() | {"audit": None}
    assert plain.audit.sentences == [
        "no member was repeated at half its step, so any fraction may be due to the solver: none was requested"
    ]


def test_what_no_finer_step_settled_is_found_by_the_audit():
    """If members stay at a step at which they oscillate, the changes that the audit states are the changes with half of the
    step."""
    coarse, fine = (study(STIFF.replace("dt = 1e-3", f"dt = {dt}"), {"plant.theta": "known-set"}, 64) for dt in (1e-3, 5e-4))
    settling = Settling(coarse, settles=False)
    rows = UnstoredChunks(None)
    columns = settling.run(np.arange(64))
    columns["L1/settled"][:], columns["L1/finer_by"][:] = 1.0, 0.0  # as without watching
    rows.add(Chunk(0, 64), columns)
    found = audit(settling, rows, members=64, run=done_here)
    truly = fine.run(0, 64)["L1/oscillated"]
    changed = int((columns["L1/oscillated"] != truly).sum())
    assert found.verdicts["estimates ring"]["L1"].changed == changed > 0
    assert found.changed >= changed and "a smaller simulation.dt is needed" in found.sentences[0]


@pytest.mark.parametrize("unsettled", [16, 64])
def test_the_audits_share_is_of_members_that_were_run_again(unsettled):
    settling = Settling(study(STIFF, {"plant.theta": "known-set"}, 64), settles=False)
    rows, columns = UnstoredChunks(None), settling.run(np.arange(64))
    columns["L1/settled"][:], columns["L1/finer_by"][:] = 1.0, 0.0
    columns["L1/settled"][:unsettled], columns["L1/finer_by"][:unsettled] = 0.0, np.inf  # no step is enough
    rows.add(Chunk(0, 64), columns)
    found = audit(settling, rows, members=64, run=done_here)
    assert found.members == tuple(range(unsettled, 64)) and found.drawn == 64
    if found.members:
        assert found.share.judged == 48 and " 48 members repeated at half the step " in found.sentences[0]
        assert "16 further drawn members could not be repeated, because no step settles them" in found.sentences
    else:
        assert found.share is None
        assert "no step settles any of the 64 members drawn" in found.sentences[0]


def test_requirements_are_split_by_what_the_solver_settles():
    """The metrics come from the step that settles a member. If no step does, the member may or may not violate the
    requirement."""
    case = study(STIFF, {"plant.theta": "known-set"}, 64)
    found = run_study(case, requirements=[Requirement.parse("L1/theta_hat_variation_rate[0] < 1e-9")], bounds=False, audit=0)
    (share,) = found.evidence.shares["L1/theta_hat_variation_rate[0] < 1e-09"].values()
    assert share.as_json()["failed"] == 64 and share.as_json()["not_settled"] == 0
    settling = Settling(case, settles=False)
    rows = UnstoredChunks(None)
    rows.add(Chunk(0, 64), settling.run(np.arange(64)))
    (none,) = evidence(rows, ("L1",), [Requirement.parse("max_abs_u < 1e-9")], case.plan).shares["max_abs_u < 1e-09"].values()
    assert none.as_json()["failed"] == 0 and none.as_json()["not_settled"] == 64 and none.interval == (0.0, 1.0)


def test_figures_are_those_of_the_step_that_settles_a_member():
    case, fine = (study(STIFF.replace("dt = 1e-3", f"dt = {dt}"), {"plant.theta": "known-set"}, 8) for dt in (1e-3, 1e-5))
    found, exact, plain = Settling(case).run(np.arange(8)), fine.run(0, 8), case.run(0, 8)
    for name in ("L1/max_abs_e[0]", "L1/tail_max_abs_e[1]"):
        np.testing.assert_allclose(found[name], exact[name], rtol=1e-4)
    assert np.abs(plain["L1/theta_hat_tail_max[0]"] / exact["L1/theta_hat_tail_max[0]"] - 1).max() > 1e-3
    np.testing.assert_array_equal(plain["L1/oscillated"], found["L1/oscillated"])
    again = replay(case, 3)
    assert again.differing({name: values[3] for name, values in found.items()}) == []
    assert again.results[0].simulation.solver.order == 8


def test_reruns_take_at_most_nine_times_a_large_sweeps_time():
    """The reruns leave out the stiffest members. The others take the expected time, which is stated."""
    draws = {"plant.theta": "known-set", "controller[0].gamma": "loguniform:1:1000"}
    large = Settling(study(STIFF, draws, 10**6))
    assert large.expected(large.afforded.finest) < large.reruns < large.expected(np.inf)
    assert large.reruns * RERUN_COST == pytest.approx(9)
    small = Settling(study(STIFF, draws, 256))
    assert small.afforded.finest == np.inf
    numbers = np.arange(64)
    parts = []
    work = large.work(numbers)
    asked = next(work)
    while True:
        parts.append(sum(one.work for one in asked))
        try:
            asked = work.send(run_here(asked))
        except StopIteration:
            break
    assert parts[1] / parts[0] == pytest.approx(large.reruns, rel=0.5)
    said = run_study(study(STIFF.replace("t_end = 10.0", "t_end = 1.0"), draws, 64), bounds=False, audit=0).evidence.notes[0]
    assert said.startswith("runs with finer steps took ") and "times its processor time" in said


def test_an_actuator_that_the_step_does_not_bear_is_settled_by_one_that_does():
    """The actuator's poles are constant at 350 rad/s, with which RK4 at 10 ms is unstable, so every member would be lost."""
    text = CaseText.read("first-order").text.replace("t_end = 60.0", "t_end = 10.0").split("[[controller]]")[0]
    text = text.replace("[plant.input]", "[plant.input]\nactuator = { num = [122500], den = [1, 490, 122500] }")
    text += '[[controller]]\nname = "MRAC"\nscheme = "mrac"\ngamma = 1.0\n'
    coarse, fine = (study(text.replace("dt = 1e-3", f"dt = {dt}"), {"plant.theta": "known-set"}, 16) for dt in (1e-2, 5e-4))
    plain, settled, exact = coarse.run(0, 16), Settling(coarse).run(np.arange(16)), fine.run(0, 16)
    assert (plain["MRAC/verdict"] == 0).all() and (plain["MRAC/settled"] == 0).all()
    assert (settled["MRAC/settled"] == 1).all() and (exact["MRAC/settled"] == 1).all()
    np.testing.assert_array_equal(settled["MRAC/verdict"], exact["MRAC/verdict"])
    np.testing.assert_allclose(settled["MRAC/max_abs_e[0]"], exact["MRAC/max_abs_e[0]"], rtol=1e-3)


RATE_LIMITED = """
name = "A motor with a delay and a rate limit"
[plant]
A = [[0.0, 1.0], [0.0, -4.0]]
b = [0.0, 40.0]
[plant.input]
saturation = [-6.0, 6.0]
delay = 0.01
rate_limit = 300.0
[reference_model]
poles = [[-6.0, 4.0]]
k_0 = 1.3
[reference]
kind = "square"
amplitude = 0.5
frequency = 4.0
[uncertainty]
lower = [-3.0, -0.6]
upper = [3.0, 0.6]
[simulation]
t_end = 2.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 300.0
"""


def test_a_rate_limiters_own_lag_leaves_nothing_unsettled():
    """The lag is one step long at every step. If it counted as an oscillation, all members of every sweep would be unsettled."""
    found = study(RATE_LIMITED, {"plant.theta": "known-set"}, 16)
    columns = Settling(found).run(np.arange(16))
    assert (columns["MRAC/settled"] == 1).all() and (columns["MRAC/verdict"] == 1).any()
    fine = study(RATE_LIMITED.replace("dt = 1e-3", "dt = 5e-4"), {"plant.theta": "known-set"}, 16).run(0, 16)
    assert (fine["MRAC/settled"] == 1).all() and (columns["MRAC/verdict"] != fine["MRAC/verdict"]).sum() <= 1


def test_why_members_are_not_settled_is_said():
    """There is a count for each reason. A share without any settled member has no value."""
    quick = STIFF.replace("t_end = 10.0", "t_end = 0.5")
    found = run_study(study(quick, {"plant.theta": "known-set"}, 64), bounds=False, audit=0)
    assert found.unsettled == {}
    for part in found.rows.parts:
        part["L1/settled"][:], part["L1/finer_by"][:] = 0.0, np.repeat([4.0, 16.0, np.inf, np.nan], 16)
    assert found.unsettled == {
        "L1": "32 need a step 4 to 16 times smaller, which was too expensive or did not settle them, 16 have an oscillation "
        "that no step tried resolves, 16 have too many states for monitoring their oscillations"
    }
    assert found.as_json()["unsettled"] == found.unsettled
    assert f"Not settled of L1: {found.unsettled['L1']}" in meanings(found)


def test_an_audit_is_two_per_cent_of_the_members():
    text = CaseText.read("first-order").text.replace("t_end = 60.0", "t_end = 0.5")
    found = run_study(study(text, {"plant.theta": "known-set"}, 2000), bounds=False)
    assert len(set(found.audit.members)) == 40 and found.audit.changed == 0
    assert found.as_json()["audit"]["share"] == 0.0 and found.as_json()["audit"]["interval"][1] == pytest.approx(0.088, abs=1e-3)


@pytest.mark.parametrize("members", [-1, 1.5])
def test_an_audit_of_no_number_of_members(members):
    with pytest.raises(InputError, match="audit must be"):
        sweep("first-order", vary={"controller[0].gamma": "1:2:2"}, audit=members)


def test_limit_cycles_are_counted_where_the_estimates_rest():
    """The command is constant and there is no noise, so only a loop that does not settle continues to oscillate in the tail."""
    joint = study(JOINT, {"plant.theta": "known-set", "plant.input.gain": "uniform:0.6:1.4"}, 12)
    found = run_study(joint, bounds=False)
    swinging = set()
    for member in range(12):
        (mrac, _) = replay(joint, member).results
        if mrac.diverged_at is not None:
            continue
        limited = np.clip(mrac.u, -10.0, 10.0)
        earlier, later = (np.ptp(limited[(mrac.t >= t) & (mrac.t < t + 2.5)]) for t in (15.0, 17.5))
        if later > max(0.5, 0.8 * earlier):
            swinging.add(member)
    assert set(np.flatnonzero(found.column("MRAC/verdict") == 1)) == swinging and 0 < len(swinging) < 12
    assert found.evidence.shares["limit cycle"]["MRAC"].count == len(swinging)
    assert found.evidence.shares[OSCILLATED]["MRAC"].count == 0


def test_what_has_no_estimates_is_not_examined():
    joint = study(JOINT.replace("t_end = 20.0", "t_end = 0.5"), {"plant.theta": "known-set"}, 4)
    found = run_study(joint, bounds=False, audit=0).as_json()
    assert found["shares"][OSCILLATED].keys() == {"MRAC"}
    assert found["examined"][OSCILLATED]["not_examined"] == {"ADRC": "it has no estimates"}
    assert found["examined"][OSCILLATED]["what"].startswith("only the estimates")


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
    """The statement depends on the case: A_m has these poles in the coordinates of A. A sweep of a controller's own numbers
    compares designs."""
    tables = VariedCase(CaseText(JOINT), (FieldPath.parse(path),))._tables
    given = FieldPath.parse(path).of(tables)
    plan = Plan({FieldPath.parse(path): Axis(0.99 * given, 1.01 * given, 3)})
    varied = VariedCase(CaseText(JOINT), plan.paths)
    assert Study(varied, plan).redesigned == ({path: designs} if designs else {})
    first, last = (varied.at([share * given]).problem.known for share in (0.99, 1.01))
    differs = max(np.abs(first.A_m - last.A_m).max(), np.abs(first.b - last.b).max())
    assert differs > 1e-3 or path.startswith(("plant.theta", "plant.input", "controller"))


def test_a_plant_whose_model_does_not_depend_on_it_is_not_designed_anew():
    """In companion form A_m depends only on the poles, and A changes only theta, which is unknown to every controller."""
    text = STIFF.replace("A_m = [[0.0, 1.0], [-0.3, -1.0]]", "A = [[0.0, 1.0], [3.7, -4.0]]").replace("theta = [4.0, -3.0]\n", "")
    text = text.replace("k_0 = 4.0", "k_0 = 4.0\npoles = [-0.5, -0.6]")
    plan = Plan({FieldPath.parse("plant.A[1][0]"): Axis(3.0, 4.0, 3)})
    found = Study(VariedCase(CaseText(text), plan.paths), plan)
    assert found.redesigned == {}


def test_designs_that_are_not_kept_are_said():
    found = sweep_of_joint("plant.A[2][1]=620:630:2")
    (note,) = found.redesign_notes
    assert note.startswith("the reference model, MRAC, ADRC are designed again for each member, from its own plant.A[2][1]")
    assert found.as_json()["redesigned"] == {"plant.A[2][1]": ["the reference model", "MRAC", "ADRC"]}


def sweep_of_joint(axis: str):
    path, values = axis.split("=")
    text = JOINT.replace("t_end = 20.0", "t_end = 0.5")
    plan = Plan({FieldPath.parse(path): Axis.parse(values)})
    return run_study(Study(VariedCase(CaseText(text), plan.paths), plan), bounds=False, audit=0)


@pytest.mark.parametrize(
    ("path", "redesign", "designs"),
    [
        ("observer.R", False, {"observer.R": ("the observer",)}),
        ("parameters.m", False, {}),
        ("parameters.m", True, {"parameters.m": ("the reference model", "the observer", "MRAC", "L1", "ADRC")}),
    ],
)
def test_an_observer_that_differs_between_members_is_named(path, redesign, designs):
    """The observer differs in its settings, or because it is designed again for each plant."""
    text = CaseText.read("flexible-joint")
    given = {"observer.R": Axis(1e-9, 1e-8, 2), "parameters.m": Axis(0.0, 0.02, 2)}[path]
    plan = Plan({FieldPath.parse(path): given})
    study = Study(VariedCase(text, plan.paths, redesign=redesign), plan)
    assert study.redesigned == designs
