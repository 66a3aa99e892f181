"""The suite (a file of cases with its hash), submissions to it, and the rows of its table, compared with stored rows."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field
from functools import cached_property
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomlkit

from barbalat import validate
from barbalat.budget import Progress, part_of
from barbalat.cases import user_controllers
from barbalat.cases.build import Case
from barbalat.cases.load import TEXT_BYTE, CaseText
from barbalat.certificates.linear_loops.margin_values import finite
from barbalat.comparison.contest.entrant import entrants_of
from barbalat.comparison.design.design import Candidate, Design, NobodyTakesPart, design
from barbalat.controllers.tuning_grid import Tunable
from barbalat.loop.binding import bound
from barbalat.processes import deaf_children
from barbalat.processes import processes as own_processes
from barbalat.protocols import Controller, SampledEquations
from barbalat.reading import contents
from barbalat.validate import InputError, hint, local_path

PUBLIC = {"public-1": "825a316fd13cf546ee84682b38c1ee8063b6345ee4c16e51df274c6f73c19001"}
"""The hashes of the public suites by their names."""
RULE_KEYS = ("plants", "trials", "members", "noise", "seed")
TABLE_PACKAGES = ("numpy", "scipy", "casadi", "llvmlite")
"""The packages whose versions may affect the last bits of a row."""
SAME_DIGITS = 1e-9
"""Relative difference up to which numbers of two rows count as equal. The rounding of a processor's linear algebra is far
smaller, and the effect of a different tuning or a different decision in the search is far larger."""
BY_THE_RULE, SUBMITTED_LAW, AS_SUBMITTED = "by the rule", "by the rule, submitted", "as submitted"
"""The origins of the settings of a registered scheme, a submitted law and a submitted case file."""
Row = dict[str, Any]


def sha256(text: str) -> str:
    """Return the SHA-256 of a text in UTF-8, in hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, eq=False, kw_only=True)
class Suite:
    """Cases without controllers, each with a specification, and the rule by which all entries are tuned and measured.

    tables  the case tables of the file, keyed by name; ``sha256`` is the hash of the text of the file
    rule    plants, trials, members, noise and seed, as in ``design``
    quick   names of the cases of ``--quick``
    """

    name: str
    sha256: str
    rule: Mapping[str, Any]
    quick: tuple[str, ...]
    tables: Mapping[str, Mapping[str, Any]]
    folder: Path

    @classmethod
    def read(cls, path: str | Path | None = None) -> Suite:
        """Read the public suite, or a file. Raises InputError for a file with the name of a public suite but a different hash."""
        source = "the public suite" if path is None else str(path)
        if path is None:
            file = resources.files("barbalat.comparison.suite") / "public.toml"
            text, folder = file.read_text("utf-8"), Path()
        else:
            place = local_path("--suite", path)
            try:
                text, folder = contents(place, "the suite", TEXT_BYTE).decode("utf-8"), place.parent
            except (OSError, UnicodeDecodeError):
                raise InputError(f"--suite: {source!r} is not a readable UTF-8 text file") from None
        text = text.replace("\r\n", "\n")
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"--suite: {source} is not valid TOML: {error}") from None
        return cls._of(data, sha256(text), source, folder)

    @classmethod
    def _of(cls, data: Mapping[str, Any], found: str, source: str, folder: Path) -> Suite:
        name, rule, cases = data.get("name"), data.get("rule"), data.get("case")
        if not isinstance(name, str) or not isinstance(rule, dict) or set(rule) != set(RULE_KEYS) or not isinstance(cases, list):
            raise InputError(f"--suite: {source} needs a name, [rule] with {', '.join(RULE_KEYS)}, and [[case]] tables")
        if name in PUBLIC and PUBLIC[name] != found:
            raise InputError(
                f"--suite: {source} has the name {name!r}, whose SHA-256 is {PUBLIC[name]}, but its own SHA-256 is {found}: a "
                f"changed suite needs a different name"
            )
        tables = {str(one.get("name")): one for one in cases}
        if bare := [key for key, one in tables.items() if not {"name", "sample_time", "specification"} <= set(one)]:
            raise InputError(f"--suite: the case {bare[0]!r} of {source} needs a name, a sample_time and a specification")
        return cls(name=name, sha256=found, rule=rule, quick=tuple(data.get("quick", ())), tables=tables, folder=folder)

    @property
    def is_public(self) -> bool:
        return PUBLIC.get(self.name) == self.sha256

    def sample_time(self, name: str) -> float:
        return float(self.tables[name]["sample_time"])

    def case(self, name: str, controllers: Sequence[Mapping[str, Any]] = ()) -> Case:
        """Return the case with this name and these controllers' tables, by default with a placeholder at the sample time of the
        case."""
        if name not in self.tables:
            raise InputError(
                f"the suite {self.name} has the cases {', '.join(self.tables)}, got {name!r}{hint(name, self.tables)}"
            )
        held = self.sample_time(name)
        given = list(controllers) or [{"scheme": "mrac", "gamma": 1.0, "sample_time": held}]
        table = {key: value for key, value in self.tables[name].items() if key != "sample_time"}
        text = tomlkit.dumps({**table, "controller": given})
        return CaseText(text, self.folder, f"the case {name!r} of the suite {self.name}").case()


