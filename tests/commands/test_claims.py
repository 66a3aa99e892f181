"""``barbalat claims``: the names in the ledger, and the complete measurement of one row."""

import json

from barbalat.cli import main


def test_the_list_has_every_name_and_no_verdict(capsys):
    assert main(["claims"]) == 0
    shown = capsys.readouterr().out
    assert main(["claims", "--list"]) == 0 and capsys.readouterr().out == shown
    assert main(["claims", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["claims"]
    assert all(row["id"] in shown and row["seconds"] > 0 and "verdict" not in row for row in rows)
    assert len({row["id"] for row in rows}) == len(rows) >= 30


def test_one_row_is_measured(capsys):
    assert main(["claims", "kappa-0.05", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (
        found["id"] == "kappa-0.05"
        and (found["finding"], found["verdict"]) == ("erratum", "erratum")
        and "0.0497" in found["measured"]
    )
    assert main(["claims", "kappa-0.05"]) == 0
    assert "0.0497" in capsys.readouterr().out


def test_the_list_takes_no_name(capsys):
    assert main(["claims", "bound-9", "--list"]) == 2
    assert "--list takes neither a NAME" in capsys.readouterr().err


def test_an_unknown_name(capsys):
    assert main(["claims", "bound9"]) == 2
    said = capsys.readouterr().err
    assert "'bound-9'" in said and len(said.splitlines()) == 1
