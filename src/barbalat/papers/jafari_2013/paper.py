"""S. Jafari, P. Ioannou, L. Rudd, What is L1 Adaptive Control, AIAA Guidance, Navigation, and Control Conference, 2013."""

from __future__ import annotations

from barbalat.certificates.certify import Certified, certified_case, certify_where_possible
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.figures.paper_figures import paper_figures
from barbalat.papers.jafari_2013.sentences import COVERAGE
from barbalat.papers.paper import Paper
from barbalat.solvers.simulation import Simulation


def certified_paper() -> Certified:
    """Certify the schemes of the figures, each of which has a column in Table 1, and also L1-AC at the finer step."""
    problem = section_v.problem()
    coarse, fine = (Simulation(t_end=section_v.T_END, dt=dt) for dt in (section_v.COARSE_STEP, section_v.FINE_STEP))
    named = {controller.name: controller for controller in section_v.coarse_controllers() + section_v.fine_controllers()}
    shown = [named[name] for name in ("MRAC", "Robust MRAC, no auxiliary input", "L1", "Robust MRAC")]
    found = certified_case(problem, shown, coarse)
    certificates = {f"{name}, h = {coarse.dt:g} s": certificate for name, certificate in found.certificates.items()}
    at_fine = certify_where_possible(problem, [named[name] for name in ("L1, gamma 1e4", "L1, gamma 1e6")], fine)
    return Certified(certificates | {f"{name}, h = {fine.dt:g} s": one for name, one in at_fine.items()}, found.table)


PAPER = Paper(
    package=__package__,
    title="What is L1 Adaptive Control",
    introduction="This report repeats every run in Section V of the paper by Jafari, Ioannou and Rudd (AIAA GNC 2013) and gives a "
    "finding on\neach of the paper's sentences that can be tested here.",
    on_stored="The numbers of two rows, <code>adaptive-in-flight</code> and <code>l1-mrac-in-flight</code>, are stored, because their "
    "flights need a flight simulator; the rows state their origin.",
    on_claims="This run does not compare automatically tuned schemes on Section V, because that takes minutes; "
    "<code>barbalat contest paper</code> tunes all schemes by\none rule and measures them on validation plants, commands and noise.",
    on_table_1="The paper's Table 1 compares the standard MRAC with L1-AC. This report derives it by analysis for all of the paper's "
    "schemes, with the\nconstants of Section V.",
    run=section_v.run,
    run_seconds=6.0,
    figures=paper_figures,
    certified=certified_paper,
    coverage=COVERAGE,
)
