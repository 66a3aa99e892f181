"""Turns a row of the ledger into a notebook, with the measuring code in an editable cell and with the results."""

from __future__ import annotations

import inspect
import json
from importlib import import_module
from typing import Any

from barbalat.discovery import modules_in, packages_in
from barbalat.papers.claim import Measurement
from barbalat.papers.finding import Sentence
from barbalat.papers.ledger import part_with
from barbalat.papers.paper import Paper

RUN = """from barbalat.papers.paper import paper_of

part = next(one for one in ROWS if {name!r} in one.names)
runs = [paper_of({paper!r}).run(None)] if part.judges_runs else []
claim = next(one for one in part.rows(*runs) if one.id == {name!r})
print(claim.finding, "|", claim.headline)
for reading in claim.readings:
    print("-", reading.role if reading.decides else "supplementary", "|", reading.finding, "|", reading.measured)"""
LISTINGS = """for listing in claim.listings:
    print(listing.caption, *(" | ".join(row) for row in (listing.columns, *listing.rows)), sep="\\n")"""


def notebook(name: str) -> str:
    """Return the notebook of a row, in the format of .ipynb files.

    One code cell contains the whole file that measures the row. Change a number there and run all cells. Raises InputError for an
    unknown name.
    """
    paper, part = part_with(name)
    sentence = next((one for one in paper.coverage if isinstance(one, Sentence) and one.row == name), None)
    module = _module_of(paper, part)
    source = inspect.getsource(module).strip()
    beside = (
        [_cell("code", f"__package__ = {module.__package__!r}  # its stored files are in the same folder")]
        if "__package__" in source
        else []
    )
    cells = [
        _cell("markdown", _introduction(paper, part, name, sentence)),
        *beside,
        _cell("code", source),
        _cell("code", RUN.format(name=name, paper=paper.name)),
        _cell("code", LISTINGS),
    ]
    kernel = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return json.dumps({"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 4}, indent=1, ensure_ascii=False)


def _introduction(paper: Paper, part: Measurement, name: str, sentence: Sentence | None) -> str:
    quote = f"> {sentence.quote}\n\n" if sentence is not None and sentence.quote else ""
    return (
        f"# {name}: {part.names[name]}\n\n{quote}This is a claim from the ledger of *{paper.title}*; it takes about "
        f"{part.seconds:g} s. "
        f"The cell with ROWS at its end is {part.code.split(':')[0]}, the file that measures it: change its plants, gains or "
        f"steps and run all cells. "
        "The finding follows from the readings by the rules of the ledger. If you change a number, the finding is yours and no "
        "longer that of the ledger."
    )


def _module_of(paper: Paper, part: Measurement) -> Any:
    """Return the module that lists the measurement."""
    modules = (one for subject in packages_in(import_module(paper.package)) for one in modules_in(subject))
    return next(one for one in modules if any(row is part for row in getattr(one, "ROWS", ())))


def _cell(kind: str, text: str) -> dict[str, Any]:
    own: dict[str, Any] = {"execution_count": None, "outputs": []} if kind == "code" else {}
    return {"cell_type": kind, "metadata": {}, "source": text.splitlines(keepends=True), **own}
