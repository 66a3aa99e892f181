"""Generates the tables of keys in docs/cases.md from the registries and the docstrings of settings.

``python -m barbalat.cases.key_tables docs/cases.md`` rewrites the tables between the marks of the page.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from barbalat.adaptation.law import AdaptiveLaw, Normalization, OutputErrorLaw
from barbalat.adaptation.laws import LAWS, OUTPUT_LAWS
from barbalat.adaptation.learning import CompositeLearning
from barbalat.cases.keys import REQUIRED, Key, summary
from barbalat.cases.problem_keys import STATES
from barbalat.cases.schema import NAMES_OF_TYPE, case_table, members_of, table_of
from barbalat.cases.scheme_keys import SAMPLING, LowPass, sampling_of
from barbalat.controllers import SCHEMES
from barbalat.controllers.output import OUTPUT_SCHEMES
from barbalat.controllers.piecewise_predictor import AsFlown
from barbalat.controllers.settings import PLANT_FEATURES, beyond_of
from barbalat.controllers.windup import ModifiedError
from barbalat.linear.systems import TransferFunction
from barbalat.problem.baseline import BASELINES, Baseline
from barbalat.problem.faults import FAULTS, Fault
from barbalat.problem.observer import OBSERVERS, Observer
from barbalat.problem.output_feedback import OutputProblem
from barbalat.problem.regressors import REGRESSORS, Regressor
from barbalat.problem.state_feedback import Problem
from barbalat.protocols import Signal
from barbalat.signals import SIGNALS
from barbalat.targets import IN_PAGES, TARGETS, in_pages, is_tunable
from barbalat.validate import Array, Matrix, Vector

WORDS: dict[Any, str] = {
    float: "number",
    int: "integer",
    bool: "true or false",
    str: "string",
    Vector: "list",
    Matrix: "matrix",
    Array: "list or matrix",
    TransferFunction: "{ num, den }",
    Signal: "signal",
    Fault: "fault",
    Baseline: "baseline",
    Observer: "observer",
    Regressor: "regressor",
    AdaptiveLaw: "law",
    OutputErrorLaw: "law",
}
"""The names under which docs/cases.md shows the types of fields; a setting of any other type is a TOML table."""

PARTS = {
    "filter": LowPass,
    "as_flown": AsFlown,
    "learning": CompositeLearning,
    "normalization": Normalization,
    "modified_error": ModifiedError,
}
"""The tables within a controller's table that are not laws."""


def tables() -> dict[str, str]:
    """The page's tables in Markdown, by the names of their marks."""
    parts = [row for name, settings in PARTS.items() for row in _rows(table_of(settings).recipe.keys, f"{name}.")]
    only_output = {name: law for name, law in OUTPUT_LAWS.items() if name not in LAWS}
    return {
        "problem": _markdown("key", "type", "default", "meaning", rows=_rows(case_table(Problem).recipe.keys)),
        "regressors": _registry(REGRESSORS, "kind"),
        "signals": _registry(SIGNALS, "kind"),
        "faults": _registry(FAULTS, "kind"),
        "baselines": _registry(BASELINES, "kind"),
        "observers": _registry(OBSERVERS, "kind"),
        "schemes": _registry(SCHEMES, "scheme"),
        "parts": _markdown("key", "type", "default", "meaning", rows=parts),
        "laws": _registry(LAWS, "kind"),
        "output problem": _markdown("key", "type", "default", "meaning", rows=_rows(case_table(OutputProblem).recipe.keys)),
        "output schemes": _registry(OUTPUT_SCHEMES, "scheme"),
        "output laws": _registry(only_output, "kind"),
        "plants of schemes": _plants_of_schemes(),
        "signals of pages": _signals_of_pages(),
        "targets": _targets(),
    }


