"""S. Jafari, P. Ioannou, L. Rudd, What is L1 Adaptive Control, AIAA Guidance, Navigation, and Control Conference, 2013."""

from __future__ import annotations

from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.certificates import certified_paper
from barbalat.papers.jafari_2013.figures.paper_figures import paper_figures
from barbalat.papers.paper import Paper

PAPER = Paper(
    package=__package__,
    title="What is L1 Adaptive Control",
    introduction="Every run that Section V of the paper by Jafari, Ioannou and Rudd (AIAA GNC 2013) shows or speaks of, simulated "
    "anew, and a verdict on\nits claims.",
    on_stored="One row's numbers are, those of flights that need a flight simulator: <code>adaptive-in-flight</code>, which says "
    "where they are from.",
    on_claims="Which scheme does best on Section V when none is tuned by hand takes minutes and is not part of this run: "
    "<code>barbalat contest paper</code> tunes all under\none rule and measures them on plants, commands and noise that no tuning saw.",
    on_table_1="The paper's Table 1 compares the standard MRAC with L1-AC. Here it is rebuilt by analysis, for all of the paper's "
    "schemes and with the\nconstants of Section V.",
    run=section_v.run,
    run_seconds=6.0,
    figures=paper_figures,
    certified=certified_paper,
)
