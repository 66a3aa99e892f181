"""Units and names of a case in its exports."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from barbalat import KnownParameters, LinearFeedback, ReferenceModel, Sampled, Simulation, TransferFunction, simulate
from barbalat.export.contents import Contents
from barbalat.export.fmu.base_units import base_unit
from barbalat.export.source import header
from barbalat.export.texts import Printed, comment, comments
from barbalat.export.write import own_run_warning
from barbalat.exports import export_controller
from barbalat.judge.settings import Judge
from barbalat.lowering.c99 import DOUBLE
from barbalat.plants import Dropout, LuenbergerObserver, PlantInput, Shell
from barbalat.problem.labels import Labels
from barbalat.signals import Step
from export.examples import SIMULATION, STATE, T
from export.made import files
from export.test_name import CONTROLLER

KNOWN = Sampled(controller=KnownParameters(theta=[1.0, -0.5], name="known"), sample_time=T, discretization="euler")


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("rad", {"rad": "1"}),
        ("deg", {"rad": "1", "factor": repr(math.pi / 180)}),
        ("rad/s", {"s": "-1", "rad": "1"}),
        ("m/s^2", {"m": "1", "s": "-2"}),
        ("N m", {"kg": "1", "m": "2", "s": "-2"}),
        ("1/s", {"s": "-1"}),
        ("%", {"factor": "0.01"}),
        ("furlong", None),
        ("g", None),  # a gram, or the load factor of an aircraft
        ("m/", None),
    ],
)
def test_base_units_are_the_sis(unit, expected) -> None:
    """By the SI brochure N = kg m s^-2 and 1 degree = pi/180 rad."""
    assert base_unit(unit) == expected


def test_the_header_has_the_cases_names_and_units() -> None:
    labelled = replace(STATE, labels=Labels(names=["alpha", "q"], units=["rad", "rad/s"], input_units=["deg"]))
    text = header(Printed(Contents.of(labelled, CONTROLLER, SIMULATION, DOUBLE)))
    assert "double x[L1_MEASURED]; /* measured state: alpha [rad], q [rad/s] */" in text
    assert "double u[L1_INPUTS]; /* control [deg] before the actuator, as simulated */" in text


def test_a_command_has_the_unit_of_the_labelled_state_that_follows_it() -> None:
    labels = Labels(names=["alpha", "q"], units=["rad", "rad/s"], input_units=["deg"])
    follows = replace(STATE, labels=labels, reference_model=ReferenceModel(follow="alpha"))
    text = header(Printed(Contents.of(follows, CONTROLLER, SIMULATION, DOUBLE)))
    assert "/* command of (2) [rad] */" in text and '"r [rad]"' in text
    text = header(Printed(Contents.of(replace(STATE, labels=labels), CONTROLLER, SIMULATION, DOUBLE)))  # k_0: nothing is declared
    assert "/* command of (2) */" in text and '"r",' in text


def test_the_readme_has_the_cases_names_and_units() -> None:
    labelled = replace(STATE, labels=Labels(names=["alpha", "q"], units=["rad", "rad/s"], input_units=["deg"]))
    text = files(labelled, KNOWN, SIMULATION)["README.md"]
    assert re.search(r"in\.x\[0\] = \.\.\.; +/\* alpha \[rad\] \*/\n +in\.x\[1\] = \.\.\.; +/\* q \[rad/s\] \*/\n", text)
    assert "apply out.u_limited[0] [deg] at once" in text
    assert "units of the case: x[0] is alpha [rad], x[1] is q [rad/s], u is in deg." in text
    plain = files(STATE, KNOWN, SIMULATION)["README.md"]
    assert "/* 2 states measured */" in plain and "units of the case.\n" in plain


def test_the_export_of_a_controller_that_is_lost_says_so(tmp_path) -> None:
    run = simulate(STATE, [KNOWN], SIMULATION)[KNOWN.name]
    bound = Judge(lost={"x_1": 0.99 * float(np.abs(run.x[:, 0]).max())})
    told: list[str] = []
    out = export_controller(STATE, KNOWN, SIMULATION, out=tmp_path / "lost", judge=bound, note=told.append)
    (sentence,) = told
    assert re.fullmatch(
        r"Do not fly this export as it is: when this case is simulated, known is lost at t = [\d.]+ s.*\.", sentence
    )
    assert f"**{sentence}**" in (out / "README.md").read_text()
    told.clear()
    out = export_controller(STATE, KNOWN, SIMULATION, out=tmp_path / "kept", note=told.append)
    assert not told and "Do not fly" not in (out / "README.md").read_text()


@pytest.mark.parametrize(
    ("gain", "delay", "limit", "losses", "verdict"),
    [
        (200.0, 0.05, 10.0, 0, r"limit cycle, u swings by ±10 at 2\d\.\d rad/s, at its limits 6\d % of the time"),
        (60.0, 0.05, 10.0, 0, ""),
        (2.0, 0.0, 0.5, 12, "off by 52 % in x_1, at its limits 100 % of the time"),
    ],
    ids=["limit cycle", "less gain", "at its limits"],
)
def test_the_export_of_a_controller_that_oscillates_or_saturates_says_so(gain, delay, limit, losses, verdict) -> None:
    """A PI controller with a delay has its limit cycle without any fault; in the last loop 12 of 13 samples are lost, and the
    limit is half of the control that the command needs."""
    lost = tuple((13 * k * T + T, 13 * (k + 1) * T) for k in range(100 if losses else 0))
    case = replace(
        STATE,
        plant=replace(STATE.plant, input=PlantInput(delay=delay, saturation=[-limit, limit])),
        reference=Step(amplitude=1.0),
        shell=Shell(longest_outage=12 * T, fallback="hold") if lost else None,
        faults=(Dropout(times=lost),) if lost else (),
    )
    law = Sampled(controller=LinearFeedback(controller=TransferFunction([gain, gain], [1.0, 0.0])), sample_time=T)
    told = own_run_warning(case, law, Simulation(t_end=12.0, dt=T / 2), None)
    wanted = f"When this case is simulated, the judge's verdict on Linear is: {verdict}\\." if verdict else ""
    assert re.fullmatch(wanted, told), told


def test_the_export_of_a_shell_with_a_rate_and_no_range_says_what_a_bit_error_does() -> None:
    for ranges, count in (({}, 1), ({"x_1": [-9.0, 9.0]}, 0)):
        case = replace(STATE, shell=Shell(rate={"x_1": 50.0}, range=ranges))
        told = own_run_warning(case, KNOWN, Simulation(t_end=2.0, dt=T / 2), None)
        assert told.count("shell.rate is given for x_1, but shell.range is not.") == count


def test_the_export_says_if_the_shell_refuses_the_own_run_after_the_test_vectors(tmp_path) -> None:
    """The command, and then the state, changes to 2 at t = 11 s. The 1000 samples that an export replays end at 10 s."""
    late = replace(STATE, reference=Step(amplitude=2.0, start=11.0), faults=(Dropout(share=0.5),))
    told: list[str] = []
    for limit in (3.0, 1.5):
        guarded = replace(late, shell=Shell(range={"x_1": [-limit, limit]}))
        out = export_controller(guarded, KNOWN, Simulation(t_end=15.0, dt=5e-3), out=tmp_path / "out", note=told.append)
    (sentence,) = told
    assert sentence.startswith("When this case is simulated without faults, ")
    assert (
        sentence.endswith(": widen the limits of the shell.")
        and "% of the 1500 samples were lost or rejected by the shell" in sentence
    )
    assert f"**{sentence}**" in (out / "README.md").read_text()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Höhe (über Grund) [°]", "Hohe (uber Grund) [deg]"),
        ("m/s²", "m/s^2"),
        ("kg·m²·s⁻²", "kg*m^2*s^-2"),
        ("µs", "us"),
        ("V/Ω", "V/Ohm"),
        ("α̇", "alpha_dot"),
        ("Δφ₁", "Deltaphi1"),
        ("高", "(U+9AD8)"),
        ("a */ b \\", "a * / b /"),
    ],
)
def test_labels_are_written_in_ascii_in_c(text, expected) -> None:
    assert comment(text) == expected


def test_different_labels_stay_different_in_c() -> None:
    assert comments(["Ä", "Ö", "A", "q"]) == ["(U+00C4)", "O", "A", "q"]
    assert comments(["é", "e", "é"]) == ["(U+00E9)", "e", "(U+00E9)"]


def test_the_readme_has_the_labels_as_they_are() -> None:
    names, units = ["Höhe (über Grund)", "Hohe (uber Grund)"], ["°", "m/s²"]
    guarded = replace(STATE, labels=Labels(names=names, units=units, input_units=["N·m"]), name="Fläche")
    guarded = replace(guarded, shell=Shell(range={names[0]: [-100.0, 100.0]}))
    made = files(guarded, KNOWN, SIMULATION)
    for text in ("Höhe (über Grund) [°]", "x[1] is Hohe (uber Grund) [m/s²]", "u is in N·m", "[N·m] at once", "Fläche", "100 °"):
        assert text in made["README.md"], text
    for name in ("controller.h", "controller.c", "selftest.c"):
        assert made[name].isascii() and "?he" not in made[name] and "[?]" not in made[name]
    labels = made["controller.h"].partition("_LOG_LABELS ")[2].partition("}")[0]
    assert '"Hohe (uber Grund) [deg]", "Hohe (uber Grund) [m/s^2]"' in labels


def test_what_is_a_single_state_keeps_its_unit_beside_what_is_none() -> None:
    labels = Labels(names=["angle", "rate"], units=["deg", "deg/s"])
    observer = LuenbergerObserver(poles=[-20.0, -30.0], measured=[[1.0, 0.0], [1.0, 1.0]])
    seen = replace(STATE, labels=labels, observer=observer, sensor=None)
    assert seen.measured_labels == replace(labels, names=("angle", "y_2"), units=("deg", ""))
    assert "angle [deg], y_2" in header(Printed(Contents.of(seen, KNOWN, SIMULATION, DOUBLE)))
