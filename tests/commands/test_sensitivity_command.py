"""``barbalat sensitivity``: the document, and a screen of 80 columns."""

import json

import pytest

from barbalat.cli import main
from case_texts import SECTION_V

CASE = f"""name = "short"
{SECTION_V}
[simulation]
t_end = 1.0
dt = 1e-3
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 3.0
[[controller]]
name = "Robust MRAC"
scheme = "robust-mrac"
c_0 = [1.0, 1.0]
tau = 0.5
law = {{ kind = "least-squares", covariance0 = 500.0 }}
"""


@pytest.fixture
def case(tmp_path, monkeypatch):
    (tmp_path / "case.toml").write_text(CASE)
    monkeypatch.chdir(tmp_path)
    return "case.toml"


def test_the_document_has_each_derivative_with_its_check(case, capsys):
    assert main(["sensitivity", case, "--of", "rms_e", "--to", "plant.theta[0]", "reference.amplitude", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["controllers"] == ["MRAC", "Robust MRAC"]
    assert len(found["derivatives"]) == 8
    assert found["runs"] == 24 and found["without"] == {}
    for one in found["derivatives"]:
        assert one["refused"] is None and one["instant"] is None
        assert one["derivative"] == pytest.approx(one["difference"], rel=1e-3)
        assert one["elasticity"] == pytest.approx(one["derivative"] * one["value"] / one["at"])


@pytest.mark.parametrize("options", [[], ["--of", "max_abs_u", "--controller", "MRAC"]])
def test_the_screen_ranks_the_numbers_within_80_columns(case, options, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["sensitivity", case, *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0] == "short: percent change of a metric per percent change of a parameter"
    assert ("Robust MRAC" in lines) == (not options)
    assert any(line.startswith("reference.amplitude") for line in lines)
    assert not any(line.startswith("plant.A_m[0][1]") for line in lines)
    assert any(line.startswith("  Numbers that only define a rate or the form of") for line in lines)


def test_bad_input_exits_with_2(case, capsys):
    assert main(["sensitivity", case, "--of", "verdict"]) == 2
    assert "verdict is not a metric of a run that has a derivative" in capsys.readouterr().err


def test_a_law_from_outside_has_derivatives_by_the_numbers_that_its_code_accepts_as_symbols(case, capsys):
    assert main(["new", "my-law.py"]) == 0
    capsys.readouterr()
    options = ["--controllers", "my-law.py", "--controller", "MyLaw", "--of", "rms_e", "--json"]
    assert main(["sensitivity", case, *options]) == 0
    found = json.loads(capsys.readouterr().out)
    known = {one["path"] for one in found["derivatives"] if one["derivative"]}
    assert {"plant.theta[0]", "reference.amplitude"} <= known
    assert all("on symbols fails in line" in why for path, why in found["without"].items() if path.startswith("plant.A_m"))
