"""Options with several values, in every spelling, and a dash instead of a file name."""

from __future__ import annotations

import shlex

import pytest

from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case, parse_case, text_to_start_from
from barbalat.cli import _parser, main

A, B, MORE, LESS = "plant.theta[0]=1:2:3", "plant.theta[1]=uniform:1:2", "'rms_e[0] > 1'", "'max_abs_u < 9'"
TUNE = "tune --for rms_e"


def parsed(line):
    options, unknown = _parser().parse_known_args(shlex.split(line))
    assert not unknown
    return vars(options)


@pytest.mark.parametrize(
    ("start", "option", "first", "second"),
    [
        ("sweep", "--vary", A, B),
        ("sweep", "--sample", B, A),
        ("sweep", "--require", MORE, LESS),
        (TUNE, "--vary", A, B),
        (TUNE, "--subject-to", MORE, LESS),
        ("contest", "--schemes", "mrac", "l1"),
        ("fly", "--schemes", "linear", "adrc"),
        ("fly", "--failure", "elevator-50", "none"),
        ("fly", "--failures", "elevator-50", "none"),
    ],
)
def test_every_list_takes_every_spelling(start, option, first, second):
    """The values follow each other or a repeated option, and the case comes before or after them."""
    place = "name" if start == "fly" else "case"
    key = "failure" if "failure" in option else option.removeprefix("--").replace("-", "_")
    both = shlex.split(f"{first} {second}")
    for spelling in (
        f"{start} paper {option} {first} {second}",
        f"{start} paper {option} {first} {option} {second}",
        f"{start} {option} {first} {second} paper",
        f"{start} {option} {first} {option} {second} paper",
        f"{start} {option} {first} paper {option} {second}",
        f"{start} {option}={first} {option} {second} paper --out x",
        f"{start} --out x {option} {first} {second} --json paper",
        f"{start} {option} {first} {second} --out x paper --json",
    ):
        options = parsed(spelling)
        assert (options[place], options[key]) == ("paper", both), spelling
    assert parsed(f"{start} {option} {first} paper")[key] == both[:1]
    assert parsed(f"{start} paper")[key] == []


def test_two_lists_before_the_case():
    options = parsed(f"sweep --vary {A} paper --sample {B} x[0]=normal:0:1 --seed -1")
    assert options["case"] == "paper" and options["vary"] == [A] and len(options["sample"]) == 2 and options["seed"] == -1
    assert parsed(f"sweep --vary {A} --sample {B} a=b.toml")["case"] == "a=b.toml"  # a file with an equals sign in its name
    assert parsed(f"sweep --see 5 --vary {A} paper")["case"] == "paper"  # an abbreviated name of an option


def test_names_may_have_commas_between():
    assert parsed("contest paper --schemes mrac,l1 adrc")["schemes"] == ["mrac", "l1", "adrc"]
    assert parsed("fly f16-roll --schemes a,b --failures c, d --failure e")["failure"] == ["c", "", "d", "e"]


@pytest.mark.parametrize("name", [None, "paper"])
def test_a_dash_is_standard_output(name, tmp_path, monkeypatch, capsys):
    """The case is printed as plain text, for a pipe or an editor; no schema file and no file named "-" is written."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "-", *(["--from", name] if name else [])]) == 0
    said = capsys.readouterr()
    assert said.out == text_to_start_from(name) and said.err == ""
    again = load_case(name).controllers if name else parse_case(said.out).controllers
    assert [one.name for one in parse_case(said.out).controllers] == [one.name for one in again]
    assert not list(tmp_path.iterdir())


@pytest.mark.dear
def test_a_page_goes_to_standard_output(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = bundled()["first-order"].read_text()
    (tmp_path / "case.toml").write_text(text)
    assert main(["explore", "case.toml", "--no-open", "--out", "page.html"]) == 0
    capsys.readouterr()
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("nothing is there to be opened"))
    assert main(["explore", "case.toml", "--out", "-"]) == 0
    assert capsys.readouterr().out == (tmp_path / "page.html").read_text("utf-8")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["case.toml", "page.html"]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("new - --json", "both write to standard output"),
        ("explore paper --out - --json", "both write to standard output"),
        ("run paper --out -", "--out must name a folder, got '-'"),
        ("certify paper --out -", "--out must name a folder, got '-'"),
        ("reproduce --out -", "--out must name a folder, got '-'"),
        ("export paper --controller L1 --out -", "--out must name a folder, got '-'"),
        (f"sweep paper --vary {A} --store -", "--store must name a folder, got '-'"),
        ("fly f16-pitch --dispersions 2 --store -", "--store must name a folder, got '-'"),
    ],
)
def test_a_folder_is_no_standard_output(line, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(line)) == 2
    captured = capsys.readouterr()
    assert said in captured.err and captured.out == "" and not list(tmp_path.iterdir())
