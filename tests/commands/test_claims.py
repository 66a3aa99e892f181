"""``barbalat claims``: the ledger's names, and all of one row, measured."""

import json

from barbalat.cli import main
from barbalat.papers.jafari_2013.paper import PAPER


def test_the_list_has_every_name_and_no_verdict(capsys):
    assert main(["claims"]) == 0
    shown = capsys.readouterr().out
    assert main(["claims", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["claims"]
    assert all(row["id"] in shown and row["seconds"] > 0 and "verdict" not in row for row in rows)
    assert len({row["id"] for row in rows}) == len(rows) >= 30


def test_one_row_is_measured(capsys):
    assert main(["claims", "kappa-0.05", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (
        found["id"] == "kappa-0.05"
        and (found["finding"], found["verdict"]) == ("holds if", "confirmed with conditions")
        and "0.0497" in found["measured"]
    )
    assert main(["claims", "kappa-0.05"]) == 0
    assert "0.0497" in capsys.readouterr().out


def test_an_unknown_name(capsys):
    assert main(["claims", "bound9"]) == 2
    said = capsys.readouterr().err
    assert "'bound-9'" in said and len(said.splitlines()) == 1


def test_the_names_are_those_of_the_rows(section_v_runs):
    """Of the quick rows; of all, ``tests/papers/test_ledger.py`` looks."""
    for part in (part for part in PAPER.ledger if part.quick):
        assert [row.id for row in part.rows(*([section_v_runs] if part.judges_runs else []))] == list(part.names)
