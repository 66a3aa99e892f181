"""The screens at 60, 80 and 120 columns: no line is longer, and no number, name or unit is split between two lines."""

import dataclasses
import io
import math
import re
from functools import cache
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from barbalat.cases.load import bundled, load_case, parse_case
from barbalat.certificates.certificate import Certificate, Simulated
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify
from barbalat.certificates.entry import Entry, speaks_of_the_motion
from barbalat.certificates.summary import five
from barbalat.papers.claim import Listing
from barbalat.papers.finding import Reading
from barbalat.papers.jafari_2013.paper import PAPER
from barbalat.papers.paper import Check, PaperFigure
from barbalat.pictures.symbols import HELD_BLANK, number_text
from barbalat.report.terminal import certificates, ledger, runs
from barbalat.report.terminal.layout import Screen, capitalized, fold
from barbalat.run.engine.simulate import simulate
from barbalat.run.results.findings import Finding, Told, together
from barbalat.run.results.outcome import DEMAND
from barbalat.solvers import SOLVERS
from papers.a_claim import a_claim

WIDE = 400
WIDTHS = (60, 80, 120)
CASES = ("paper", "rohrs", "l1-output", "f16-short-period", "first-order")


def shown(width, show, encoding="utf-8") -> str:
    """The output on a terminal with this many columns."""
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding, errors="backslashreplace", write_through=True)
    show(Screen(Console(file=file, width=width, highlight=False, markup=False, emoji=False), longest=width))
    return raw.getvalue().decode(encoding)


@cache
def case(name):
    """A short case, because the screen has the same form after 2 s."""
    found = load_case(name)
    return dataclasses.replace(found, simulation=dataclasses.replace(found.simulation, t_end=4.0, dt=1e-3))


@cache
def results(name):
    found = case(name)
    return list(simulate(found.problem, found.controllers, found.simulation).values())


@cache
def certified(name):
    found = case(name)
    made = certify(found.problem, found.controllers, found.simulation)
    return made, table_1(found.problem, found.controllers, made)


CLAIM = a_claim(
    "oscillation-without-filter", False,
    quote="The estimates' path grows with 1.5e+03 rad/s and falls within 0.25 s",
    statement="The estimates' path grows with 1.5e+03 rad/s and falls within 0.25 s",
    measured="largest |e| / bound 0.55, median 0.43, [3.16e+03, 522, 197] for kappa [0.04, 0.02] s " * 3,
    how="RK4, h = 1e-4 s, 20 s, every step",
    listings=(Listing("Codes", ("code", "seconds"), (("LSODA", "1.7 s"), ("BDF", "19.7 s"))),),
    shows="It takes 19.7 s.",
    weaker=(Reading("with h = 1e-5 s", True, "0.319 to 0.357 rad/s"), Reading("over 60 s", False, "5.7 s", "beside")),
    would_change="a gain of 1e+06 at h = 1e-06 s",
)  # fmt: skip
NUMBERED = a_claim("own", False, shows="0.55 of the bound at most, over 192 runs of 20 s each, every step of 1e-4 s.")
PLAIN = a_claim("bound-9", True, shows="The largest is 0.55 of the bound.")
FIGURE = PaperFigure(
    key="3", title="Figure 3: L1-AC, adaptive gain 1e4, step 1e-4 s", caption="", results={},
    checks=(Check("it stays", True, "40.4"), Check("it diverges", False, "bounded, max |e| [40.4, 19.4] at h = 1e-05 s")),
)  # fmt: skip

SCREENS = {
    **{f"run {name}": lambda screen, name=name: runs.show(screen, case(name).name, results(name)) for name in CASES},
    **{f"run {name} --full": lambda screen, name=name: runs.show_full(screen, case(name).name, results(name)) for name in CASES},
    **{f"certify {name}": lambda s, name=name: certificates.show(s, name, *certified(name), 1e-3) for name in CASES},
    **{f"certify {name} --full": lambda s, name=name: certificates.show_full(s, name, *certified(name), 1e-3) for name in CASES},
    "claims": lambda screen: ledger.names(screen, [PAPER]),
    "claims NAME": lambda screen: ledger.in_full(screen, CLAIM),
    "reproduce": lambda screen: ledger.overview(screen, [FIGURE], [CLAIM, NUMBERED, PLAIN]),
    "while it reproduces": lambda screen: [ledger.streamed(screen, claim) for claim in (CLAIM, NUMBERED)],
}
LONG = (
    "Model reference adaptive control with a large gain",
    "適応制御の長い名前を持つ制御器であるところのもの二",
    "Filtered_model_reference_adaptive_control_without_a_blank",
)


