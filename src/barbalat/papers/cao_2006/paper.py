"""C. Cao et al., Are Phase and Time-delay Margins Always Adversely Affected by High-Gain?, AIAA GNC, AIAA 2006-6347."""

from __future__ import annotations

from barbalat.papers.cao_2006.sentences import COVERAGE
from barbalat.papers.paper import Paper

PAPER = Paper(
    package=__package__,
    title="Are Phase and Time-delay Margins Always Adversely Affected by High-Gain?",
    introduction=""
    "The statements in the abstract of the paper by Cao, Patel, Reddy, Hovakimyan, Lavretsky and Wise (AIAA 2006-6347), "
    "measured on the class of plants that it names: a linear\nsystem under a constant disturbance. Only the abstract was "
    "available; the plant, the gains and the filters are our own.",
    coverage=COVERAGE,
)