@dataclass(frozen=True, eq=False, kw_only=True)
class Submission:
    """A submission: controllers with fixed settings on one case, or laws that the rule tunes on every case.

    case   the name of the case on which the controllers ``as_set`` take part
    tuned  laws that declare tuned settings
    """

    case: str = ""
    as_set: tuple[Controller, ...] = ()
    tuned: tuple[Controller, ...] = ()

    @classmethod
    def read(cls, given: str, suite: Suite) -> Submission:
        """Read a case file (.toml), a file of laws (.py), or a scheme that an installed package has registered."""
        if given.endswith(".toml"):
            return cls._of_case(given, suite)
        if given.endswith(".py"):
            found = user_controllers.run(given).controllers({})
        else:
            classes = user_controllers.schemes({given}, None)
            if not classes:
                raise InputError(
                    f"--submission must be a case file (.toml), a file of laws (.py) or a scheme registered under the entry "
                    f"point group {user_controllers.ENTRY_POINT_GROUP}, got {given!r}"
                )
            found = tuple(kind() for kind in classes.values())
        if dumb := [one.name for one in found if not isinstance(one, Tunable)]:
            raise InputError(
                f"--submission: {dumb[0]} does not declare tunable settings; submit it in a case file with fixed settings"
            )
        return cls(tuned=tuple(found))

    @classmethod
    def _of_case(cls, given: str, suite: Suite) -> Submission:
        data = CaseText.read(given).data()
        name, controllers = data.pop("name", None), data.pop("controller", None)
        if not isinstance(name, str) or not isinstance(controllers, list) or not controllers:
            raise InputError(f"--submission: {given!r} needs the name of a case of the suite and [[controller]] tables")
        case = suite.case(name, controllers)
        if changed := [key for key, value in data.items() if suite.tables[name].get(key) != value]:
            raise InputError(
                f"--submission: [{changed[0]}] of {given!r} differs from that of the suite's case {name!r}; leave it out"
            )
        for one in case.controllers:
            _require_sample_time(one.name, case, one, suite.sample_time(name))
        return cls(case=name, as_set=case.controllers)


def _require_sample_time(entry: str, case: Case, one: Controller, held: float) -> None:
    """Raise InputError for a controller that does not run at the common sample time of this case of the suite."""
    equations = bound(case.problem, one)
    own = equations.sample_time if isinstance(equations, SampledEquations) else None
    if own != held:
        runs = "is continuous" if own is None else f"runs every {own:g} s"
        raise InputError(
            f"--submission: {entry} {runs}, but on the suite's case {case.name!r} all controllers have sample_time = {held:g}"
        )


