"""Writes an identification as a case file with a plant in physical parameters, as a starting point for the user."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping

import numpy as np
from scipy.linalg import qr

from barbalat.identify.result import CONFIDENCE, Identification
from barbalat.linear.pole_placement import place
from barbalat.validate import Array, InputError

SPREAD = 0.25
"""Distance between neighbouring poles of the model in the file, as a fraction of the fastest pole of the plant."""
SHARE_OF_DELAY = 0.5
"""Largest product of a model pole in the file and the dead time."""
PERIODS, STEPS = 4.0, 100.0
"""Periods of the command in the file, and solver steps per fastest time constant."""
AT_REST = 1e-6
"""Fraction of the model's largest steady-state gain below which a state counts as unaffected."""


def case_text(found: Identification, source: str) -> str:
    """A whole case file. The ranges are those of the known set or, without a noise bound, the confidence intervals.

    Raises InputError if a range is unbounded, and if no poles can be placed.
    """
    names = found.recording.output_names
    n, m = len(names), len(found.recording.input_names)
    ranges = np.array([row.ranges for row in found.rows])[:, : n + m]
    if not np.isfinite(ranges).all():
        i, j = np.argwhere(~np.isfinite(ranges).all(axis=2))[0]
        raise InputError(
            f"no case file can be written: the data give no bound on the coefficient of {found.coefficient_names[j]} in the "
            f"equation of {names[i]}'; excite it, or give its bounds by within "
            f"({names[i]}.{found.coefficient_names[j]}=LOWER:UPPER)"
        )
    parameters, entries = _parameters(found, ranges)
    model, A_m = _model(found)
    followed = _followed(A_m, found.B)
    speed = float(np.abs(np.linalg.eigvals(A_m)).max())
    slow = float(np.abs(np.linalg.eigvals(A_m)).min())
    amplitude = float(f"{np.ptp(found.recording.outputs[:, followed]) / 4 or 1.0:.2g}")
    A = "\n".join(f"  [{', '.join(row[:n])}]," for row in entries)
    columns = [f"[{', '.join(row[n:])}]" for row in entries]
    single = found.B.shape[1] == 1
    b = ", ".join(column.strip("[]") if single else column for column in columns)
    asked = (
        f"follow = {json.dumps(_label(names[followed]))}" if single else _gains(A_m, found.B, [_label(name) for name in names])
    )
    labels = json.dumps([_label(name) for name in names])
    command = f'kind = "square"\namplitude = {amplitude}\nfrequency = {float(f"{slow / 3:.2g}")}\n'
    commands = f"[reference]\n{command}" if single else "\n".join([f"[[reference]]\n{command}"] * m)
    dt = float(f"{1 / (STEPS * speed):.1g}")
    steps = math.ceil(PERIODS * 6 * math.pi / slow / dt)
    return f"""{_heading(found, source)}
[parameters]
{parameters}
[plant]
A = [
{A}
]
b = [{b}]
{f"input = {{ delay = {found.delay!r} }}" if found.delay else ""}
[labels]
names = {labels}

# The rest of the file is a starting point for your changes: model, command, controllers.
[reference_model]
poles = {json.dumps(model)}
{asked}

{commands}
[simulation]
t_end = {float(f"{steps * dt:.12g}")}
dt = {dt}

[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = {_adaptation_gain(found, A_m, followed, amplitude):.2g}
"""


def _heading(found: Identification, source: str) -> str:
    """The name, and comments on the ranges, their assumptions and the limitations of the data."""
    every, intervals = "these ranges contain every plant that explains the data", f"{100 * CONFIDENCE:.0f} % confidence intervals"
    lines = [f"Identified by `barbalat identify` from {_one_line(source)}: {every if found.guaranteed else intervals}."]
    if found.noise is not None and found.slope is not None:
        lines.append("They depend on these bounds on the measurement error and on the rate of change:")
        lines += [f"  {_one_line(name)}: {found.noise[name]!r} and {found.slope[name]!r}" for name in found.noise]
    if found.reference is not None:
        point = found.operating_point
        lines.append(
            "The signals are deviations from an operating point, and the plant has no equilibrium: its drift is left out."
            if point is None
            else f"All signals are deviations from the operating point {_one_line(point_text(point))}."
        )
    lines += found.findings
    return (
        "".join(f"# {_one_line(line) if line[0] != ' ' else line}\n" for line in lines)
        + f"name = {json.dumps(f'Identified from {_one_line(source)}')}\n"
    )


