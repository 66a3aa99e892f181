"""A row's notebook runs without changes and gives the row's finding."""

from __future__ import annotations

import json

import pytest

from barbalat.cli import main
from barbalat.papers.ledger import row
from barbalat.papers.notebook import notebook
from barbalat.papers.paper import papers

FILTER = "kappa-0.05"


def executed(text: str) -> str:
    """The output of the cells in a kernel, as for a reader."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    cells = nbformat.reads(text, as_version=4)
    nbclient.NotebookClient(cells, timeout=600).execute()
    outputs = [out for cell in cells.cells for out in cell.get("outputs", ())]
    return "".join(out.get("text", "") for out in outputs)


def test_every_row_has_one():
    """Every row has a valid notebook with the code that lists the row."""
    for paper in papers().values():
        for part in paper.ledger:
            for name in part.names:
                cells = json.loads(notebook(name))["cells"]
                code = next(text for cell in cells[1:] if "ROWS" in (text := "".join(cell["source"])))
                compile(code, name, "exec")
                assert part.code.rpartition(" ")[2].split(".")[0] in code


JUDGES_RUNS = next(name for paper in papers().values() for part in paper.ledger if part.judges_runs for name in part.names)
OF_OTHERS = [next(name for part in paper.ledger for name in part.names) for paper in list(papers().values())[1:]]
OF_EACH_KIND = [FILTER, "adaptive-in-flight", JUDGES_RUNS, *OF_OTHERS]
"""A plain row, a stored one, one that judges the paper's runs, and one of each other paper."""


@pytest.mark.full
@pytest.mark.parametrize("name", OF_EACH_KIND)
def test_a_row_of_each_kind_runs_and_gives_its_finding(name):
    said = executed(notebook(name))
    claim = row(name)
    assert said.startswith(f"{claim.finding} | {claim.headline}")


def test_the_command_writes_it(tmp_path, capsys):
    file = tmp_path / "row.ipynb"
    assert main(["claims", FILTER, "--notebook", str(file)]) == 0
    assert file.read_text("utf-8") == notebook(FILTER)
    assert main(["claims", "--notebook", str(file)]) == 2
    assert "needs the NAME of a claim" in capsys.readouterr().err
