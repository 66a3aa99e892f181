"""Every claim is measured, and the findings are those expected by independent reasoning."""

import io
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from rich.console import Console

from barbalat.certificates.certificates import Table1
from barbalat.certificates.certify import Certified
from barbalat.cli import main
from barbalat.explorer import section_v
from barbalat.papers import ledger
from barbalat.papers.claim import Claim, Measurement, table
from barbalat.papers.finding import PROPORTIONAL_SHARE, VERDICTS, Finding, Reading, Sentence, finding_of
from barbalat.papers.jafari_2013.changes import CHANGED
from barbalat.papers.jafari_2013.figures import paper_figures
from barbalat.papers.jafari_2013.linear import linear_design
from barbalat.papers.jafari_2013.paper import PAPER
from barbalat.papers.jafari_2013.sentences import COVERAGE, SENTENCES
from barbalat.papers.jafari_2013.statements import MENDED, OURS
from barbalat.papers.paper import paper_of, papers
from barbalat.report import page
from barbalat.report.terminal.layout import Screen
from barbalat.report.terminal.ledger import overview
from turns import once


@pytest.fixture(scope="module")
def quick(section_v_runs, shared) -> tuple[dict[str, Claim], list[float]]:
    """The measurements of ``reproduce --quick`` and their progress."""

    def measured() -> tuple[dict[str, Claim], list[float]]:
        seen: list[float] = []
        return {claim.id: claim for claim in ledger.measure(PAPER, section_v_runs, quick=True, progress=seen.append)}, seen

    return once(shared, "quick", measured)


class Measured(Mapping):
    """The rows of the ledger. Each is measured when a test first needs it, once for all of pytest's processes."""

    def __init__(self, folder, runs):
        self.folder, self.runs, self.found = folder, runs, {}

    def __getitem__(self, name) -> Claim:
        if name not in self.found:
            (part,) = [part for part in PAPER.ledger if name in part.names]
            rows = once(self.folder, min(part.names), lambda: part.rows(*[self.runs] * part.judges_runs))
            assert [row.id for row in rows] == list(part.names)
            self.found |= {row.id: row for row in rows}
        return self.found[name]

    def __iter__(self):
        return (name for part in PAPER.ledger for name in part.names)

    def __len__(self):
        return len(list(iter(self)))


@pytest.fixture(scope="module")
def claims(section_v_runs, shared) -> Mapping[str, Claim]:
    """The measured rows of the ledger. All of them together take more than a minute of processor time."""
    return Measured(shared, section_v_runs)