def _parameters(found: Identification, ranges: Array) -> tuple[str, list[list[str]]]:
    """The table of parameters, and the entries of A and B by rows, as a case file writes them."""
    lines: list[str] = []
    entries: list[list[str]] = []
    for i, row in enumerate(found.rows):
        entries.append([])
        for j, value in enumerate(row.nominal[: ranges.shape[1]]):
            low, high = ranges[i, j]
            if low == high:
                entries[-1].append(repr(float(value)))
                continue
            n = len(found.rows)
            name = f"a_{i + 1}_{j + 1}" if j < n else f"b_{i + 1}_{j - n + 1}"
            lines.append(f"{name} = {{ value = {float(value)!r}, between = [{float(low)!r}, {float(high)!r}] }}\n")
            entries[-1].append(json.dumps(name))
    return "".join(lines), entries


def _model(found: Identification) -> tuple[list[float], Array]:
    """Real poles as fast as the fastest pole of the plant, and A_m."""
    fastest = float(np.abs(np.linalg.eigvals(found.A)).max()) or 1.0
    if found.delay:
        fastest = min(fastest, SHARE_OF_DELAY / found.delay)
    poles = [-float(f"{fastest * (1 + SPREAD * k):.3g}") for k in range(len(found.rows))]
    b = found.B[:, 0] if found.B.shape[1] == 1 else found.B
    return poles, place(found.A, b, poles)


def _followed(A_m: Array, B: Array) -> int:
    """The first state on which a constant command has an effect."""
    gains = np.abs(np.linalg.solve(A_m, B)).max(axis=1)
    return int(np.argmax(gains > AT_REST * gains.max()))


def _gains(A_m: Array, B: Array, labels: list[str]) -> str:
    """The states that the commands of several inputs set independently, or gains of 1 if there are too few."""
    _, triangle, order = qr(np.linalg.solve(A_m, B).T, pivoting=True)
    m = B.shape[1]
    size = np.abs(np.diag(triangle))
    if len(labels) < m or size[m - 1] <= AT_REST * size[0]:
        return f"k_0 = {np.eye(m).tolist()}"
    return f"follow = {json.dumps([labels[i] for i in sorted(order[:m].tolist())])}"


def _adaptation_gain(found: Identification, A_m: Array, followed: int, amplitude: float) -> float:
    """The gain for which the oscillation frequency of the estimates, sqrt(gamma b'Pb (|x|^2 + |u|^2)) with the controlled state
    at rest at the command amplitude, equals the fastest pole of the model."""
    from scipy.linalg import solve_continuous_lyapunov

    gain = -np.linalg.solve(A_m, found.B)
    x = gain @ gain[followed] * amplitude / (gain[followed] @ gain[followed])
    u = np.linalg.lstsq(found.B, -found.A @ x, rcond=None)[0]
    bPb = np.linalg.norm(found.B.T @ solve_continuous_lyapunov(A_m.T, -np.eye(len(A_m))) @ found.B, 2)
    return float(np.abs(np.linalg.eigvals(A_m)).max() ** 2 / (bPb * (x @ x + u @ u)))


def _label(name: str) -> str:
    """A name as a label in a case file."""
    return re.sub(r"\W+", "_", name).strip("_") or "x"


def point_text(point: Mapping[str, float]) -> str:
    """An operating point in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in point.items())


def _one_line(text: str) -> str:
    return " ".join(text.split())
