"""The command line: exit codes, one JSON document, nothing written on bad input."""

import json
import math
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from barbalat.cases.bundled import bundled
from barbalat.cases.load import load_case
from barbalat.cli import main
from barbalat.commands.options import whole
from barbalat.export.write import export_controller
from barbalat.papers.jafari_2013.paper import PAPER as JAFARI
from barbalat.papers.paper import papers
from barbalat.run.engine.simulate import simulate
from barbalat.validate import InputError

PAPER = bundled()["paper"].read_text()
SHORT = PAPER.replace("t_end = 60.0", "t_end = 2.0").replace("dt = 1e-4", "dt = 1e-3").replace("gamma = 1e4", "gamma = 100.0")


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(SHORT)
    return path


def numbers(document):
    if isinstance(document, dict):
        document = list(document.values())
    if isinstance(document, list):
        return [x for part in document for x in numbers(part)]
    return [document] if isinstance(document, float) else []


def test_run_json_keeps_the_contract(case_file, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(case_file), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["case"] == "Section V"
    assert document["simulation"] == {"t_end": 2.0, "dt": 1e-3, "solver": "rk4"}
    assert set(document["controllers"]) == {"L1", "MRAC", "Robust MRAC"}
    for figures in document["controllers"].values():
        for key in ("max_abs_e", "rms_e", "tail_max_abs_e", "theta_hat_final", "theta_hat_tail_min", "theta_hat_tail_max"):
            assert len(figures[key]) == 2
        assert len(figures["theta_hat_variation_rate"]) == 2
        assert figures["diverged_at"] is None and figures["max_abs_u"] > 0
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]  # --json without --out writes nothing


def test_diverged_run_is_a_finding(tmp_path, capsys):
    path = tmp_path / "case.toml"
    path.write_text(PAPER.replace("t_end = 60.0", "t_end = 4.0").replace("gamma = 1e4", "gamma = 1e4\nprojection = false"))
    assert main(["run", str(path), "--json"]) == 0
    text = capsys.readouterr().out
    assert "NaN" not in text and "Infinity" not in text
    figures = json.loads(text)["controllers"]["L1"]
    assert 0 < figures["diverged_at"] < 4
    assert figures["max_abs_u"] is None and figures["max_abs_e"] == [None, None]
    assert figures["finer_step"]["origin"] == "solver" and figures["finer_step"]["dt"] == pytest.approx(1e-5)


def test_run_writes_everything(case_file, tmp_path, capsys):
    out = tmp_path / "deep" / "out"
    assert main(["run", str(case_file), "--out", str(out)]) == 0
    names = {path.name for path in out.iterdir()}
    assert names == {
        "run.json",
        "datapackage.json",
        "report.html",
        "1-robust-mrac.csv",
        "2-l1.csv",
        "3-mrac.csv",
    }
    page = (out / "report.html").read_text()
    assert "What is guaranteed" in page and "Is it adapting?" in page
    document = json.loads((out / "run.json").read_text())
    assert set(document["certificates"]) == set(document["controllers"])  # are in addition to the contract's keys
    assert document["certificates"]["L1"]["condition"]["holds"] is True
    assert document["controllers"]["L1"]["adapting"]["path"][0] > 0
    assert 'data-kind="time"' in page and 'data-kind="loops"' in page
    assert not re.search(r"""(?:src|href)=["'](?!#)""", page)  # there is no file next to the page or elsewhere
    header, first = (out / "2-l1.csv").read_text().splitlines()[:2]
    assert header == "t,x_1,x_2,x_m_1,x_m_2,e_1,e_2,theta_hat_1,theta_hat_2,u,r,x_hat_1,x_hat_2,filter_1"
    predictor, filtered = [1, 1], [0]  # the predictor starts at x0 and the filter at zero
    assert [float(x) for x in first.split(",")] == [0, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, *predictor, *filtered]
    assert f"page: {out}" in capsys.readouterr().out
    assert all(math.isfinite(x) for x in numbers(json.loads((out / "run.json").read_text())))