EXPECTED = {
    # theory decides: Theorem 1, the swapping lemma, 1 - C = kappa s/(kappa s + 1), certified norms
    "bound-9": "holds", "bound-10": "holds", "best-kappa-zero": "holds", "erratum-14": "erratum", "tau-error": "holds",
    # to first order in kappa, and C(0) = 1: nothing remains under a constant, with any DC gain
    "bias-kappa": "mixed", "constant-command": "holds",
    "kappa-0.05": "erratum",  # 0.0497 s, rounded up
    # part (i) covers every command; (10) does not depend on time
    "part-iii": "mixed",
    # without a predictor the filter's error drives the law; V bounds x~, and the small-gain theorem bounds x
    "filtered-mrac": "fails", "same-lyapunov": "holds",
    # rank-one coupling of x~ and theta~: imaginary parts of eigenvalues grow as the root of the gain, real parts do not change
    "stiffness": "holds if",
    # the stability region of RK4 decides
    "numerical-oscillation": "holds", "boundary": "holds", "small-tau-numerics": "holds", "oscillation-without-filter": "holds",
    "no-numerical-problems": "holds",
    "smaller-gain": "holds", "figures-2-5": "holds", "no-projection": "holds", "filter-limits-theta": "holds",
    # a lightly damped oscillator oscillates by itself; RK4 damps it by (h omega)^6/144 in each step
    "own-oscillation": "holds if",
    # implicit steps amplify nothing
    "stiff-solvers": "fails",
    # V = theta_tilde'P^-1 theta_tilde; pure least squares accumulates information without bound (test_scalar_lemma.py)
    "lemma-1-bounded": "holds", "lemma-1-no-error": "holds", "lemma-1-small": "fails",
    # pure least squares has covariance ~ 1/t under excitation (Ioannou and Fidan, section 3.7); a gradient law is exponential
    "exponential-convergence": "fails",
    # delay: C/(1 - C) (1 + theta'G) crosses over near 1/kappa for any gain, the unfiltered loop near sqrt(Gamma)
    "filter-reduces-margins": "fails", "gain-reduces-margins": "holds", "l1-margins": "mixed", "no-advantage": "fails",
    # |1 - C| has one slope, or two if C'(0) = 0, and a PI's |S| has two; a robust MRAC learns theta and cancels it
    "l1-against-pi": "fails", "adaptive-against-linear": "holds",
    # H-infinity designs for the set: mu gives the tolerated size
    "non-adaptive-cannot": "fails",
    "l1-output-is-lti": "holds",
    # m s d(s) + w (s + m) is Hurwitz for no d(s) with a negative coefficient; a lead crosses over where all are 1/s^2
    "c-of-20": "holds",
    # sigma_hat(infinity) = e^(aT) sigma, which is integral action only for a = 0 (docs/piecewise.md)
    "l1-piecewise-is-lti": "mixed",
    # by the stored flights: tests/papers/jafari_2013/flight/test_flown.py, tests/vehicles/test_dispersed.py
    "adaptive-in-flight": "fails", "l1-mrac-in-flight": "mixed",
    "rohrs": "holds",
    # V decreases at every sample for any gain (docs/sampled.md); z^2 - a z + a = 0 for a delay of a samples
    "sampled-midpoint": "holds", "sampled-delay": "holds",
    # known parameters have only the error of the hold, which grows with the number of held samples
    "missed-samples": "mixed",
    # the frozen loop is unstable below a tau that grows with the delay, or with mu (test_frozen.py)
    "tau-limit-delay": "holds", "tau-limit-mu": "holds", "minus-mu-s": "holds", "tau-range": "holds",
    "siso-any-relative-degree": "holds", "delta-2-term": "holds", "any-command": "holds",
    # V' <= 0 in x_tilde and theta_tilde, for the solution of the equations
    "l1-reference-system": "holds",
    # relays with the height |x| and a delay
    "unmodelled-unbounded": "holds",
    # a linear filter does not change a frequency, but the solver's error for a discontinuous law may
    "filter-control-frequency": "holds if",
    # one slope with 20 ms has an error proportional to kappa; tuned schemes are in the row no-advantage: two slopes, a covariance
    # which takes a disturbance for the plant's dynamics
    "robust-mrac-better": "fails",
    # learning is no faster with a fine step
    "loss-of-learning": "mixed",
}  # fmt: skip


def test_quick_findings(quick):
    measured, _ = quick
    assert set(measured) >= {"erratum-14", "bound-9", "bound-10", "kappa-0.05", "exponential-convergence", "loss-of-learning"}
    assert {name: claim.finding for name, claim in measured.items()} == {name: EXPECTED[name] for name in measured}


@pytest.mark.full
def test_the_names_are_those_of_the_rows(claims):
    assert [claim.id for claim in claims.values()] == [name for part in PAPER.ledger for name in part.names]


def test_each_row_has_one_sentence_and_an_expected_finding():
    names = [name for part in PAPER.ledger for name in part.names]
    assert set(names) == set(SENTENCES) == set(EXPECTED)


@pytest.mark.full
@pytest.mark.parametrize("claim", EXPECTED)
def test_findings(claims, claim):
    assert claims[claim].finding == EXPECTED[claim]


PLACE = re.compile(r"(Abstract|Sections? [IV]+|Theorem \d|Lemma \d|Table \d|Figures? \d|eqs?\. \()")


def lines_on_the_last_screen(claim: Claim) -> int:
    """The lines of ``reproduce`` at 80 columns with the row's name and its headline."""
    said = io.StringIO()
    overview(Screen(Console(file=said, width=80)), [], [claim])
    return len(said.getvalue().splitlines()) - 3  # the heading of the finding, the count of its side, and the figures


def by_the_rules(claim: Claim) -> str:
    """The table in docs/claims.md, written a second time."""
    literal = [one.holds for one in claim.readings if one.literal]
    if all(literal):
        return "holds"
    if any(literal):
        return "mixed"
    helps = {role for role in ("mended", "weaker") for one in claim.readings if one.role == role and one.holds}
    return "erratum" if "mended" in helps else "holds if" if helps else "fails"


