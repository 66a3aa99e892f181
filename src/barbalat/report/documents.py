"""The JSON documents of the commands, as the contract defines them. This module draws nothing."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from barbalat.certificates.certify import Certified
from barbalat.problem.departures import sets_and_truth
from barbalat.run.results.result import Result

if TYPE_CHECKING:  # most documents are not about papers
    from barbalat.papers.claim import Claim
    from barbalat.papers.finding import Finding
    from barbalat.papers.paper import Paper, PaperFigure


def as_json(document: dict[str, Any]) -> str:
    """Return JSON text in which values that are not finite are null."""
    return json.dumps(_finite(document), indent=2, allow_nan=False, ensure_ascii=False)


def _finite(part: Any) -> Any:
    if isinstance(part, dict):
        return {key: _finite(value) for key, value in part.items()}
    if isinstance(part, (list, tuple)):
        return [_finite(value) for value in part]
    return None if isinstance(part, float) and not math.isfinite(part) else part


def coverage(paper: Paper, claims: Sequence[Claim]) -> list[dict[str, Any]]:
    """Return the sentences of the paper, each with the finding of its row, or of the part of the row that the sentence states."""
    from barbalat.papers.finding import Unmeasured

    measured, found = {claim.id: claim for claim in claims}, []
    for one in paper.coverage:
        claim, finding = measured.get(one.row or ""), None
        if claim is not None:
            literal = [reading.finding for reading in claim.readings if reading.literal]
            part = one.part if isinstance(one, Unmeasured) else None
            finding = claim.finding if part is None else literal[part]
        found.append({"sentence": one.quote, "where": one.where, "row": one.row, "finding": finding, "why": one.why})
    return found


def by_side(claims: Sequence[Claim]) -> dict[str, Counter[Finding]]:
    """Return, for each side of the dispute, the findings of its rows, keyed by the beginning of its lines."""
    found: dict[str, Counter[Finding]] = {}
    for claim in claims:
        side = "statements of ours" if claim.ours else claim.sentence.source.side
        found.setdefault(f"{side[0].upper()}{side[1:]}", Counter())[claim.finding] += 1
    return found


def reproduction_document(
    paper: Paper, figures: Sequence[PaperFigure], claims: Sequence[Claim], certified: Certified, seconds: dict[str, float]
) -> dict[str, Any]:
    """The document of ``reproduce --json``."""
    return {
        "figures": {figure.key: figure.as_json() for figure in figures},
        "claims": [claim.as_json() for claim in claims],
        "coverage": coverage(paper, claims),
        "seconds": seconds,
        **certified.as_json(),
    }


def run_document(
    case: str, results: Sequence[Result], certified: Certified | None, in_the_loop: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, Any]:
    """Return the document of ``run --json``.

    Further keys contain the numerics, the certificates if they were computed, the derived known set, the differences between
    truth and design, and the results of ``--sil`` for each controller.
    """
    return {
        "case": case,
        "simulation": results[0].simulation.as_json(),
        "controllers": {r.name: run_block(r) for r in results},
        **sets_and_truth(results[0].problem),
        **({} if certified is None else certified.as_json()),
        **({} if in_the_loop is None else {"software_in_the_loop": in_the_loop}),
    }


def run_block(result: Result) -> dict[str, Any]:
    """The block for a controller in the JSON contract, with the numerics as further keys."""
    found = result.stiffness
    check = None if result.check is None else result.check.as_json()
    lost = {} if result.lost is None else {"lost_order": result.lost.as_json()}
    verdict = result.verdict
    return {
        **result.figures,
        **({} if verdict is None else {"verdict": verdict.as_json()}),
        **({} if verdict is None or verdict.figures is None else verdict.figures.as_json()),
        "h_lambda_max": found.h_lambda_max,
        "numerically_unstable_at": found.unstable_from,
        "label": result.label,
        "finer_step": check,
        **({} if result.accuracy is None else {"accuracy": result.accuracy.as_json()}),
        **({} if result.measured_error is None else {"measured_error": result.measured_error.as_json()}),
        **({} if result.damping is None else {"solver_damping": result.damping.as_json()}),
        **lost,
        **({} if result.half_step is None else {"half_step": result.half_step.as_json()}),
        **({} if result.missed is None else {"missed_samples": result.missed.as_json()}),
        "findings": [finding.sentence for finding in result.findings],
        "adapting": None if result.adapting is None else result.adapting.as_json(),
    }