def test_the_full_record_is_what_python_has(case_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(case_file), "--out", str(out), "--no-plots", "--full-record"]) == 0
    case = load_case(case_file)
    result = simulate(case.problem, case.controllers, case.simulation)["L1"]
    rows = np.loadtxt(out / "2-l1.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows, np.column_stack([result.t, *result.columns().values()]))


def test_no_plots(case_file, tmp_path):
    out = tmp_path / "out"
    assert main(["run", str(case_file), "--out", str(out), "--no-plots"]) == 0
    assert {path.suffix for path in out.iterdir()} == {".json", ".csv"}


@pytest.mark.parametrize("case", ["f16-short-period", pytest.param("l1-output", marks=pytest.mark.full)])
def test_every_column_of_every_csv_is_described(case, tmp_path):
    """A Data Package describes them, with the units that the case file states."""
    assert main(["run", case, "--out", str(tmp_path), "--no-plots"]) == 0
    package = json.loads((tmp_path / "datapackage.json").read_text())
    files = {resource["path"]: resource["schema"]["fields"] for resource in package["resources"]}
    assert set(files) == {path.name for path in tmp_path.glob("*.csv")}
    for file, fields in files.items():
        assert [field["name"] for field in fields] == (tmp_path / file).read_text().splitlines()[0].split(",")
        assert all(field["title"] for field in fields)
        units = {field["name"]: field["unit"] for field in fields if "unit" in field}
        stated = {"x_1": "rad", "x_2": "rad/s", "x_m_1": "rad", "x_m_2": "rad/s", "e_1": "rad", "e_2": "rad/s", "u": "deg"}
        assert units == {"t": "s"} | (stated if case == "f16-short-period" else {})


@pytest.mark.parametrize("damage", [("gamma = 100.0", "gamma = -1.0"), ("dt = 1e-3", "dt = 3e-3"), ("b = ", "bb = ")])
def test_bad_input_exits_2_and_writes_nothing(damage, tmp_path, capsys):
    path, out = tmp_path / "case.toml", tmp_path / "out"
    path.write_text(SHORT.replace(*damage))
    assert main(["run", str(path), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.strip().splitlines()) == 1
    assert not out.exists()


def test_unusable_folder(case_file, tmp_path, capsys):
    (tmp_path / "file").write_text("kept")
    assert main(["run", str(case_file), "--out", str(tmp_path / "file")]) == 2
    assert "output folder" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "kept"


def test_new_writes_a_case_that_runs_and_never_overwrites(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert main(["new", str(path)]) == 0
    assert main(["run", str(path), "--json"]) == 0
    path.write_text("mine")
    assert main(["new", str(path)]) == 2
    assert path.read_text() == "mine"


def test_cases_lists_the_bundled_ones(capsys):
    assert main(["cases"]) == 0
    assert "paper" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["runn"], "barbalat: COMMAND must be one of new, cases, run,"),
        (["runn"], "; got 'runn'; did you mean 'run'?"),
        ([], "barbalat: COMMAND is missing: one of new, cases, run,"),
        (["export", "paper", "--out", "x"], "barbalat export: --controller is missing: name of a sampled controller of the case"),
        (["export"], "barbalat export: CASE, --controller and --out are missing; barbalat export --help describes them"),
        (["fly"], "barbalat fly: NAME is missing: f16-pitch, f16-roll:"),
        (["new"], "barbalat new: FILE is missing: the case file to write"),
        (["completion"], "barbalat completion: SHELL is missing: one of bash, zsh"),
        (["sweep", "paper", "--membres", "3"], "barbalat sweep: unknown option --membres; did you mean --members?"),
        (["export", "paper", "--controler", "PI"], "barbalat export: unknown option --controler; did you mean --controller?"),
        (["run", "-q", "--dt=3"], "barbalat run: unknown option -q; barbalat run --help lists them"),
        (["--verison"], "barbalat: unknown option --verison; did you mean --version?"),
        (["certify", "paper", "rohrs"], "barbalat certify: does not know 'rohrs'; barbalat certify --help lists its arguments"),
        (["sweep", "paper", "--members", "x"], "barbalat sweep: --members must be a whole number, got 'x'"),
        (["sweep", "paper", "--members", "1.5"], "barbalat sweep: --members must be a whole number, got '1.5'"),
        (["sweep", "paper", "--members", "1e-400"], "barbalat sweep: --members must be a whole number, got '1e-400'"),
        (["sweep", "paper", "--members", "inf"], "barbalat sweep: --members must be a whole number, got 'inf'"),
        (["sweep", "paper", "--seed", "1e40"], "--seed must be a whole number of at most 40 digits, got '1e40'"),
        (["sweep", "paper", "--seed", "9" * 5000], "--seed must be a whole number of at most 40 digits, got '9999"),
        (
            ["run", "paper", "--budget", "-1GiB"],
            "--budget must be a positive memory, a positive time or both, such as 16GiB,5h, got '-1GiB'",
        ),
        (["run", "paper", "--budget", "5h,-1GiB"], "--budget must be a positive memory, a positive time or both"),
        (["certify", "paper", "--share", "x"], "barbalat certify: --share must be a number, got 'x'"),
        (
            ["export", "paper", "--target", "c98"],
            "--target must be one of ardupilot, c99, fmu2, fmu3, rust; got 'c98'; did you mean 'c99'?",
        ),
        (["sweep", "paper", "--vary"], "barbalat sweep: --vary: expected at least one argument"),
    ],
)
def test_what_is_typed_wrongly_is_told_in_one_sentence(typed, said, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(typed)
    captured = capsys.readouterr()
    assert stopped.value.code == 2 and captured.out == ""
    assert captured.err.count("\n") == 1 and said in captured.err


@pytest.mark.parametrize(("text", "number"), [("1e6", 10**6), ("2.5e1", 25), ("-3", -3), ("1e12", 10**12), (str(2**128), 2**128)])
def test_a_whole_number_may_be_written_with_an_exponent(text, number):
    assert whole(text) == number and type(whole(text)) is int


@pytest.mark.parametrize(
    ("given", "says"), [("s3://b/x", "--out must be a path on this computer"), ("https://b/x", "'https://b/x'")]
)
def test_an_export_to_a_url_is_refused_as_it_was_typed(given, says, tmp_path, monkeypatch, capsys):
    """The command rejects it before it looks for the case."""
    monkeypatch.chdir(tmp_path)
    assert main(["export", "none", "--controller", "L1", "--out", given]) == 2
    said = capsys.readouterr().err
    assert says in said and repr(given) in said and not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=f"out must be a path on this computer, .* got '{given}'"):
        export_controller(None, None, None, out=given)


