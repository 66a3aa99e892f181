"""What a run recorded, as a table for other programs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

import numpy as np

from barbalat.report.file_names import table_names
from barbalat.report.files import Folder
from barbalat.run.result import Result

MOST_NUMBERS = 36_000
"""In all CSVs of a folder: 17 bytes each, some 600 kB of its 2 MB. Results in Python have all that was recorded."""


def write_trajectories(folder: Folder, results: Sequence[Result], *, whole: bool = False) -> None:
    """One CSV for each controller, the recorded instants as rows, or every second, third, ... where these were too many.

    With ``whole`` every recorded instant.
    """
    for name, result in zip(table_names([result.name for result in results]), results, strict=True):
        buffer = io.StringIO()
        columns = {"t": result.t} | result.columns()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(columns)
        every = 1 if whole else max(math.ceil(len(result.t) * len(columns) * len(results) / MOST_NUMBERS), 1)
        rows = np.unique([*range(0, len(result.t), every), len(result.t) - 1])
        numbers = np.column_stack(list(columns.values()))[rows]
        writer.writerows(numbers.tolist())
        folder.write(name, buffer.getvalue())
