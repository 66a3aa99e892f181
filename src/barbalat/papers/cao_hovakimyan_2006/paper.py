"""C. Cao, N. Hovakimyan, Design and Analysis of a Novel L1 Adaptive Control Architecture, arXiv:math/0608320, 2006."""

from __future__ import annotations

from barbalat.papers.cao_hovakimyan_2006.sentences import COVERAGE
from barbalat.papers.paper import Paper

PAPER = Paper(
    package=__package__,
    title="Design and Analysis of a Novel L1 Adaptive Control Architecture with Guaranteed Transient Performance",
    introduction="The statements in the abstract of the paper by Cao and Hovakimyan (arXiv:math/0608320, 2006), measured on the plant of the opposing paper's example, Section V of\n"
    "<em>What is L1 Adaptive Control</em>. Only the abstract was available, without its last sentence.",
    coverage=COVERAGE,
)
