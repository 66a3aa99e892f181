"""False conclusions for ``barbalat-check``: a number, a witness or a premise is changed so that a line no longer follows."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

Document = dict[str, Any]
TIGHTER = 1 - 1e-7
"""Relative change of a bound. Certified bounds exceed the exact ones by the widths of their norms, at most 1e-9, and by
roundings."""
LOOSE = frozenset({"lambda_min", "kappa_admissible", "condition", "norms"})
SAMPLED = frozenset({"error_bound_held", "state_bound"})
"""Keys whose numbers have a reserve or come from a search. They are attacked with a different factor or in a different way."""


def attacks(document: Document) -> Iterator[tuple[str, Document]]:
    """Each change with the changed document, which now proves something false or nothing."""
    for name, controller in document["controllers"].items():
        for i, line in enumerate(controller["lines"]):
            for what, changed in (*_tightened(line), *_broken_witnesses(line)):
                yield f"{name}, {line['key']}: {what}", _with_line(document, name, i, changed)
            if not line["claimed"]:
                yield f"{name}, {line.get('of', line['key'])}: left out", _with_line(document, name, i, None)
        if any(line["key"] in ("error_bound", "reference_error_bound") for line in controller["lines"]):
            for what, plant in _broken_premises(document["plant"], controller["facts"]):
                yield f"{name}: {what}", document | {"plant": plant}


def _with_line(document: Document, name: str, i: int, line: Document | None) -> Document:
    found = copy.deepcopy(document)
    found["controllers"][name]["lines"][i : i + 1] = [] if line is None else [line]
    return found


def _tightened(line: Document) -> Iterator[tuple[str, Document]]:
    key, value = line["key"], line.get("value")
    if key in ("lyapunov", "L1 norm") or not line["claimed"]:
        return
    if key == "norms":
        for norm, ends in value.items():
            for end, factor in (("upper", 1 - 1e-6), ("lower", 1 + 1e-6)):
                if ends[end]:
                    yield f"{norm}'s {end} end", line | {"value": value | {norm: ends | {end: ends[end] * factor}}}
    elif key == "bounds":
        for signal in value:
            if value[signal]:
                yield f"sup |{signal}|", line | {"value": value | {signal: value[signal] * (1 - 1e-6)}}
    elif key == "condition":
        lowered = value["value_upper"] * (1 - 1e-6) if value["value_upper"] else -1.0
        yield "value", line | {"value": value | {"value_upper": lowered}}
        yield "verdict", line | {"value": value | {"holds": not value["holds"]}}
    elif key in ("lambda_min", "kappa_max"):
        yield "raised", line | {"value": value * (1 + 1e-6)}
    elif key == "kappa_admissible":
        yield "raised", line | {"value": value * 1.01}
    elif value:
        factor = (
            0.998 if key in SAMPLED else 1 - 1e-6 if key in LOOSE else TIGHTER
        )  # the bound of a sum's tail is within a thousandth
        yield "lowered", line | {"value": value * factor}


def _broken_witnesses(line: Document) -> Iterator[tuple[str, Document]]:
    if "cells" in line.get("witness", {}):
        for what, cells in _broken_cells(line["witness"]["cells"]):
            yield what, line | {"witness": line["witness"] | {"cells": cells}}
    if line["key"] != "L1 norm":
        return
    witness = line["witness"]

    def with_witness(**changes: Any) -> Document:
        return line | {"witness": witness | changes}

    n = len(witness["P"])
    yield "a form that is not definite", with_witness(P=[["-1p0" if i == j else "0p0" for j in range(n)] for i in range(n)])
    yield "a form that is too small", with_witness(P=[[_shrunk(entry) for entry in row] for row in witness["P"]])
    yield "too fast a rate", with_witness(rate=_times_16(witness["rate"]))
    yield "no rate", with_witness(rate="0p0")
    yield "a step backwards", with_witness(steps=[[*steps, "-1p-4"] for steps in witness["steps"]])
    yield "no steps for an input", with_witness(steps=witness["steps"][1:])
    if n > 1:
        yield (
            "a form that is not symmetric",
            with_witness(P=[["1p9", *witness["P"][0][1:]], ["1p8", *witness["P"][1][1:]], *witness["P"][2:]]),
        )


def _broken_cells(tree: Document) -> Iterator[tuple[str, Document]]:
    """Changes of the first cell, and of the cuts that lead to it."""
    if "side" in tree:
        yield "a cut outside the set", tree | {"at": tree["at"] + 1e6}
        yield "one half left out", {key: part for key, part in tree.items() if key != "high"}
        yield "one half for the whole", tree["low"]
        yield from ((what, tree | {"low": low}) for what, low in _broken_cells(tree["low"]))
        return
    if "forced" in tree:
        yield "no norm of the cell's loop", {key: part for key, part in tree.items() if key != "loop"}
        yield "the witness of another norm", tree | {"forced": tree["loop"]}
        yield "no steps", tree | {"forced": tree["forced"] | {"steps": [[]]}}
        yield "no rate", tree | {"loop": tree["loop"] | {"rate": "0p0"}}
        return
    steps = tree["steps"]
    yield "a step backwards", tree | {"steps": [[*steps[0], -0.25], *steps[1:]]}
    yield "steps beyond the end", tree | {"steps": [*steps[:-1], [*steps[-1], 1e6]]}
    yield "a piece of the command left out", tree | {"steps": steps[1:]}
    yield "one long step", tree | {"steps": [[], *steps[1:]]}
    yield "weights that are not positive", tree | {"weights": [0.0, *tree["weights"][1:]]}
    yield "too few digits", tree | {"bits": 8}


def _shrunk(entry: str) -> str:
    mantissa, exponent = entry.split("p")
    return f"{mantissa}p{int(exponent) - 20}"


def _times_16(entry: str) -> str:
    mantissa, exponent = entry.split("p")
    return f"{mantissa}p{int(exponent) + 4}"


def _broken_premises(plant: Document, facts: Document) -> Iterator[tuple[str, Document]]:
    """What the theorems rest on."""

    def on_the_way(**changes: Any) -> Document:
        return plant | {"inputs": [plant["inputs"][0] | changes, *plant["inputs"][1:]]}

    yield "a delay", on_the_way(delay=0.01)
    yield "a limit", on_the_way(saturation="[-1, 1]")
    yield "noise", plant | {"noise": "Noise"}
    if plant.get("kind") == "output":
        yield "a command without a bound", plant | {"reference": {"kind": "unbounded"}}
        return
    yield "an actuator", on_the_way(actuator="1/(s + 1)")
    yield "a disturbance", plant | {"disturbance": {"kind": "unbounded", "name": "Step"}}
    yield (
        "an unmatched disturbance",
        plant | {"unmatched": [{"direction": [1.0] * len(plant["A_m"]), "signal": {"kind": "unbounded", "name": "Step"}}]},
    )
    yield "a sensor", plant | {"sensor": "Sensor"}
    yield "a command without a bound", plant | {"reference": [{"kind": "unbounded"} for _ in plant["reference"]]}
    yield "another model", plant | {"A_m": [[-value for value in row] for row in plant["A_m"]]}
    fixed, known_set = plant["baseline"], plant["uncertainty"]
    if fixed is not None and facts["scheme"] in ("l1", "linear", "baseline"):
        yield (
            "commands that enter elsewhere",
            plant | {"baseline": fixed | {"enters": [[9.0] * len(row) for row in fixed["enters"]]}},
        )
    if fixed is not None and facts["scheme"] == "l1":
        yield "another baseline", plant | {"baseline": fixed | {"theta_0": [one + 1.0 for one in fixed["theta_0"]]}}
        yield "no baseline", plant | {"baseline": None}
    if known_set is not None and (facts.get("projection") or facts["scheme"] in ("linear", "baseline", "adrc")):
        beyond = 1.0 + (max(known_set["upper"]) if "upper" in known_set else max(known_set["center"]) + known_set["radius"])
        yield "theta outside the known set", plant | {"theta": [beyond] * len(plant["theta"])}