def check_row(claim: Claim) -> None:
    """Check a referee's requirements for every row."""
    if claim.sentence.source.side == "the critique":
        assert claim.sentence.quote and all(PLACE.match(part) for part in claim.where.split("; ")), (claim.id, claim.where)
    assert claim.ours != bool(claim.sentence.quote) or claim.sentence.source.side == "others", claim.id
    for text in (claim.measured, claim.shows, *(reading.measured for reading in claim.readings)):
        assert re.search(r"\d", text), (claim.id, text)
    assert lines_on_the_last_screen(claim) <= 4 and len(claim.shows) <= 165, (claim.id, claim.headline)
    assert claim.shows.endswith(".") and not claim.condition.endswith("."), claim.id
    assert claim.how and claim.statement and claim.would_change, claim.id
    assert claim.finding == by_the_rules(claim) and claim.verdict == VERDICTS[claim.finding], claim.id
    assert bool(claim.condition) == (claim.finding == "holds if") and claim.condition in claim.headline, claim.id
    assert tuple(one.says for one in claim.readings if one.literal) == SENTENCES[claim.id].literal, claim.id
    document = claim.as_json()
    assert {"quote", "headline", "source", "finding", "verdict"} <= set(document)
    assert all({"literal", "decides", "finding"} <= set(one) for one in document["readings"])


def test_every_quick_row_is_what_a_referee_asks_for(quick):
    for claim in quick[0].values():
        check_row(claim)


@pytest.mark.full
@pytest.mark.parametrize("name", list(EXPECTED))
def test_every_row_is_what_a_referee_asks_for(claims, name):
    claim = claims[name]
    check_row(claim)
    check_lists(claim)
    assert claim.maps or claim.listings, f"{claim.id}: a card with nothing but sentences"


BRACKETED_LIST = re.compile(r"\[[^\[\]]*(?:,[^\[\]]*){2,}\]")
"""A list of three or more entries, which must be a table."""


def check_lists(claim: Claim) -> None:
    """Check that every list is a table with its settings as rows, because two lists in one sentence are hard to compare."""
    tables = [(one.caption, *one.columns, *(entry for row in one.rows for entry in row)) for one in claim.listings]
    texts = [claim.statement, claim.headline, claim.measured, claim.how, claim.would_change, claim.sharpened]
    for text in (*texts, *(text for one in claim.readings for text in (one.says, one.measured)), *sum(tables, ())):
        assert not BRACKETED_LIST.search(text), (claim.id, text)


def test_no_text_of_a_quick_row_holds_a_list(quick):
    for claim in quick[0].values():
        check_lists(claim)
    (shown,) = quick[0]["best-kappa-zero"].listings
    assert [row[0] for row in shown.rows] == ["0.04", "0.02", "0.01", "0.001", "0"]


def test_a_list_is_found_and_a_pair_is_not():
    assert BRACKETED_LIST.search("bounds [3.16e+03, 522, 197] for kappa")
    assert not BRACKETED_LIST.search("theta = [4, -3] or [5, 5], over [t, t + T]")


def test_a_table_from_columns():
    shown = table("caption", {"of": ["a", "b"], "x": np.array([3164.9, np.nan])})
    assert (shown.columns, shown.rows) == (("of", "x"), (("a", "3160"), ("b", "-")))
    with pytest.raises(ValueError):
        table("caption", {"x": [1.0, 2.0], "y": [1.0]})


def test_the_page_of_both_sides_names_rows_that_exist():
    page = (Path(__file__).parents[2] / "docs" / "both-sides.md").read_text()
    named = set(re.findall(r'"([a-z0-9.-]+)"', "".join(re.findall(r"^rows\((.*)\)$", page, re.MULTILINE))))
    others = {name for paper in ("cao_2006", "cao_hovakimyan_2006") for part in paper_of(paper).ledger for name in part.names}
    assert others <= named <= set(EXPECTED) | others and len(named) > len(others) + 20


SAID = Sentence(
    row="a-row", source=OURS, where="here", statement="it is so, and thus", literal=("it is so at every step", "it is thus")
)


def row(*readings: Reading) -> Claim:
    return Claim(sentence=SAID, readings=readings, shows="It is 2.", measured="1", how="as said", would_change="another number")