@cache
def long_named():
    """The paper's controllers with names so long that a table has no room."""
    found = case("paper")
    controllers = [dataclasses.replace(one, name=name) for one, name in zip(found.controllers, LONG, strict=True)]
    made = certify(found.problem, controllers, found.simulation)
    return list(simulate(found.problem, controllers, found.simulation).values()), made


LONG_SCREENS = {
    "run": lambda screen: runs.show(screen, "long", long_named()[0]),
    "run --full": lambda screen: runs.show_full(screen, "long", long_named()[0]),
    "certify": lambda screen: certificates.show(screen, "long", long_named()[1], long_named()[1].table, 1e-3),
    "certify --full": lambda screen: certificates.show_full(screen, "long", long_named()[1], long_named()[1].table, 1e-3),
}


@pytest.mark.parametrize("screen", LONG_SCREENS)
@pytest.mark.parametrize("width", [60, 80, 100])
def test_a_long_name_stands_on_one_line_above_its_numbers(width, screen):
    lines = shown(width, LONG_SCREENS[screen]).splitlines()
    assert max(map(cell_len, lines)) <= width
    assert all(any(name in line for line in lines) for name in LONG)
    if screen == "run --full" and width == 80:
        assert all(lines.count(name) == 4 for name in LONG)  # of four tables
        assert {"e_1", "theta_1"} < {line.split()[0] for k, line in enumerate(lines[1:]) if lines[k] in LONG}


def test_a_name_that_no_line_holds_goes_on_below():
    name = "a" * 70
    assert fold(name, 60) == ["a" * 60, "a" * 10] and fold(f"{name} 1.5 s", 60)[-1] == f"{'a' * 10} 1.5{HELD_BLANK}s"


NUMBER_WITH_UNIT = re.compile(r"\d[\d.e+-]*\]? (?:rad/s|s|%|rad)(?![\w/])")


def words(text) -> set[str]:
    return {word.strip("().,:;") for word in text.split()} | {""}


@pytest.mark.parametrize("name", SCREENS)
@pytest.mark.parametrize("width", WIDTHS)
def test_no_line_is_longer_and_nothing_is_broken(name, width):
    narrow, wide = shown(width, SCREENS[name]), shown(WIDE, SCREENS[name])
    assert max(map(cell_len, narrow.splitlines())) <= width
    shown_here = re.sub(r"\d+ more findings?: --full\s+shows\s+all\s+of\s+them", "", narrow)  # fewer columns fit into short lines
    assert {re.sub(r"^[─-]+$", "", word) for word in words(shown_here)} <= words(wide) | {""}
    lines = narrow.splitlines()
    for line, following in pairwise(lines):
        assert not NUMBER_WITH_UNIT.match(f"{line.split()[-1] if line.split() else ''} {following.split(' ')[0]}")
        joined = f"{line.rstrip().rpartition(' ')[2]} {following.strip().partition(' ')[0]}"
        found = NUMBER_WITH_UNIT.fullmatch(joined.rstrip(".,;:)"))
        assert not found or joined not in wide, joined


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", CASES)
def test_every_figure_of_a_run_is_there_as_one_word(name, width):
    text = words(shown(width, SCREENS[f"run {name} --full"]))
    for result in results(name):
        for key in ("max_abs_e", "rms_e", "tail_max_abs_e", "max_abs_u", "theta_hat_final"):
            value = result.figures[key]
            assert {number_text(v) for v in (value if isinstance(value, list) else [value])} <= text


