"""The first screen of ``certify`` says for what its guarantees hold, and why others are missing."""

import re

import pytest

from barbalat import certify
from barbalat.cases.load import load_case, parse_case
from barbalat.certificates import theorems
from barbalat.certificates.rows import radius_text, up
from barbalat.certificates.summary import five

ROLL = """
name = "roll"
[plant]
A = [[0.0, 1.0], [0.0, -4.0]]
b = [0.0, 60.0]
[plant.input]
actuator = { num = [30.0], den = [1.0, 30.0] }
delay = 0.008
gain = 0.9
[plant.disturbance]
kind = "sine"
amplitude = 0.02
frequency = 3.0
[reference_model]
poles = [[-4.0, 3.0]]
follow = "phi"
[reference]
kind = "square"
amplitude = 0.15
frequency = 0.8
[uncertainty]
lower = [-0.1, -0.06]
upper = [0.6, 0.2]
[labels]
names = ["phi", "p"]
units = ["rad", "rad/s"]
input_units = ["rad"]
[simulation]
t_end = 5.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 1.0
sample_time = 0.01
[[controller]]
name = "ADRC"
scheme = "adrc"
bandwidth = 12.0
sample_time = 0.01
[[controller]]
name = "L1"
scheme = "l1-piecewise"
filter = { kappa = 0.1 }
sample_time = 0.01
"""


def roll(*more: tuple[str, str], keys=None):
    """The certificates of the roll axis and their lines, by controller and label."""
    text = ROLL
    for old, new in more:
        assert old in text
        text = text.replace(old, new)
    case = parse_case(text)
    found = certify(case.problem, case.controllers, case.simulation, keys=keys)
    lines = {
        column.name: {one.label: one.text.replace("\N{NO-BREAK SPACE}", " ") for one in five(column, found[column.name], None)}
        for column in found.table.columns
    }
    return found, lines


def test_guaranteed_values_are_never_beside_assumptions_that_fail():
    _, lines = roll()
    assert lines["L1"]["bound of e"].startswith("guaranteed: ")
    kept, others = lines["L1"]["assumed"].split("; ")
    assert kept.endswith("assumptions, all of which hold on this case")
    assert others == (
        "further values are not guaranteed, because their assumptions fail: delay 0.008 s, actuator, input gain 0.9, unknown to "
        "the controller, disturbance"
    )
    assert lines["MRAC"]["assumed"].startswith("fails here: delay 0.008 s, actuator")


UNKNOWN_GAIN = ("upper = [0.6, 0.2]\n", "upper = [0.6, 0.2]\ninput_gain = [0.7, 1.3]\n")
WITHOUT_L1 = (ROLL[ROLL.index('[[controller]]\nname = "L1"') :], "")


def test_a_bound_for_the_case_s_theta_alone_says_so_on_the_first_screen():
    """ADRC is unstable in part of the known set; the bound is for the case's theta and gain."""
    found, lines = roll()
    bound = up(found["ADRC"].values["error_bound"])
    assert lines["ADRC"]["bound of e"] == (
        f"guaranteed: {bound}, each component in its own unit (rad, rad/s), for the case's theta and input gain only; the loop "
        "is unstable for part of the known set"
    )
    assert "with the case's theta and input gain only: |x| <= " in lines["ADRC"]["condition"]
    assert "theta and the input gain are those given in the case" in found["ADRC"].assumptions
    (column,) = (one for one in found.table.columns if one.name == "ADRC")
    assert "with the case's theta and input gain only" in column.cells["transient"].text


def test_a_sampled_bound_is_not_said_to_hold_for_the_assumed_gain():
    """The sampled bound is for the gain 0.9 of the case, and the continuous one for the gain 1 that ADRC assumes."""
    found, _ = roll(UNKNOWN_GAIN, WITHOUT_L1)
    notes = " ".join(found["ADRC"].notes)
    assert "bounds on e, x and u hold for the case's input gain, not for all of uncertainty.input_gain" in notes
    assert "that the controller assumes" not in notes
    continuous, _ = roll(UNKNOWN_GAIN, WITHOUT_L1, ("sample_time = 0.01\n", ""))
    assert "bounds on e hold for the input gain 1 that the controller assumes" in " ".join(continuous["ADRC"].notes)


