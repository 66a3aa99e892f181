"""The certificate of a case with faults has the numbers of the loop without faults. Nothing is guaranteed for the loop with
faults."""

from dataclasses import replace

import pytest

from barbalat import certify, simulate
from barbalat.cases.load import parse_case
from barbalat.certificates.apart import FAULTS_NOTE, SHELL_NOTE
from barbalat.certificates.certify import certified_case
from barbalat.certificates.entry import speaks_of_the_motion
from barbalat.certificates.summary import five

CASE = """
name = "heater"
[plant]
A_m = [[-0.01]]
b = [0.001]
theta = [8.0]
[plant.input]
delay = DELAY
[uncertainty]
lower = [0.0]
upper = [9.0]
[reference_model]
follow = "x_1"
[reference]
kind = "step"
amplitude = 20.0
[simulation]
t_end = 2000.0
dt = 1.0
[[controller]]
name = "fixed"
scheme = "linear"
controller = { num = [10.0], den = [10.0, 1.0] }
nominal = [8.0]
sample_time = 5.0
[[controller]]
name = "mrac"
scheme = "mrac"
gamma = GAMMA
sample_time = 5.0
"""
FAULTS = '[[faults]]\nkind = "dropout"\nshare = 0.1\nseed = 0\n'


def heater(*, delay=0.0, gamma=0.02, sampled=True, faults=""):
    text = CASE.replace("DELAY", str(delay)).replace("GAMMA", str(gamma)) + faults
    return parse_case(text if sampled else text.replace("sample_time = 5.0\n", ""))


def lines_of(certificates, name):
    (column,) = (one for one in certificates.table.columns if one.name == name)
    return {line.label: line.text.replace("\N{NO-BREAK SPACE}", " ") for line in five(column, certificates[name], None)}


def test_with_faults_the_numbers_are_those_of_the_loop_without_them():
    plain, faulty = heater(), heater(faults=FAULTS)
    without = certify(plain.problem, plain.controllers, plain.simulation)
    found = certify(faulty.problem, faulty.controllers, faulty.simulation)
    for name, certificate in found.items():
        assert {entry.key: entry.value for entry in certificate.entries} == {one.key: one.value for one in without[name].entries}
        assert FAULTS_NOTE in certificate.notes and FAULTS_NOTE not in without[name].notes
        for entry, own in zip(certificate.entries, without[name].entries, strict=True):
            moves = own.kind == "guaranteed" and entry.kind != own.kind
            assert entry.kind == ("guaranteed for the design" if moves else own.kind)
    assert "error_bound" in without["fixed"].guaranteed and "error_bound" not in found["fixed"].guaranteed
    assert found["fixed"].entry("error_bound").kind == "guaranteed for the design"
    said = lines_of(found, "fixed")
    assert said["bound of e"].startswith("guaranteed for the design") and "the case has faults" in said["assumed"]
    assert "guaranteed for the design" in said["condition"] and "not known" not in " ".join(said.values())
    cells = [cell for column in found.table.columns for cell in column.cells.values()]
    assert not any(cell.kind == "guaranteed" for cell in cells)
    assert any(cell.kind == "guaranteed for the design" for cell in cells)


def test_a_report_of_runs_with_faults_guarantees_nothing():
    faulty = heater(faults=FAULTS)
    found = certified_case(faulty.problem, faulty.controllers, faulty.simulation)
    assert not any(speaks_of_the_motion(entry) for one in found.certificates.values() for entry in one.entries)
    assert not any(cell.kind == "guaranteed" for column in found.table.columns for cell in column.cells.values())


SHELLS = {
    "range": "range = { x_1 = [-0.5, 0.5] }",
    "rate": "rate = { x_1 = 0.001 }",
    "stuck": "stuck = { x_1 = 50.0 }",
    "command": "range = { command = [-1.0, 1.0] }",
}


@pytest.mark.parametrize("name", SHELLS)
def test_a_shell_that_may_reject_samples_guarantees_nothing_of_the_motion(name):
    """Each of the first two shells and the last reject samples of this run, and the run then leaves the bound."""
    shelled, plain = heater(faults=f"[shell]\n{SHELLS[name]}\n"), heater()
    without = certify(plain.problem, plain.controllers, plain.simulation)
    found = certify(shelled.problem, shelled.controllers, shelled.simulation)
    reported = certified_case(shelled.problem, shelled.controllers, shelled.simulation).certificates
    assert {key: one["fixed"].entry("error_bound").kind for key, one in {"with": found, "without": without}.items()} == {
        "with": "guaranteed for the design",
        "without": "guaranteed",
    }
    for certificates in (found, reported):
        assert not any(speaks_of_the_motion(entry) for one in certificates.values() for entry in one.entries)
        assert all(SHELL_NOTE in one.notes for one in certificates.values())
    said = lines_of(found, "fixed")
    assert said["bound of e"].startswith("guaranteed for the design")
    assert said["assumed"].startswith("fails here: ") and "the shell may reject samples; see the notes" in said["assumed"]
    cells = [cell for column in found.table.columns for cell in column.cells.values()]
    assert not any(cell.kind == "guaranteed" for cell in cells)
    if name != "stuck":
        (run,) = simulate(shelled.problem, shelled.controllers[:1], shelled.simulation).values()
        assert abs(run.e).max() > found["fixed"].entry("error_bound").value


def test_a_shell_without_checks_of_samples_keeps_the_guarantees():
    """It acts only after lost samples, and without faults none is lost."""
    case = heater(faults="[shell]\nlongest_outage = 20.0\n")
    found = certify(case.problem, case.controllers, case.simulation)["fixed"]
    assert "error_bound" in found.guaranteed and SHELL_NOTE in found.notes


@pytest.mark.parametrize("sampled", [True, False])
def test_an_unstable_loop_with_its_law_is_named(sampled):
    """The loop is stable with frozen estimates and unstable with the law, so no margin is called unknown."""
    case = heater(delay=20.0, gamma=0.2, sampled=sampled)
    found = certify(case.problem, case.controllers, case.simulation)
    certificate, said = found["mrac"], lines_of(found, "mrac")
    assert certificate.values["delay_margin"] > 0
    assert "adapting: none, since with its law linearised at the largest command, the loop is unstable" in said["margin"]
    if sampled:
        assert certificate.values["spectral_radius"] < 1 < certificate.values["spectral_radius_adapting"]
        assert "with its law linearised at the largest command is unstable with spectral radius" in said["condition"]
        assert (
            "stable at the case's theta" in lines_of(found, "fixed")["condition"]
            or "none needed" in lines_of(found, "fixed")["condition"]
        )
    slow = heater(delay=20.0, gamma=0.02, sampled=sampled)
    quiet = certify(slow.problem, slow.controllers, slow.simulation)
    assert "s adapting" in lines_of(quiet, "mrac")["margin"]


def test_the_loop_that_is_called_unstable_is_unstable():
    """A small deviation from the equilibrium grows by the eigenvalue over many samples of a run."""
    import numpy as np

    grown = {}
    for gamma in (0.02, 0.2):
        case = heater(delay=20.0, gamma=gamma)
        simulation = replace(case.simulation, t_end=6000.0)
        run = simulate(case.problem, [case.controllers[1]], simulation)["mrac"]
        e = np.abs(run.envelope.e_max[:, 0])
        grown[gamma] = e[-len(e) // 5 :].max() > 1e-2
    assert grown == {0.02: False, 0.2: True}
