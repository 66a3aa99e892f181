"""The record of a run, as a table for other programs."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from barbalat.folders import Folder
from barbalat.problem.labels import UNLABELLED
from barbalat.problem.output_feedback import OutputProblem
from barbalat.report.file_names import file_name, table_names
from barbalat.run.results.result import Result

MOST_NUMBERS = 60_000
"""Largest number of entries in all CSVs of a folder. At 17 bytes each, they take about 1 MB of the 2 MB of a folder. Results in
Python contain everything that was recorded."""


def write_trajectories(folder: Folder, results: Sequence[Result], *, whole: bool = False) -> None:
    """Write one CSV for each controller, with the recorded instants as rows.

    If there are too many, only every second, third, ... instant is written, unless ``whole`` is set.
    """
    tables = [{"t": result.t} | result.columns() for result in results]
    numbers = sum(len(columns) * len(columns["t"]) for columns in tables)
    every = 1 if whole else max(math.ceil(numbers / MOST_NUMBERS), 1)
    for name, columns in zip(table_names([result.name for result in results]), tables, strict=True):
        buffer, last = io.StringIO(), len(columns["t"]) - 1
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(columns)
        rows = np.unique([*range(0, last + 1, every), last])
        writer.writerows(np.column_stack(list(columns.values()))[rows].tolist())
        folder.write(name, buffer.getvalue())


MEANINGS = {
    "t": "time",
    "x": "state",
    "x_m": "the reference model's state",
    "e": "tracking error",
    "theta_hat": "estimate",
    "u": "control, as computed by the controller",
    "r": "command",
    "y": "output",
    "x_observed": "the observer's estimate of the state",
}
"""Meanings of columns by the part of their name before the number. The meanings of columns that are specific to a controller
follow from their roles."""


def data_package(case: str, results: Sequence[Result]) -> dict[str, Any]:
    """Return the description of the CSVs, with one resource for each. Units that the case does not state are omitted."""
    files = table_names([result.name for result in results])
    return {
        "profile": "tabular-data-package",
        "name": file_name(case),
        "title": case,
        "resources": [
            {
                "profile": "tabular-data-resource",
                "name": file.removesuffix(".csv"),
                "path": file,
                "title": result.name,
                "format": "csv",
                "mediatype": "text/csv",
                "encoding": "utf-8",
                "schema": {"fields": [_field(name, result) for name in ("t", *result.columns())], "missingValues": ["", "nan"]},
            }
            for file, result in zip(files, results, strict=True)
        ],
    }


def _field(column: str, result: Result) -> dict[str, str]:
    found = re.fullmatch(r"(\w+?)(?:_(\d+))?", column)
    assert found is not None  # column names are words
    symbol, number = found[1], int(found[2] or 1)
    field = {"name": column, "type": "number"}
    if title := MEANINGS.get(symbol) or result.column_meanings().get(column):
        field["title"] = title
    name, unit = _label(symbol, number - 1, result)
    return field | ({"description": name} if name else {}) | ({"unit": unit} if unit else {})


def _label(symbol: str, place: int, result: Result) -> tuple[str, str]:
    """Return label and unit from the case."""
    if symbol == "t":
        return "", "s"
    labels = result.problem.labels or UNLABELLED
    if symbol == "u":
        return "", "".join(labels.input_units[place : place + 1])
    measured = ("y", "e") if isinstance(result.problem, OutputProblem) else ("x", "x_m", "e", "x_observed")
    return (labels.name(place), "".join(labels.units[place : place + 1])) if symbol in measured else ("", "")