IDEAL = ("actuator = { num = [30.0], den = [1.0, 30.0] }\ndelay = 0.008\ngain = 0.9\n", "")


def test_the_delay_of_one_sample_is_claimed_only_where_its_premises_hold():
    said = "its loop inside the known set tolerates a delay of one sample, 0.01 s"
    ideal, _ = roll(IDEAL)
    (note,) = (one for one in ideal["MRAC"].notes if said in one)
    assert note.startswith("without input dynamics, limits, another delay and a sensor's lag")
    for broken in (
        ("delay = 0.008\ngain = 0.9\n", ""),
        (IDEAL[0], "delay = 0.008\n"),
        (IDEAL[0], "saturation = [-0.4, 0.4]\n"),
        (IDEAL[0] + "[plant.disturbance]", "[sensor]\nlag = 0.01\n[plant.disturbance]"),
    ):
        found, _ = roll(broken)
        assert not any("tolerates a delay" in one for one in found["MRAC"].notes), broken


ADAPTIVE = (
    ROLL[ROLL.index("[[controller]]") :],
    """[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 1.0
[[controller]]
name = "closed"
scheme = "mrac-closed-loop"
gamma = 1.0
model_feedback = [[-1.0, 0.0], [0.0, -1.0]]
[[controller]]
name = "direct"
scheme = "mrac-direct"
gamma = 1.0
[[controller]]
name = "L1"
scheme = "l1"
gamma = 100.0
filter = { kappa = 0.002 }
""",
)


def test_no_bound_over_the_known_set_vanishes_without_a_reason():
    quiet = ('[plant.disturbance]\nkind = "sine"\namplitude = 0.02\nfrequency = 3.0\n', "")
    without, _ = roll(IDEAL, ADAPTIVE, quiet)
    found, lines = roll(IDEAL, ADAPTIVE)
    for name, certificate in found.items():
        for key in ("error_bound_worst", "error_bound_command"):
            assert without[name].entry(key).kind == "guaranteed", (name, key)
            entry = certificate.entry(key)
            assert entry.kind == "does not apply" and entry.theorem == theorems.DISTURBED_SET, (name, key)
    assert lines["MRAC"]["bound of e"].endswith(", for the case's theta only")
    assert lines["L1"]["bound of e"].endswith(", for the case's theta only")


def test_no_bound_over_the_known_set_vanishes_with_a_modified_law():
    found, _ = roll(IDEAL, ADAPTIVE, ('name = "MRAC"\n', 'name = "MRAC"\ndead_zone = { g_0 = 0.1 }\n'))
    assert "dead zone" in found["MRAC"].entry("error_bound_worst").why


def test_units_are_those_of_the_states():
    found, lines = roll(('units = ["rad", "rad/s"]', 'units = ["rad", "rad"]'))
    bound = up(found["ADRC"].values["error_bound"])
    assert lines["ADRC"]["bound of e"].startswith(f"guaranteed: {bound} rad, for")
    assert found["ADRC"].entry("error_bound").unit == "rad"
    _, lines = roll(('units = ["rad", "rad/s"]\n', ""))
    assert lines["ADRC"]["bound of e"].startswith(f"guaranteed: {bound}, for")


CONTINUOUS = ("sample_time = 0.01\n", "")


def test_a_linear_loop_lacks_no_theorem_about_adaptation():
    found, lines = roll(WITHOUT_L1, CONTINUOUS)
    entry = found["ADRC"].entry("error_bound")
    assert theorems.LINEAR_DELAY in entry.theorem and "adaptive" not in entry.theorem and "Lyapunov" not in entry.theorem
    assert theorems.DELAY in found["MRAC"].entry("error_bound").theorem and lines["ADRC"]["bound of e"].startswith("none: ")
    parts = entry.theorem.split("; ")
    assert len(parts) == len(set(parts))