@pytest.mark.parametrize(
    ("literal", "others", "finding"),
    [
        ((True, True), (("weaker", False),), "holds"),
        ((True, False), (("weaker", True), ("mended", True)), "mixed"),
        ((False, False), (), "fails"),
        ((False, False), (("weaker", False), ("beside", True)), "fails"),
        ((False, False), (("weaker", False), ("weaker", True)), "holds if"),
        ((False, False), (("weaker", True), ("mended", True)), "erratum"),
        ((False, False), (("mended", False), ("weaker", True)), "holds if"),
    ],
)
def test_the_rule(literal, others, finding):
    """docs/claims.md: the literal readings decide. A weaker one counts only if all of them fail, and supplementary ones never
    count."""
    weaker = [Reading(f"reading {i}", holds, "3", role) for i, (role, holds) in enumerate(others)]
    claim = row(*(SAID.reads(holds, "1", part) for part, holds in enumerate(literal)), *weaker)
    assert claim.finding == finding == by_the_rules(claim)
    assert claim.condition == ("reading 1" if finding == "holds if" else "")
    assert (claim.headline == "It is 2.") == (finding != "holds if")


def test_a_row_reads_its_sentence_literally_in_full():
    for readings in (
        (SAID.reads(True, "1"),),
        (SAID.reads(True, "1", 1), SAID.reads(True, "1")),
        (Reading("it is so", True, "1", "literal"),),
    ):
        with pytest.raises(ValueError, match=r"'a-row' must contain each literal reading"):
            row(*readings)
    with pytest.raises(ValueError, match="no reading is literal"):
        finding_of([Reading("it is so", True, "1")])


MENDABLE = [name for name, one in SENTENCES.items() if MENDED in one.equation]


def says_that_14_is_mended(claim: Claim) -> bool:
    return MENDED in claim.headline + claim.how


def test_every_quick_row_that_runs_14_says_that_its_sign_is_mended(quick):
    mine = [name for name in MENDABLE if name in quick[0]]
    assert len(mine) >= 4 and all(says_that_14_is_mended(quick[0][name]) for name in mine)


@pytest.mark.full
@pytest.mark.parametrize("name", MENDABLE)
def test_every_row_that_runs_14_says_that_its_sign_is_mended(claims, name):
    assert says_that_14_is_mended(claims[name])


def test_a_row_says_what_was_changed_after_a_measurement():
    """The last finding of each mark is the finding of the row. The JSON has both, and the equations."""
    for name, changes in CHANGED.items():
        assert SENTENCES[name].changed == changes and changes[-1].after == EXPECTED[name], name
        assert [one.date for one in changes] == sorted(one.date for one in changes), name
        assert all(one.before == other.after for other, one in pairwise(changes)), name
        assert not any(one.what.endswith(".") for one in changes), name
    document = row(*(SAID.reads(True, "1", part) for part in range(2))).as_json()
    assert document["changed"] == [] and document["equation"] == ""
    rows = [*SENTENCES.values(), *(one for paper in papers().values() for one in paper.coverage if isinstance(one, Sentence))]
    assert all(one.equation for one in rows if one.source is not OURS)


def test_the_page_of_rules_has_every_finding():
    page = (Path(__file__).parents[2] / "docs" / "claims.md").read_text()
    assert all(f"**{finding}**" in page for finding in get_args(Finding))
    assert f"to within a {'tenth' if PROPORTIONAL_SHARE == 0.1 else '?'}" in page


def test_the_coverage_goes_through_the_paper():
    """Every sentence is linked to an existing row or says what it is, and every row on the critique has a link."""
    rows = [one.row for one in COVERAGE if isinstance(one, Sentence)]
    assert len(set(rows)) == len(rows) and set(rows) == {
        name for name, one in SENTENCES.items() if one.source.key == "jafari_2013"
    }
    reasons = ("a definition", "an outline", "proved in three lines: ", "not testable here: ")
    for one in COVERAGE:
        assert one.quote and one.where, one
        assert (one.row in SENTENCES) if one.row else one.why.startswith(reasons), one


def test_the_plain_command_measures_no_row_for_long():
    """Measurements of more than 12 s on one core belong to the full command. The rows that they refine have a verdict without
    them."""
    assert all(measurement.seconds <= 12 for measurement in PAPER.ledger)