def page(text: str) -> str:
    """The page with its tables updated."""
    for name, table in tables().items():
        before, mark, rest = text.partition(f"<!-- keys: {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not end:
            raise ValueError(
                f"the page has no place for the keys of {name}: it needs a line <!-- keys: {name} --> and, below it, <!-- end -->"
            )
        text = before + mark + table + end + after
    return text


def _rows(keys: Mapping[str, Key], prefix: str = "") -> list[tuple[str, ...]]:
    """A row for each key. If an inner table can occur under one key only, its keys replace the row of that key."""
    rows: list[tuple[str, ...]] = []
    for name, key in keys.items():
        first = members_of(key.type)[0]
        if isinstance(first, type) and is_dataclass(first) and first not in WORDS and first not in NAMES_OF_TYPE:
            rows += _rows(table_of(first).recipe.keys, f"{prefix}{name}.")
        else:
            rows.append((f"`{prefix}{name}`", *_described(key)))
    return rows


def _registry(registry: Mapping[str, type], choice: str) -> str:
    """The meaning of each name, and a row for each of its keys; keys that all names have in common come last."""
    keys = {name: table_of(settings, choice, name).recipe.keys for name, settings in registry.items()}
    first = next(iter(keys.values()))
    at_samples = [name for name, one in keys.items() if choice == "scheme" and not sampling_of(one)]
    common: dict[str, Key] = {}
    besides: dict[str, list[str]] = {}
    for key, given in first.items():
        others = [name for name, one in keys.items() if key not in one or one[key][:2] != given[:2]]
        if len(registry) > 1 and (not others or (key in SAMPLING and others == at_samples)):
            common[key], besides[key] = given, others
    rows: list[tuple[str, ...]] = []
    for name, settings in registry.items():
        rows.append((f"`{name}`", "", "", "", _cell(summary(settings))))
        own = {key: given for key, given in keys[name].items() if key not in common or name in besides[key]}
        rows += [("", f"`{key}`", *_described(given)) for key, given in own.items()]
    for key, given in common.items():
        differs = any(one[key].default != given.default for name, one in keys.items() if name not in besides[key])
        which = " but ".join(["all", *(f"`{name}`" for name in besides[key])])
        rows.append((which, f"`{key}`", *_described(given._replace(default=None) if differs else given)))
    return _markdown(choice, "key", "type", "default", "meaning", rows=rows)


def _plants_of_schemes() -> str:
    """Return, by scheme, which plants it supports and whether it declares its tuned settings."""
    rows = [
        (f"`{name}`", *(_mark(feature not in beyond_of(scheme)) for feature in PLANT_FEATURES), _mark(is_tunable(scheme)))
        for name, scheme in SCHEMES.items()
    ]
    none = ("-",) * len(PLANT_FEATURES)
    rows += [(f"`{name}`, of the output", *none, _mark(is_tunable(scheme))) for name, scheme in OUTPUT_SCHEMES.items()]
    return _markdown("scheme", *PLANT_FEATURES, "says what is tuned", rows=rows)


def _signals_of_pages() -> str:
    rows = []
    for name, kind in SIGNALS.items():
        breaks = hasattr(getattr(kind, "makes", kind), "breaks")
        rows.append((f"`{name}`", IN_PAGES[in_pages(kind)], _mark(breaks)))
    return _markdown("kind", "in a page of `explore`", "jumps or corners", rows=rows)


def _targets() -> str:
    rows = []
    for target in TARGETS:
        controllers = ["act at samples"] * target.sampled + ["declare what is tuned"] * target.tunable
        rows.append((f"`{target.command}`", ", ".join(need.words for need in target.problem), ", ".join(controllers)))
    return _markdown("command", "requirements on the problem", "requirements on controllers", rows=rows)


def _mark(taken: bool) -> str:
    return "yes" if taken else "no"


def _described(key: Key) -> tuple[str, str, str]:
    default = "required" if key.default is REQUIRED else "" if key.default in (None, ()) else _plain(key.default)
    return words(key.type), default, _cell(key.meaning)


def _plain(default: object) -> str:
    """A default as TOML writes it."""
    names = {id(value): name for named in NAMES_OF_TYPE.values() for name, value in named.items()}
    if id(default) in names:
        return names[id(default)]
    return str(default).lower() if isinstance(default, bool) else str(default)


def words(hint: Any) -> str:
    """The words for a key's values."""
    found = list(dict.fromkeys(word for one in members_of(hint) for word in _word(one).split(" or ")))
    return " or ".join([*[", ".join(found[:-1])] * (len(found) > 1), found[-1]])


def _word(hint: Any) -> str:
    if hint in WORDS:
        return WORDS[hint]
    if hint in NAMES_OF_TYPE:
        return " or ".join(NAMES_OF_TYPE[hint])
    if get_origin(hint) is Literal:
        return " or ".join(f"`{name}`" for name in get_args(hint))
    if hint is STATES:
        return "list or matrix"
    if get_origin(hint) is Annotated:
        return _word(get_args(hint)[0])
    if get_origin(hint) is tuple:
        item = get_args(hint)[0]
        return f"list of {words(item)}s" if item in WORDS or is_dataclass(item) else "list"
    return "table"


def _cell(text: str) -> str:
    text = re.sub(r"\(?docs/([\w-]+\.md)\)?", r"([\1](\1))", " ".join(text.split()).replace("``", "`"))
    return text.replace("|", r"\|").replace("*", r"\*")


def _markdown(*head: str, rows: Sequence[tuple[str, ...]]) -> str:
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, ("---",) * len(head), *rows))


if __name__ == "__main__":
    file = Path(sys.argv[1])
    file.write_text(page(file.read_text(encoding="utf-8")), encoding="utf-8")