@pytest.mark.parametrize("name", CASES)
def test_the_short_screen_has_a_sentence_for_each_controller_and_room_on_one_page(name):
    """Three controllers need at most 30 lines, plus three that the command prints; nothing is repeated."""
    text = shown(80, SCREENS[f"run {name}"])
    lines, found = text.splitlines(), results(name)
    assert len(lines) <= runs.MOST_LINES - runs.LINES_BEHIND + 2 * max(len(found) - 3, 0)
    joined = " ".join(text.split())
    assert all(f"{result.name}: {result.verdict}" in joined for result in found)
    assert [joined.index(f"{result.name}: {result.verdict}") for result in found] == sorted(
        joined.index(f"{result.name}: {result.verdict}") for result in found
    )
    for result in found:
        assert any(line.startswith(result.name) and "|" not in line and ":" not in line for line in lines)  # the table's


def test_findings_are_told_once_for_all_runs():
    """There is one sentence for each kind, with the controllers that it concerns and the number of similar findings with other
    values."""
    one, other = Finding("on bounds", "theta_1 sits, 60 %"), Finding("on bounds", "theta_2 sits, 70 %")
    held, still = Finding("record of a signal", "the command ends"), Finding("still", "it hardly adapts")
    told = together({"A": [held, one, other], "B": [held, one], "C": [still, held]})
    assert told == [
        Told((), "the command ends"),
        Told(("C",), "it hardly adapts"),
        Told(("A", "B"), "theta_1 sits, 60 % (1 more of this kind)"),
    ]


def test_findings_without_room_are_counted():
    found = [dataclasses.replace(result) for result in results("paper")]
    text = shown(80, lambda screen: runs.show(screen, "paper", found, room=0))
    assert "more findings: --full shows all of them." in text
    assert len(text.splitlines()) < len(shown(80, SCREENS["run paper"]).splitlines())


@pytest.mark.parametrize("width", WIDTHS)
def test_every_name_is_on_one_line(width):
    for name in CASES:
        for screen in (f"run {name}", f"certify {name}"):
            lines = shown(width, SCREENS[screen])
            assert all(controller.name in lines for controller in case(name).controllers)


def test_at_80_columns_a_controllers_component_has_one_line():
    lines = shown(80, SCREENS["run paper --full"]).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Robust MRAC  e_1"))
    assert [line.split()[:-4][-1] for line in (lines[first + k] for k in (0, 2, 4))] == ["e_1"] * 3


@pytest.mark.parametrize("name", (*CASES, "satellite-spin"))
def test_the_five_lines_say_what_the_entries_say(name):
    """Each number comes from an entry, and the word guaranteed appears only with guarantees."""
    made, table = certified(name)
    for column in table.columns:
        found = made[column.name]
        condition, bound, margin, limits, assumed = five(column, found, 1e-3)
        entry = found.entry("condition")
        if entry is not None and entry.value is not None:
            applies = column.cells["stability"].applies
            assert condition.text.startswith("holds") == (entry.value["holds"] and applies)
            assert ("not enough" in condition.text) == (entry.value["holds"] and not applies)
        else:
            assert condition.kind == column.cells["stability"].kind
        assert ("guaranteed" in bound.text) == bool(found.guaranteed & {"error_bound", "error_rms_bound"})
        if "error_bound" in found.guaranteed:
            printed = float(re.search(r"guaranteed.(\S+)", bound.text.replace(HELD_BLANK, " ").replace(": ", " "))[1].rstrip(";"))
            smaller = min(found.values["error_bound"], found.values.get("error_bound_worst", math.inf))
            assert smaller <= printed <= smaller * 1.001 + 1e-300
        for text, key in ((margin.text, "delay_margin"), (margin.text, "delay_margin_adapting")):
            value = found.values.get(key)
            assert value is None or f"{value:.3g} s" in text.replace(HELD_BLANK, " ")
        for value in found.values.get("delay_margin_each", []) if "delay_margin" not in found.values else []:
            shown_as = "any delay" if value is None else f"{value:.3g} s"
            assert shown_as in margin.text.replace(HELD_BLANK, " ") and margin.kind == found.entry("delay_margin_each").kind
            assert value is None or f"{value:.4g} s" in column.cells["margins"].text
        gain, step = found.values.get("gamma_max"), found.values.get("step_max")
        assert gain is None or f"gain {gain:.3g}" in limits.text.replace(HELD_BLANK, " ")
        assert step is None or f"step {step:.3g} " in limits.text.replace(HELD_BLANK, " ")
        assert step is None or ("too long" in limits.text.replace(HELD_BLANK, " ")) == (step < 1e-3)
        without = [entry for entry in (*found.entries, *column.cells.values()) if not entry.applies]
        broken = [assumption.broken for entry in without for assumption in entry.rests_on if assumption.broken]
        stated = (*found.entries, *column.cells.values())
        stands = any(speaks_of_the_motion(entry) and not entry.quantity.timeless for entry in stated)  # never beside "fails here"
        assert all(why in assumed.text for why in broken)
        assert ("fails here:" in assumed.text) == (bool(broken) and not stands)
        assert ("further values are not guaranteed" in assumed.text) == (bool(broken) and stands)


