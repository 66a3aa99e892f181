"""A second process that draws while the first one simulates and draws: Matplotlib takes longer than most runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from barbalat.processes import Here, deaf_children, processes


@contextmanager
def drawing_beside() -> Iterator[Executor]:
    """What is submitted is drawn in a process of its own, or here where there is one core.

    It begins to import what draws at once: that takes about as long as a run.
    """
    if (os.cpu_count() or 1) == 1:
        yield Here()
        return
    with processes(1) as pool:
        with deaf_children():
            pool.submit(ready)
        yield pool


def ready() -> None:
    """Have imported what draws."""
    from matplotlib.backends import backend_svg  # noqa: F401

    from barbalat.report import drawings  # noqa: F401
