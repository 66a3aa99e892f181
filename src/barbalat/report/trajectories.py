"""What a run recorded, as a table for other programs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

import numpy as np

from barbalat.report.file_names import table_names
from barbalat.report.files import Folder
from barbalat.run.results.result import Result

MOST_NUMBERS = 60_000
"""In all CSVs of a folder: 17 bytes each, some 1 MB of its 2 MB. Results in Python have all that was recorded."""


def write_trajectories(folder: Folder, results: Sequence[Result], *, whole: bool = False) -> None:
    """One CSV for each controller, the recorded instants as rows, or every second, third, ... where these were too many.

    With ``whole`` every recorded instant.
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