@pytest.mark.parametrize("sampled", ["", "sample_time = 0.01"])
def test_what_fails_is_named_whether_a_condition_is_met_or_not(sampled):
    """The case's delay, limits and noise violate the same assumptions with a small known set and with a large one."""
    said = []
    for reach in (0.01, 50.0):
        case = parse_case(BROKEN.format(reach=reach, sampled=sampled))
        made = certify(case.problem, case.controllers, case.simulation)
        table = table_1(case.problem, case.controllers, made)
        said.append({column.name: five(column, made[column.name], 1e-3)[4].text for column in table.columns})
        conditions = [entry.value["holds"] for found in made.values() if (entry := found.entry("condition")) is not None]
        assert conditions == [reach < 1] * len(conditions)  # a sampled linear loop has none, because the loop itself is known
    small, large = said
    for name, text in small.items():
        if name == "A" and sampled:  # another theorem covers it
            assert all(word in text and word in large[name] for word in ("rate limit", "noise"))
            continue
        for broken in ("delay 0.01 s", "saturation", "rate limit", "measurement noise", *(["input gain 0.8"] * (name == "A"))):
            assert broken in text and broken in large[name]


BROKEN = """
name = "much that breaks assumptions"
[plant]
A_m = [[0.0, 1.0], [-2.0, -2.0]]
b = [0.0, 1.0]
theta = [0.005, -0.005]
[plant.input]
gain = 0.8
delay = 0.01
saturation = [-6, 6]
rate_limit = 100.0
[reference_model]
k_0 = 2.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 1.0
[sensor.noise]
std = [0.01, 0.01]
sample_time = 0.01
[uncertainty]
lower = [-{reach}, -{reach}]
upper = [{reach}, {reach}]
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "A"
scheme = "adrc"
bandwidth = 20.0
{sampled}
[[controller]]
name = "L1"
scheme = "l1"
gamma = 100.0
filter = {{ kappa = 0.05 }}
{sampled}
"""


def test_a_condition_that_is_met_is_not_enough_with_a_delay():
    """The theorem's number holds for the loop without the delay and must not be called guaranteed for this loop."""
    late = parse_case(bundled()["paper"].read_text().replace("[plant]", "[plant]\ninput = { delay = 0.02 }", 1))
    made = certify(late.problem, late.controllers, late.simulation)
    table = table_1(late.problem, late.controllers, made)
    lines = {column.name: five(column, made[column.name], 1e-3)[0] for column in table.columns}
    met = [line for name, line in lines.items() if (entry := made[name].entry("condition")) is not None and entry.value["holds"]]
    assert met and all("not enough: delay" in line.text and line.kind == "does not apply" for line in met)


LABELS = ["condition", "bound of e", "margin", "gain, step", "assumed"]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("width", [80, 100, 60])
def test_five_lines_are_all_there_and_whole(name, width):
    """There is one line for each label, in order. A long reason continues below in full."""
    lines = shown(width, SCREENS[f"certify {name}"]).splitlines()
    made, table = certified(name)
    for column in table.columns:
        named = column.scheme.lower().startswith(column.name.lower())  # the name stands once
        heading = column.name + column.scheme[len(column.name) :][:12] if named else f"{column.name}: "
        first = next(i for i, line in enumerate(lines) if line.startswith(heading))
        own = lines[first + 1 : lines.index("", first)]
        own = own[next(i for i, line in enumerate(own) if line.startswith("  condition")) :]  # a long heading folds
        assert [line[2:14].strip() for line in own if line[2] != " "] == LABELS
        said = " ".join(" ".join(own).split())
        for line in five(column, made[column.name], 1e-3):
            assert " ".join(line.text.replace(HELD_BLANK, " ").split()) in said