@pytest.mark.parametrize(
    ("typed", "keys"),
    [
        (["cases"], {"cases"}),
        (["new", "own.toml"], {"case", "schema"}),
        (["explore", "case.toml", "--no-open"], {"case", "page"}),
        (
            ["export", "case.toml", "--controller", "MRAC", "--out", "made"],
            {"case", "controller", "target", "folder", "files", "check"},
        ),
    ],
)
def test_what_a_command_leaves_is_one_document(typed, keys, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    sampled = SHORT[: SHORT.index("[[controller]]")] + '[[controller]]\nscheme = "mrac"\ngamma = 9.0\nsample_time = 1e-2\n'
    (tmp_path / "case.toml").write_text(sampled)
    assert main([*typed, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == keys
    for key in ("page", "schema", "folder"):
        assert key not in document or (tmp_path / document[key]).exists()
    assert all((tmp_path / document["folder"] / name).is_file() for name in document.get("files", []))


def test_help_imports_nothing_heavy():
    """No numerical package is loaded to print the help, so it is fast by construction."""
    code = """
import sys
from barbalat.cli import main
try:
    main(["--help"])
finally:
    print(sorted({"numpy", "casadi", "rich", "pydantic"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stdout.strip().endswith("[]")


@pytest.mark.dear
def test_reproduce(tmp_path, capsys, monkeypatch, section_v_runs):
    monkeypatch.setitem(
        papers(), JAFARI.name, replace(JAFARI, run=lambda progress: section_v_runs)
    )  # the same as above, shared with other tests
    assert main(["reproduce", "--quick", "--out", str(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document["figures"]) >= {"2", "3", "4", "5"}
    assert all(figure["reproduced"] for figure in document["figures"].values())
    assert document["figures"]["3"]["metrics"]["L1"]["theta_hat_tail_max"] == [5.0, 5.0]
    verdicts = {claim["id"]: claim["verdict"] for claim in document["claims"]}
    assert verdicts["erratum-14"] == "erratum"
    assert document["seconds"]["total"] > 0
    assert [column["name"] for column in document["table_1"]["columns"]][2] == "L1"
    assert document["certificates"]["L1, gamma 1e6, h = 1e-05 s"]["gamma_max"] < 1e6
    for key in ("2", "3", "4", "5", "added"):
        assert (tmp_path / f"figure-{key}.png").stat().st_size > 10_000
        assert (tmp_path / f"figure-{key}.svg").read_text().rstrip().endswith("</svg>")
    page = (tmp_path / "report.html").read_text()
    assert page.count('<img src="figure-') == 5
    assert "4 of its 4 figures" in page and "no curve is compared" in page  # the fifth one is added by this package


def test_quick_and_full_exclude_each_other(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["reproduce", "--quick", "--full"])
    assert stopped.value.code == 2
    assert "--full: not allowed with argument --quick" in capsys.readouterr().err


def test_python_dash_m_is_the_command():
    done = subprocess.run([sys.executable, "-m", "barbalat", "cases"], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "l1-output" in done.stdout


@pytest.mark.full
def test_certify_with_simulated_margins(case_file, capsys):
    """Both definitions of loss are tested. With a smaller allowed increase of the error, the loop is lost at a shorter delay."""
    found = []
    for options in ([], ["--share", "0.3"]):
        assert main(["certify", str(case_file), "--simulate", "--json", *options]) == 0
        found.append(json.loads(capsys.readouterr().out)["controllers"]["MRAC"])
    assert found[0]["delay_onset_simulated"] <= found[0]["delay_margin_simulated"]
    assert 0 < found[1]["delay_margin_simulated"] < found[0]["delay_margin_simulated"]
    assert any("0.3 times the largest |x_m|" in sentence for sentence in found[1]["assumptions"])


def test_share_without_simulation(case_file, capsys):
    assert main(["certify", str(case_file), "--share", "0.5"]) == 2
    assert "--simulate" in capsys.readouterr().err
    assert main(["certify", str(case_file), "--simulate", "--share", "-1"]) == 2
    assert "share" in capsys.readouterr().err


def test_run_measures_the_error_of_fixed_steps(capsys):
    assert main(["run", "first-order", "--accuracy", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["controllers"]
    assert all(block["measured_error"]["error"]["x"] < 1e-5 for block in found.values())
    assert all(block["measured_error"]["until"] == 60.0 for block in found.values())
