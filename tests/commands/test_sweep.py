"""``barbalat sweep``: the contract's document, a member that is run again, and one sentence for bad input."""

import json
from pathlib import Path

import pytest

from barbalat.cases.bundled import bundled
from barbalat.cli import main

CASE = bundled()["paper"].read_text().replace("t_end = 60.0", "t_end = 0.5").replace("dt = 1e-4", "dt = 1e-3")
SAMPLED = ["--sample", "plant.theta=known-set", "--members", "20"]


@pytest.fixture
def case_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "case.toml"
    path.write_text(CASE)
    return str(path)


def test_the_contracts_document_and_going_on(case_file, tmp_path, capsys):
    pytest.importorskip("pyarrow")
    command = ["sweep", case_file, *SAMPLED, "--require", "max_abs_e[0] < 0.2", "--no-bounds", "--store", "store", "--json"]
    assert main(command) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["case"] == "Section V" and document["members"] == 20 and document["resumed"] == 0
    found = document["metrics"]["max_abs_e[0]"]["L1"]
    assert found["min"] <= found["median"] <= found["max"] and 0 <= found["worst_member"] < 20
    share = document["shares"]["diverged"]["L1"]
    assert (
        share["count"] == 0 and share["confidence"] == 0.95 and share["interval"] == pytest.approx([0.0, 1 - 0.025 ** (1 / 20)])
    )
    assert "max_abs_e[0] < 0.2" in document["shares"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out) == document | {"resumed": 20}
    worst = str(found["worst_member"])
    assert main([*command, "--member", worst]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["controllers"]["L1"]["max_abs_e"][0] == found["max"] and set(again["varied"]) == {
        "plant.theta[0]",
        "plant.theta[1]",
    }
    assert {path.name for path in tmp_path.iterdir()} == {"case.toml", "store"}


PICTURES = ("verdicts", "histograms", "map", "tornado")


@pytest.mark.full
def test_pages_of_a_sweep_and_of_a_member(case_file, tmp_path, capsys):
    grid = ["--vary", "controller[1].gamma=1:1e4:4:log", "--vary", "controller[1].filter.kappa=0.01:0.05:3"]
    assert main(["sweep", case_file, *grid, "--sample", "plant.theta[0]=uniform:-5:5", "--members", "128", "--out", "map"]) == 0
    files = {path.name for path in (tmp_path / "map").iterdir()}
    assert files == {
        "report.html",
        "sweep.json",
        *(
            f"{name}{ending}"
            for name in ("histograms", "map", "tornado", "verdicts")
            for ending in (".png", ".svg", "-narrow.svg")
        ),
        *(explorers := ("explore-1-robust-mrac.html", "explore-2-l1.html", "explore-3-mrac.html")),
    }
    page = (tmp_path / "map" / "report.html").read_text()
    assert all(f'<a href="{name}">explorer</a>' in page for name in explorers)
    again = "repeated at half the step"
    assert again in page and "by default 100 times its scale (normally the largest" in page
    assert page.index("verdicts") < page.index("Failures")
    assert "worst member by this metric" in page and "the one with the largest error in the tail" in page
    assert again in " ".join(capsys.readouterr().out.split())
    assert "Failures" in page and "Over the grid" in page and "above the guaranteed bound" in page
    assert main(["sweep", case_file, *SAMPLED, "--member", "7", "--out", "seven"]) == 0
    assert "member 7" in capsys.readouterr().out and (tmp_path / "seven" / "report.html").exists()


@pytest.mark.dear
def test_the_screen_calls_errors_by_their_labels_and_the_document_by_their_indices(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    labelled = CASE + '\n[labels]\nnames = ["angle", "rate"]\n'
    Path("labelled.toml").write_text(labelled)
    command = ["sweep", "labelled.toml", *SAMPLED, "--require", "max_abs_e[rate] < 0.2", "--no-bounds"]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert "max_abs_e[angle]" in shown and "broke max_abs_e[rate] < 0.2" in shown and "max_abs_e[1]" not in shown
    assert main([*command, "--json"]) == 0
    assert "max_abs_e[1]" in json.loads(capsys.readouterr().out)["metrics"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "a number to vary"),
        (["--vary", "plant.theta[0]"], "PATH=VALUES"),
        (["--vary", "plant.thet[0]=1:2:3"], "plant.thet is not given"),
        (["--vary", "plant.theta[0]=1:2:0"], "COUNT"),
        (["--vary", "controller[0].tau=1:2:3", "--members", "5"], "a number to draw"),
        (["--sample", "plant.theta[0]=uniform:2:1"], "below"),
        ([*SAMPLED, "--require", "max_abs_e[0] ! 2"], "a requirement must be"),
        ([*SAMPLED, "--require", "max_e < 2"], "does not name a metric"),
        ([*SAMPLED, "--store", ""], "must name a folder"),
        ([*SAMPLED, "--store", "/proc/store"], "cannot be written"),
        ([*SAMPLED, "--store", "s3://bucket/x"], "--store must be a path on this computer, not a URL, got 's3"),
        ([*SAMPLED, "--out", "https://example.org/x"], "--out must be a path on this computer"),
        ([*SAMPLED, "--controllers", "file:///laws.py"], "--controllers must be a path on this computer"),
        ([*SAMPLED, "--member", "20"], "member must be"),
        (["--sample", "plant.theta[0]=uniform:1:2", "--design", "saltelli", "--members", "12"], "power of two"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments, sentence, case_file, tmp_path, capsys):
    assert main(["sweep", case_file, *arguments, "--no-bounds"]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("barbalat: ")]
    assert len(said) == 1 and sentence in said[0]
    assert [path.name for path in tmp_path.iterdir()] == ["case.toml"]