def test_the_longest_limits_fit_80_columns():
    """The test prints numbers with the largest number of digits, and every verdict on the step."""
    values = {"gamma_max": 1.234e5, "gamma_max_at_model": 1.23e6, "step_max": 1.234e-5, "step_max_at_model": 1.234e-4}
    made = Certificate(tuple(Entry(key=key, value=value, kind="estimate") for key, value in values.items()))
    column = certified("paper")[1].columns[0]
    for dt, said in ((1e-5, "below"), (5e-5, "between"), (1e-3, "too long")):
        limits = five(column, made, dt)[3].text.replace(HELD_BLANK, " ")
        assert limits == f"gain 1.23e+05 to 1.2e+06, step 1.23e-05 to 0.00012 s (dt {said})" and len(limits) <= 66


@pytest.mark.parametrize(
    ("solver", "of_one", "of_all"),
    [
        ("rk4", "at least the", "at least the"),
        ("heun", "about the", "at least (or about"),
        ("euler", "about the", "at least (or about"),
    ],
)
def test_the_legend_is_that_of_the_cases_solver(solver, of_one, of_all):
    """For a method that is unstable on the imaginary axis, a limit that relies on damping is printed with "about" and never with
    "at least"."""
    found = case("paper")
    simulation = dataclasses.replace(found.simulation, solver=SOLVERS[solver])
    (mrac,) = [one for one in found.controllers if one.name == "MRAC"]
    for controllers, said in (([mrac], of_one), (found.controllers, of_all)):
        made = certify(found.problem, controllers, simulation)
        screen = shown(WIDE, lambda target, made=made: certificates.show(target, found.name, made, made.table, 1e-3))
        assert f"The solver tolerates {said}" in " ".join(screen.split())


def test_a_capital_begins_a_word_and_no_symbol():
    assert capitalized("the estimates swing") == "The estimates swing" and capitalized("a step") == "A step"
    for text in ("theta [9.0, 1.0] is outside", "x settles", "k_0 is wrong", "Gamma = 1", ""):
        assert capitalized(text) == text


def test_an_enclosure_is_on_one_line():
    lines = shown(60, SCREENS["certify paper --full"]).splitlines()
    enclosures = [line for line in lines if re.search(r"\d \.\.\.", line)]
    assert enclosures and all(re.search(r"\d \.\.\. \d", line) for line in enclosures)


def test_reproduce_ends_with_each_rows_headline_whole():
    """The comparison that is added here is not a figure of the paper."""
    added = dataclasses.replace(FIGURE, key="added", checks=(Check("it is better", True, "2"),))
    lines = shown(80, lambda screen: ledger.overview(screen, [FIGURE, added], [PLAIN, PLAIN, NUMBERED])).splitlines()
    assert lines[:2] == ["Holds: 2", "  bound-9, bound-9"]
    assert lines[2] == "Fails: 1" and " ".join(" ".join(lines[3:5]).split()) == f"own: {NUMBERED.shows}"
    assert lines[-3] == "Others: 2 holds, 1 fails"
    assert lines[-2] == "Figures: 0 of 1 as described, 1 of 2 statements hold; no curve is compared"


@pytest.mark.parametrize("name", SCREENS)
def test_a_terminal_without_unicode(name):
    text = shown(80, SCREENS[name], "ascii")
    assert text.isascii() and max(map(len, text.splitlines())) <= 80


def test_names_of_any_script_fit_a_terminal_without_it():
    text = bundled()["paper"].read_text().replace('name = "L1"', 'name = "Regler für γ = 1e4, 適応制御"')
    found = parse_case(text)
    simulation = dataclasses.replace(found.simulation, t_end=1.0, dt=1e-3)
    run = list(simulate(found.problem, found.controllers, simulation).values())
    for width in WIDTHS:
        for encoding in ("ascii", "latin-1", "utf-8"):
            lines = shown(width, lambda screen: runs.show(screen, "any", run), encoding).splitlines()
            assert max(map(cell_len, lines)) <= width