def test_what_is_missing_under_gaussian_noise_is_said_once():
    found, lines = roll(("[plant.disturbance]", "[sensor]\nnoise = { std = 0.001, sample_time = 0.01 }\n[plant.disturbance]"))
    rms = up(found["ADRC"].values["error_rms_bound"])
    assert lines["ADRC"]["bound of e"] == (
        "none: Gaussian measurement noise. What is missing: no theorem: Gaussian noise has no bound. The root mean square of "
        f"every component, over all realisations of the noise, is guaranteed: {rms}, each component in its own unit (rad, "
        "rad/s), for the case's theta and input gain only; the loop is unstable for part of the known set"
    )
    assert "Gaussian" not in found["MRAC"].entry("error_bound").theorem


def test_an_unstable_sampled_loop_lacks_no_theorem():
    found, _ = roll(("bandwidth = 12.0", "bandwidth = 400.0"))
    entry = found["ADRC"].entry("error_bound")
    assert entry.why == "the sampled-data loop is unstable" and entry.theorem == theorems.LINEAR_UNSTABLE


def test_the_first_bound_is_the_smallest_that_holds_at_the_case_s_theta():
    """On Section V (10) gives 521 for the case's theta, and a bound for any theta of the known set is smaller."""
    case = load_case("paper")
    found = certify(case.problem, case.controllers, case.simulation, keys=("error_bound", "error_bound_worst"))
    lines = {column.name: five(column, found[column.name], None)[1].text for column in found.table.columns}
    said = {name: text.replace("\N{NO-BREAK SPACE}", " ") for name, text in lines.items()}
    assert found["L1"].values["error_bound"] > 500
    assert said["L1"].startswith("guaranteed: 81.4") and "521" not in said["L1"]
    assert re.match(r"guaranteed: 6\.604; 9\.339 for any theta of the known set", said["MRAC"])


@pytest.mark.parametrize(
    ("radius", "text"), [(0.5, "0.5"), (1.0, "1"), (1 - 4e-7, "1 - 4e-07"), (1 + 2e-6, "1 + 2e-06"), (1.153, "1.153")]
)
def test_a_spectral_radius_is_never_rounded_to_one(radius, text):
    assert radius_text(radius) == text


def test_a_sampled_law_also_lacks_its_sampled_theorem():
    """Removing the delay and the actuator alone would give no bound."""
    entry = roll()[0]["MRAC"].entry("error_bound")
    assert {theorems.DELAY, theorems.ACTUATOR, theorems.SAMPLED} <= set(entry.theorem.split("; "))
    assert entry.why.endswith(", sampled every 0.01 s")


def test_another_actuator_of_the_truth_is_named_by_its_coefficients():
    found, _ = roll(("[labels]", "[truth.input]\nactuator = { num = [20.0], den = [1.0, 20.0] }\n[labels]"))
    notes = " ".join(found["ADRC"].notes)
    assert "actuator num = [20], den = [1, 20], not num = [30], den = [1, 30]" in notes and "TransferFunction" not in notes


def test_a_loop_that_is_bounded_without_its_condition_is_said_to_be_bounded():
    """The continuous ADRC fails its small gain over the known set and is bounded at the case's theta."""
    found, lines = roll(WITHOUT_L1, CONTINUOUS, ("delay = 0.008\n", ""))
    assert not found["ADRC"].values["condition"]["holds"] and "error_bound" in found["ADRC"].guaranteed
    not_shown, bounded = lines["ADRC"]["condition"].split("; ")
    assert not_shown.endswith("is not below 1")
    assert bounded.startswith("bounded: ") and "with the case's theta and input gain only" in bounded