def row_of(found: Design, one: Candidate, name: str, settings: str) -> Row:
    """Return the row of an entry on one case. None of its numbers depends on other entries."""
    held = found.contest.held_out.get(one.name)
    measured = None if held is None else held.as_json()
    return {
        "case": name,
        "entry": one.name,
        "settings": settings,
        "tuning": dict(one.tuned.tuning),
        "at_edge": list(one.tuned.at_edge),
        "meets_rule": one.tuned.meets,
        "meets_specification": one.meets,
        "fails_first": one.tightest,
        "delay_margin_measured": one.tuned.delay_margin_measured,
        "gain_margin_measured": one.tuned.gain_margin_measured,
        "runs": None if held is None else len(held.lost),
        "failed": None if held is None else int(held.lost.sum()),
        "median_error": None if held is None else finite(held.quantiles["median"]),
        "sha256": sha256(json.dumps([one.as_json(), measured], sort_keys=True, default=float)),
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class Standings:
    """The table: newly measured rows, in the order of each case's contest, and the stored rows of the public suite.

    left_out  sentences on entries that do not take part, by case
    stored    the stored table; without rows if the suite is not the public one
    """

    suite: Suite
    rows: tuple[Row, ...]
    left_out: Mapping[str, tuple[str, ...]]
    stored: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def compared(self) -> dict[str, list[str]]:
        """The measured rows that are also stored, by whether they agree. Bit-identical rows are also listed separately.

        Rows agree if their choices and counts are equal and their numbers agree to ``SAME_DIGITS``.
        """
        known = {_place(row): row for row in self.stored.get("rows", ())}
        found: dict[str, list[str]] = {"agree": [], "differ": [], "in_every_bit": []}
        for row in self.rows:
            if (other := known.get(_place(row))) is not None:
                measured, name = json.loads(json.dumps(row, default=float)), f"{row['entry']} on {row['case']}"
                found["agree" if _agree(measured, {**other, "sha256": measured["sha256"]}) else "differ"].append(name)
                if measured == other:
                    found["in_every_bit"].append(name)
        return found

    @property
    def stored_only(self) -> list[Row]:
        """The stored rows, for the measured cases, that were not measured in this call."""
        cases, measured = {row["case"] for row in self.rows}, {_place(row) for row in self.rows}
        return [row for row in self.stored.get("rows", ()) if row["case"] in cases and _place(row) not in measured]

    @property
    def empty(self) -> list[str]:
        """The cases without any entry."""
        return [name for name in self.left_out if name not in {row["case"] for row in self.rows}]

    def as_json(self) -> dict[str, Any]:
        """Return the document of ``contest --suite --json``."""
        known = {key: self.stored[key] for key in ("date", "commit") if key in self.stored}
        return {
            "suite": {"name": self.suite.name, "sha256": self.suite.sha256, "public": self.suite.is_public},
            "rule": dict(self.suite.rule), "rows": list(self.rows), "left_out": {k: list(v) for k, v in self.left_out.items()},
            "versions": {name: version(name) for name in TABLE_PACKAGES},
            "stored": {**known, **self.compared, "beside": self.stored_only},
        }  # fmt: skip


def _place(row: Mapping[str, Any]) -> tuple[str, str, str]:
    return str(row["case"]), str(row["entry"]), str(row["settings"])


def _agree(a: Any, b: Any) -> bool:
    """Return whether two parts of rows are equal; fractional numbers are compared to SAME_DIGITS."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_agree(value, b[key]) for key, value in a.items())
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=SAME_DIGITS, abs_tol=0.0)
    return bool(a == b)


def stored_table() -> dict[str, Any]:
    """Return the public suite's table, which is part of the package."""
    found: dict[str, Any] = json.loads((resources.files("barbalat.comparison.suite") / "table.json").read_text("utf-8"))
    return found


def standings(
    suite: Suite | None = None,
    *,
    submissions: Iterable[Submission] = (),
    schemes: Sequence[str] = (),
    quick: bool = False,
    threads: int | None = None,
    processes: int = 1,
    progress: Progress | None = None,
) -> Standings:
    """Measure the registered schemes, or submissions, on the cases of a suite by its rule.

    schemes    names of registered schemes; all by default, or none if there are submissions, which are then compared with stored
               rows
    quick      whether to measure only the suite's quick cases
    processes  number of cases that are measured at once, each in its own process, if there are no submissions. New processes
               import the program, so it must start its work below ``if __name__ == "__main__"``
    Raises InputError.
    """
    suite, given = suite or Suite.read(), list(submissions)
    validate.instance("suite", suite, Suite)
    ours = bool(schemes) or not given
    names = [name for name in suite.tables if not quick or name in suite.quick]
    if not ours and not any(one.tuned for one in given):
        names = [name for name in names if name in {one.case for one in given}]
    if not names:
        raise InputError("none of the submissions is for a case of --quick: " + ", ".join(suite.quick))
    if min(processes, len(names)) > 1 and not given:
        parts = _side_by_side(suite, names, schemes, min(processes, len(names)), progress)
    else:
        parts = [
            _on_case(suite, name, given, ours, schemes, threads, part_of(progress, i / len(names), 1 / len(names)))
            for i, name in enumerate(names)
        ]
    rows = tuple(row for found, _ in parts for row in found)
    left_out = {name: said for name, (_, said) in zip(names, parts, strict=True)}
    if not rows:
        raise InputError("nobody takes part", *(f"on {name}: {'; '.join(said)}" for name, said in left_out.items()))
    stored = stored_table() if suite.is_public else {}
    return Standings(suite=suite, rows=rows, left_out=left_out, stored=stored)


Part = tuple[list[Row], tuple[str, ...]]
"""The rows of a case, and the entries that are omitted."""


def _on_case(
    suite: Suite,
    name: str,
    given: Sequence[Submission],
    ours: bool,
    schemes: Sequence[str],
    threads: int | None,
    progress: Progress | None = None,
) -> Part:
    as_set, case = [one for each in given if each.case == name for one in each.as_set], suite.case(name)
    try:
        found = design(
            case, own=[one for each in given for one in each.tuned], as_set=as_set, ours=ours, schemes=schemes, baseline=False,
            validated=False, threads=threads, progress=progress, **suite.rule,
        )  # fmt: skip
    except NobodyTakesPart as nobody:
        return [], nobody.left_out
    set_by = {one.name: AS_SUBMITTED for one in as_set}
    if ours:
        registered, _ = entrants_of(found.contest.problem, case.simulation, schemes=schemes, sample_time=found.sample_time)
        set_by |= {one.name: BY_THE_RULE for one in registered}
    for one in found.candidates:
        if one.name not in set_by:
            _require_sample_time(one.name, case, one.tuned.controller, suite.sample_time(name))
    return [row_of(found, one, name, set_by.get(one.name, SUBMITTED_LAW)) for one in found.candidates], found.contest.left_out


def _side_by_side(
    suite: Suite, names: Sequence[str], schemes: Sequence[str], count: int, progress: Progress | None
) -> list[Part]:
    """Measure the registered schemes on each case; ``count`` cases run in parallel."""
    with own_processes(count) as pool:
        with deaf_children():
            parts = [pool.submit(_on_case, suite, name, (), True, schemes, 1) for name in names]
        for done, _ in enumerate(as_completed(parts), 1):
            if progress is not None:
                progress(done / len(names))
        return [part.result() for part in parts]