@given(st.lists(st.text("abc0123456789.e-", min_size=1, max_size=12), min_size=1, max_size=40), st.integers(30, 100))
def test_folding_keeps_every_word(parts, width):
    lines = fold(" ".join(parts), width, indent="    ")
    assert [word for line in lines for word in line.split()] == parts
    assert all(len(line) <= width for line in lines)


@pytest.mark.parametrize("text", ["the step is 0.0001 s", "at h = 1e-05 s", "of 215974 rad/s", "up to 58 % of"])
def test_a_unit_stays_with_its_number(text):
    number_and_unit = re.search(r"\d[\d.e-]* (rad/s|s|%)", text)[0]
    for width in range(len(number_and_unit), len(text) + 1):
        assert any(number_and_unit in line.replace(HELD_BLANK, " ") for line in fold(text, width))


def test_a_run_prints_every_warning_once():
    """A property of the problem is shown once for all its runs. Here x_m settles at 40/3 r, as -A_m^-1 b = (10/3, 0)."""
    text = " ".join(shown(80, SCREENS["run paper --full"]).split()).lower()
    warnings = {(result.name, warning) for result in results("paper") for warning in result.warnings}
    assert any("13.33 times" in warning for _, warning in warnings)
    for _, warning in warnings:
        said = f"{' '.join(warning.split())}.".lower()
        owners = [name for name, other in warnings if other == warning]
        assert text.count(said) == (1 if len(owners) == len(results("paper")) else len(owners))


def test_every_input_has_a_line_of_its_own():
    """Next to one component of the error, its norm would be read as the value of that component."""
    found = load_case("satellite-spin")
    run = list(simulate(found.problem, found.controllers[:1], dataclasses.replace(found.simulation, t_end=1.0)).values())
    lines = shown(80, lambda screen: runs.show_full(screen, "spin", run)).splitlines()
    lines = lines[: next(i for i, line in enumerate(lines) if line.startswith("Integrals"))]
    rows = {line.split("[")[0].split()[-1]: line.split() for line in lines if "[rad/s" in line}
    assert list(rows) == ["e_1", "e_2", "u_1", "u_2"]
    for i, value in enumerate(run[0].figures["max_abs_u"], start=1):
        assert rows[f"u_{i}"][-1] == number_text(value) and rows[f"u_{i}"][-2] == "[rad/s^2]"
    for i, value in enumerate(run[0].figures["tail_max_abs_e"], start=1):
        assert rows[f"e_{i}"][-1] == number_text(value)


def test_what_was_simulated_stands_on_the_short_screen():
    """``--simulate`` without ``--full`` shows the delays from simulations. Without simulations there is no such line."""
    made, table = certified("first-order")
    name = table.columns[0].name
    changed = {name: made[name].with_simulated(Simulated("20 s of the case's own run: follows within 3 %", {}, "delay 0.0106 s"))}
    text = shown(80, lambda screen: certificates.show(screen, "case", dict(made) | changed, table, 1e-3)).replace(HELD_BLANK, " ")
    lines = text.split(f"{name}: ")[1].splitlines()
    assert [line.split(maxsplit=1) for line in lines[1:3]] == [
        ["measured", "delay 0.0106 s"],
        ["simulated", "20 s of the case's own run: follows within 3 %"],
    ]
    assert text.count("measured ") == 1


def test_what_u_is_of_is_said_where_the_plant_gets_something_else():
    """max |u| is the demand. With limits, a gain, dynamics or a delay at the plant's input the screen says so."""
    said = {
        name: shown(80, lambda screen, name=name: runs.show(screen, name, results(name)))
        for name in ("f16-short-period", "paper")
    }
    assert [DEMAND in " ".join(text.split()) for text in said.values()] == [True, False]


def test_no_zero_has_a_minus():
    assert number_text([-0.0, -1e-9]) == "0, -1e-09"
