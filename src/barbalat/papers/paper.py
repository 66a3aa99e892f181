"""Papers, with claims in folders by subject, figures and certificates, and the discovery of papers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from barbalat.budget import Progress
from barbalat.certificates.certificates import Table1
from barbalat.certificates.certify import Certified
from barbalat.discovery import modules_in, packages_in, slices
from barbalat.papers.claim import Measurement
from barbalat.papers.finding import Sentence, Unmeasured
from barbalat.run.results.result import Result
from barbalat.validate import InputError, hint

GROUP = "barbalat.papers"
"""The entry points through which papers from other packages are found."""
DEFAULT = "jafari_2013"
"""The paper that ``reproduce`` uses by default."""


def _no_runs(progress: Progress | None = None) -> None:
    if progress is not None:
        progress(1.0)


def _no_figures(_: Any) -> Sequence[PaperFigure]:
    return ()


def _no_certificates() -> Certified:
    return Certified({}, Table1(()))


@dataclass(frozen=True, eq=False, kw_only=True)
class Paper:
    """A paper whose claims are measured. The package ``package`` has a module ``paper`` with this object as ``PAPER``.

    Each package in it is a subject. A file in a subject that lists measurements as ``ROWS`` adds them to the ledger. The folder
    ``cases``, if there is one, contains case files of the loops that the rows measure.

    title         the paper's title
    introduction  the first text of its first page: HTML, at least a full sentence
    on_stored     which rows show stored numbers instead of measured ones, and where these numbers come from: HTML
    on_claims     text added to the introduction on the page of the paper's claims: HTML
    on_table_1    the text on the page of its certificates: HTML
    run           a function that simulates the runs of its figures and of the measurements that ``judges_runs``
    run_seconds   its estimated duration
    figures       a function that checks the figures on these runs
    certified     a function that returns the certificates of its schemes, and Table 1
    coverage      its sentences in the order of the text, each with its row or the reason why it has no row
    """

    package: str
    title: str
    introduction: str
    on_stored: str = ""
    on_claims: str = ""
    on_table_1: str = ""
    run: Callable[[Progress | None], Any] = _no_runs
    run_seconds: float = 0.0
    figures: Callable[[Any], Sequence[PaperFigure]] = _no_figures
    certified: Callable[[], Certified] = _no_certificates
    coverage: tuple[Sentence | Unmeasured, ...] = ()

    @property
    def name(self) -> str:
        """The name of its folder, which the command line uses."""
        return self.package.rpartition(".")[2]

    @property
    def cases(self) -> tuple[Path, ...]:
        """The case files in its folder ``cases``, in alphabetical order."""
        (folder,) = import_module(self.package).__path__
        return tuple(sorted(Path(folder, "cases").glob("*.toml")))

    @cached_property
    def ledger(self) -> tuple[Measurement, ...]:
        """The measurements of its rows, in the order of the rows. Raises ValueError if two rows have the same name."""
        modules = [one for subject in packages_in(import_module(self.package)) for one in modules_in(subject)]
        found = sorted((row for one in modules for row in getattr(one, "ROWS", ())), key=lambda row: row.place)
        names = [name for measurement in found for name in measurement.names]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"{self.title!r} has several rows named {min(twice)!r}")
        return tuple(found)


@cache
def papers() -> dict[str, Paper]:
    """Return all papers by name, the default one first. Raises InputError if two have the same name, or if an entry point's paper
    cannot be imported."""
    found: dict[str, Paper] = {}
    for module in slices(__package__, GROUP, "paper"):
        paper: Paper = module.PAPER
        if paper.name in found:
            raise InputError(f"two papers have the name {paper.name!r}: {found[paper.name].package} and {paper.package}")
        found[paper.name] = paper
    return dict(sorted(found.items(), key=lambda one: one[0] != DEFAULT))  # the others keep their order


def paper_of(name: str) -> Paper:
    """Return the paper with this name. Raises InputError if there is none."""
    if name not in papers():
        raise InputError(f"PAPER must be one of {', '.join(papers())}, got {name!r}{hint(name, papers())}")
    return papers()[name]


ADDED_FIGURE = "added"
"""The key of the comparison that is not one of the paper's figures."""


@dataclass(frozen=True)
class Check:
    """One statement from a figure's description, the number that decides it, and the row that tests this sentence if there is
    one."""

    statement: str
    holds: bool
    measured: str
    row: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class PaperFigure:
    """A figure of the paper: the run that it shows, the variants that its description mentions, and the checks.

    key      "2" ... "5", or ``ADDED_FIGURE``
    results  the runs by name, with the shown one first
    """

    key: str
    title: str
    caption: str
    results: dict[str, Result]
    checks: tuple[Check, ...]

    @property
    def shown(self) -> tuple[Result, ...]:
        """The runs that are drawn: the first one, or all of them in the added comparison."""
        results = tuple(self.results.values())
        return results if self.key == ADDED_FIGURE else results[:1]

    @property
    def reproduced(self) -> bool:
        return all(check.holds for check in self.checks)

    def as_json(self) -> dict[str, Any]:
        """Return the block for a figure in the form of the JSON contract, with the checks and the solver's step as additional
        keys."""
        return {
            "reproduced": self.reproduced,
            "metrics": {name: result.figures for name, result in self.results.items()},
            "checks": [asdict(check) for check in self.checks],
            "numerics": {name: result.numerics for name, result in self.results.items()},
        }