def test_full_measures_what_sharpens_a_row_instead(monkeypatch, section_v_runs):
    plain, sharper = paper_figures.as_described, paper_figures.without_projection
    only = Measurement(
        plain, 0.1, {"figures-2-5": "the figures"}, quick=True, judges_runs=True, sharper=sharper, sharper_seconds=0.3
    )
    one_row = replace(PAPER)
    vars(one_row)["ledger"] = (only,)
    for full, row in ((False, "figures-2-5"), (True, "no-projection")):
        assert [claim.id for claim in ledger.measure(one_row, section_v_runs, quick=True, full=full)] == [row]


SHARPER = [part for part in PAPER.ledger if part.sharper]


@pytest.mark.full
@pytest.mark.parametrize(
    "part",
    [pytest.param(part, id=min(part.names), marks=[pytest.mark.bulk] * (part.sharper_seconds > 60)) for part in SHARPER],
)
def test_what_sharpens_a_row_keeps_its_verdict(claims, section_v_runs, part):
    """Each refinement measures more than a run without --full and states beforehand what it adds."""
    for row in part.rows(*[section_v_runs] * part.judges_runs, full=True):
        plain = claims[row.id]
        assert row.finding == plain.finding
        assert row.sharpened == plain.sharpened
        assert row.as_json() != plain.as_json(), f"{row.id}: --full measures nothing more"


@pytest.mark.full
def test_what_is_said_to_be_sharpened_is(claims):
    sharpened = {name for name, claim in claims.items() if claim.sharpened}
    assert sharpened >= {"stiff-solvers", "bound-9", "bound-10"}
    assert sharpened == {name for part in SHARPER for name in part.names}


@pytest.mark.full
def test_the_full_command_measures_what_sharpens(monkeypatch, section_v_runs, tmp_path, capsys):
    """The ledger has one row with a different form in the full command. It uses the runs that other tests share."""
    plain, sharper = paper_figures.as_described, paper_figures.without_projection
    only = Measurement(
        plain, 0.1, {"figures-2-5": "the figures"}, quick=True, judges_runs=True, sharper=sharper, sharper_seconds=0.3
    )
    paper = replace(PAPER, run=lambda progress: section_v_runs)
    vars(paper)["ledger"] = (only,)
    monkeypatch.setitem(papers(), PAPER.name, paper)
    monkeypatch.setattr(section_v, "PAPER", "another paper, whose report has no pages with sliders")
    assert main(["reproduce", "--full", "--out", str(tmp_path), "--json"]) == 0
    assert [row["id"] for row in json.loads(capsys.readouterr().out)["claims"]] == ["no-projection"]


@pytest.mark.full
def test_numbers_that_theory_predicts(claims):
    exponent = float(re.search(r"h\^(-\d\.\d+)", claims["boundary"].measured)[1])
    assert exponent == pytest.approx(-2, abs=0.05)  # h sqrt(Gamma) = constant
    power = float(re.search(r"t\^(-\d\.\d+)", claims["exponential-convergence"].measured)[1])
    assert power == pytest.approx(-1, abs=0.1)
    low, high = map(float, re.search(r"(\d\.\d+) to (\d\.\d+) times the delay", claims["tau-limit-delay"].measured).groups())
    # for short delays the loop consists of the auxiliary input, 1/(tau s) with the delay: lost below tau = 2/pi delay
    assert 0.6 < high < 2 / np.pi < 2 * low + 0.1
    for claim in ("tau-limit-delay", "tau-limit-mu"):
        pattern = r"loses stability at (\d\.\d+) to (\d\.\d+) times"
        nearest, _ = map(float, re.search(pattern, claims[claim].measured).groups())
        assert nearest > 0.98  # nothing is tolerated beyond the linear limit, up to the resolution of tau


@pytest.mark.full
def test_linear_loops_are_lost_where_mu_says(claims):
    """Without the delay, at the corner given by mu, the last tolerated size and the first size that is not tolerated enclose
    1/mu."""
    claim = claims["adaptive-against-linear"]
    (shown,) = claim.listings
    limits = {row[0]: row[shown.columns.index("set may grow by 1/mu")] for row in shown.rows}
    plain, _ = claim.maps
    linear = [curve for curve in plain.curves if limits[curve.label] != "-"]
    assert len(linear) >= 2  # four if the extra for the H-infinity synthesis is installed
    for curve in linear:
        last, limit = curve.x[-1], float(limits[curve.label])
        following = plain.x.values[plain.x.values > last][0]
        assert last < limit * 1.01  # the limit is printed with three digits
        assert following > limit  # unstable: it exceeds every bound within 60 s


