"""Cases that once ended in a traceback, an endless loop or a crash: every command finishes its work or rejects with one
sentence."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from barbalat.cases.load import load_case
from barbalat.certificates.certificates import table_1
from barbalat.certificates.certify import certify, certify_where_possible
from barbalat.certificates.schemes import l1, mrac
from barbalat.cli import main
from turns import drawn

HOSTILE = sorted((Path(__file__).parents[1] / "cases" / "hostile").glob("*.toml"))
REFUSED = {
    "fuzz-1244": "must not exceed simulation.t_end",
    "fuzz-20468": "must not exceed simulation.t_end",
    "name-ctrl": "control characters",
    "name-uni": "control characters",
    "formula-div0": "divides by zero",
    "formula-overflow": "is too large",
}
"""Cases without a meaning, with a few words of the sentence. All others run."""


def refuse(constant):
    raise AssertionError(f"{constant} is no JSON")


def strict(text):
    return json.loads(text, parse_constant=refuse)


SHOWN = {
    "name-markup": ("[/b]", "[red]x", "[bold", "[link=http://x]y"),
    "name-math": (r"$\frac{$", "_hidden"),
    "name-long": (),
    "name-two-diagrams": (),
}
"""Names that are shown unchanged, because markup, mathematics and underscores are ordinary characters."""
PLOTTED = {*drawn(HOSTILE, len(HOSTILE) // 6), *(case for case in HOSTILE if case.stem in SHOWN)}


@pytest.mark.parametrize("case", HOSTILE, ids=lambda path: path.stem)
def test_every_command_ends_well(case, tmp_path, capsys):
    """The hash of the commit selects whether the certificate is tested as JSON or on the terminal, and which sixth of the cases
    also get pictures and a page.

    For the names that must be shown, both the terminal and the pictures are tested.
    """
    out = tmp_path / "out"
    pictures = ["--pictures"] if case.stem in SHOWN else [] if case in PLOTTED else ["--no-plots"]
    shown = {}
    certified = [["certify"]] if case.stem in SHOWN else drawn([["certify", "--json"], ["certify"]], 1)
    for command, *options in (["run", "--out", str(out), *pictures], *certified):
        code = main([command, str(case), *options])
        captured = capsys.readouterr()
        shown[command] = captured.out
        if case.stem in REFUSED:
            assert code == 2 and captured.out == "" and not out.exists()
            assert REFUSED[case.stem] in captured.err
            lines = captured.err.splitlines()
            assert len(lines) <= 4 and all(line.isprintable() for line in lines) and len(captured.err) < 600
        else:
            assert code == 0
            assert "--json" not in options or strict(captured.out)["controllers"]
    if case.stem not in REFUSED:
        document = strict((out / "run.json").read_text())
        assert document["controllers"] and (document.get("certificates") or pictures == ["--no-plots"])
    if case.stem in SHOWN:
        assert all(name in text for text in shown.values() for name in SHOWN[case.stem])
        assert max(len(path.name) for path in out.iterdir()) < 100
        assert (out / "comparison.svg").read_text().endswith("</svg>\n")
    if case.stem == "name-two-diagrams":
        assert len({path.read_bytes() for path in out.glob("diagram-*.svg")}) == 2


def test_every_entry_that_claims_something_is_finite(tmp_path):
    """In fuzz-1401 some bounds overflow. The certificate says so for them, and the others are unaffected."""
    case = load_case(next(path for path in HOSTILE if path.stem == "fuzz-1401"))
    with pytest.warns(RuntimeWarning):
        (found,) = certify(case.problem, case.controllers, case.simulation).values()
    beyond = {entry.key for entry in found.entries if "exceeds the range of double precision" in entry.why}
    assert beyond == {"initial_parameter_error"} and not beyond & set(found.values) and found.values["tau_below"] == 10.0


@pytest.mark.short(kept=lambda error: isinstance(error, KeyError))
@pytest.mark.parametrize(
    "error", [KeyError("error_bound"), OverflowError(34, "out of range"), RecursionError("deep"), AssertionError()]
)
def test_a_certificate_that_fails_loses_no_run(error, tmp_path, monkeypatch, capsys):
    """Whatever the reason, the failure is a finding, and the other controllers have their certificates."""

    def failing(*_):
        raise error

    monkeypatch.setattr(mrac, "certificate", failing)
    monkeypatch.setattr(l1, "column", failing)
    case, out = HOSTILE[0].parent / "name-markup.toml", tmp_path / "out"
    assert main(["run", str(case), "--out", str(out)]) == 0
    document = strict((out / "run.json").read_text())
    (finding,) = document["certificates"]["[/b]"]["findings"]
    assert finding.startswith("no certificate: ") and type(error).__name__ in finding
    assert type(error).__name__ in (out / "report.html").read_text()
    loaded = load_case("paper")
    certificates = certify_where_possible(loaded.problem, loaded.controllers, loaded.simulation)
    columns = {column.name: column for column in table_1(loaded.problem, loaded.controllers, certificates).columns}
    assert "tracking error" in columns["Robust MRAC"].cells["tracking"].text or columns["Robust MRAC"].cells["tracking"].applies
    assert all(type(error).__name__ in cell.why for cell in columns["L1"].cells.values())


def test_the_simulation_is_written_before_anything_is_certified(tmp_path, monkeypatch):

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("barbalat.certificates.certify.certify_where_possible", interrupted)
    out = tmp_path / "out"
    assert main(["run", str(HOSTILE[0].parent / "name-markup.toml"), "--out", str(out)]) == 130
    assert {path.name for path in out.iterdir()} == {
        "run.json", "datapackage.json", "1-b.csv", "2-red-x.csv", "3-bold.csv", "4-link-http-x-y.csv",
    }  # fmt: skip
    assert strict((out / "run.json").read_text())["controllers"]


def test_legends_show_every_name():
    import matplotlib.figure

    from barbalat.pictures.panels import text_of

    axes = matplotlib.figure.Figure().subplots()
    names = [r"$\frac{$", "_hidden", "a$b$", "x" * 300]
    for name in names:
        axes.plot([0, 1], label=text_of(name))
    axes.figure.canvas.draw()
    assert len(axes.legend().get_texts()) == len(names)
    axes.figure.canvas.draw()


@pytest.mark.short(kept=lambda arguments: arguments[0] == "run")
@pytest.mark.parametrize("arguments", [["run", "--json"], ["certify", "--json"], ["run", "--no-plots"], ["certify"]])
def test_names_in_any_script_on_a_terminal_without_it(arguments, tmp_path):
    case = tmp_path / "case.toml"
    case.write_text((HOSTILE[0].parent / "name-markup.toml").read_text().replace("[/b]", "日本語 é 💥"), encoding="utf-8")
    command, *options = arguments
    done = subprocess.run(
        [sys.executable, "-m", "barbalat", command, str(case), *options],
        capture_output=True,
        check=False,
        env={"PYTHONIOENCODING": "ascii", "PYTHONPATH": ":".join(sys.path), "PATH": ""},
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode("ascii")
    if "--json" in options:
        assert "日本語 é 💥" in strict(text)["controllers"]