@pytest.mark.full
def test_the_map_of_gain_and_step_agrees_with_the_stability_region(claims):
    (shown,) = claims["boundary"].maps
    h_omega = shown.y.values[:, None] * np.sqrt(shown.x.values)  # up to a factor that all cells share
    oscillates = shown.values > 20
    lowest, highest = h_omega[oscillates].min(), h_omega[~oscillates].max()
    assert lowest > highest * (
        1 - 1e-4
    )  # one number separates the cells, but not up to rounding because the steps divide the run
    assert oscillates.any(axis=1).all() and (~oscillates).any(axis=1).all()  # every step has both


@pytest.mark.full
def test_the_certified_condition_lies_inside_the_exact_boundary(claims):
    (shown,) = claims["filter-limits-theta"].maps
    certified, exact, _ = shown.curves
    assert (np.interp(np.log(exact.x), np.log(certified.x), certified.y) < exact.y).all()
    # below the certified curve, which is Theorem 1's, no run may diverge
    inside = shown.y.values[:, None] < certified.y
    assert not np.isnan(shown.values[inside]).any()


def test_one_number_has_one_verdict(section_v_runs, quick):
    """For Figure 3's "proportional to kappa", the figure and the row apply the rule's 10 % to the same number."""
    checks = paper_figures.paper_figures(section_v_runs)[1].checks
    (check,) = [one for one in checks if "proportional to kappa" in one.statement]
    factor = float(re.search(r"multiplies it by ([\d.]+)", check.measured)[1])
    reading = [one for one in quick[0]["bias-kappa"].readings if one.literal][2]
    (of_row,) = re.findall(r"the error grows by a factor of ([\d.]+) from 0.01 to 0.02 s", reading.measured)
    assert factor == pytest.approx(float(of_row), rel=0.01)
    assert check.holds and reading.holds and abs(factor / 2 - 1) < PROPORTIONAL_SHARE


def test_a_page_says_whose_its_sentences_are(quick):
    claims = list(quick[0].values())
    claims.append(replace(claims[0], sentence=replace(claims[0].sentence, row="another-s", source=OURS, quote="")))
    pages = page.reproduction(PAPER, [], claims, {}, {}, Certified({}, Table1(())), [], {"total": 1.0}, {})
    said = " ".join(pages["claims.html"].split())
    assert said.count("Our own statement, ") == 1 and said.count("<blockquote>") == len(claims) - 1
    assert said.count("Jafari, Ioannou, Rudd (2013), ") == len(claims) - 1
    covered = " ".join(pages["coverage.html"].split())
    assert covered.count("<li><q>") == len(COVERAGE) and covered.count("claims.html#claim-kappa-0.05") == 1
    assert set(re.findall(r'href="claims\.html#claim-([^"]+)"', covered)) <= set(quick[0]), "a link to a card that is not there"
    assert "<code>tau-limit-delay</code>" in covered and "not measured in this run" in covered


def test_figures_are_reproduced(section_v_runs):
    assert all(figure.reproduced for figure in paper_figures.paper_figures(section_v_runs))


@pytest.mark.full
def test_what_is_measured_in_another_process_is_the_same(section_v_runs, quick):
    here, seen = quick[0].values(), []
    with ledger.under_way(PAPER, 1, quick=True) as ahead:
        found = ledger.measure(PAPER, section_v_runs, quick=True, progress=seen.append, ahead=ahead)
    assert seen[-1] == pytest.approx(1)
    assert [(claim.id, claim.finding, claim.measured) for claim in found] == [(c.id, c.finding, c.measured) for c in here]


def test_progress_is_that_of_the_seconds(quick):
    _, seen = quick
    assert seen[-1] == pytest.approx(1)
    assert (np.diff(seen) > 0).all() and max(np.diff(seen)) < 0.3


def test_without_the_extra_the_comparison_goes_on_without_hinf(monkeypatch):
    monkeypatch.setitem(sys.modules, "slycot", None)
    contestants, missing = linear_design._contestants()
    assert [c.name for c in contestants if linear_design._is_linear(c)] == ["PI"]
    assert "barbalat[robust]" in missing
