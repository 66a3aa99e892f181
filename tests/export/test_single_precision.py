"""The gain at which a float32 export differs from the simulation, compared with runs at gains on both sides."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from barbalat import KnownParameters, Mrac, Sampled, Simulation, simulate
from barbalat.cli import main
from barbalat.export.single_precision import VISIBLE_SHARE, precision_limit
from barbalat.exports import simulate_export
from export.examples import STATE, T
from export.targets import needs_gcc
from independent import refusal

SHORT = Simulation(t_end=5.0, dt=T / 2)


def mrac(gamma: float, discretization: str) -> Sampled:
    return Sampled(controller=Mrac(gamma=gamma), sample_time=T, discretization=discretization)


def difference(gamma: float) -> float:
    controller = mrac(gamma, "euler")
    ours = simulate(STATE, [controller], SHORT)["MRAC"].x
    return float(np.abs(simulate_export(STATE, controller, SHORT, float32=True).result.x - ours).max() / np.abs(ours).max())


@needs_gcc
@pytest.mark.full
def test_euler_steps_part_at_a_gain() -> None:
    """Runs on both sides confirm it. From a gain at which they differ, the search continues downwards."""
    found = precision_limit(STATE, mrac(5.0, "euler"), SHORT)
    assert found.setting == "gamma" and found.at is not None
    below = max(gain for gain in found.apart if gain < found.at)
    assert found.at < 1.34 * below
    assert difference(found.at) > VISIBLE_SHARE > difference(below)
    assert found.apart[5.0] == pytest.approx(difference(5.0)) and found.apart[5.0] < 1e-5
    again = precision_limit(STATE, mrac(found.at, "euler"), SHORT)  # from there the search continues downwards
    assert again.at is not None and found.at / 3 < again.at <= found.at  # rounding errors are not a smooth function of the gain


@needs_gcc
@pytest.mark.full
def test_midpoint_steps_bear_the_gains_that_32_bits_have() -> None:
    found = precision_limit(STATE, mrac(5.0, "midpoint"), SHORT)
    assert found.at is None and max(found.apart) == pytest.approx(5e8)
    assert "they differ by at most 0.01 of the largest |x|" in found.sentence


def test_refusals(capsys) -> None:
    known = Sampled(controller=KnownParameters(theta=[1.0, -0.5]), sample_time=T, discretization="euler")
    assert "has no scalar gain" in refusal(lambda: precision_limit(replace(STATE), known, SHORT))
    assert main(["certify", "first-order", "--float32"]) == 2
    assert "--simulate" in capsys.readouterr().err


CASE = """
name = "one"
[plant]
A_m = [[-1.0]]
b = [1.0]
theta = [0.5]
[reference_model]
k_0 = 1.0
[reference]
kind = "square"
amplitude = 1.0
frequency = 1.0
[uncertainty]
lower = [-2.0]
upper = [2.0]
[simulation]
t_end = 2.0
dt = 0.01
[[controller]]
name = "M"
scheme = "mrac"
gamma = 10.0
sample_time = 0.02
discretization = "euler"
"""


@needs_gcc
@pytest.mark.full
def test_certify_shows_it(tmp_path, capsys) -> None:
    (tmp_path / "case.toml").write_text(CASE)
    assert main(["certify", str(tmp_path / "case.toml"), "--simulate", "--float32", "--json"]) == 0
    shown = capsys.readouterr().out
    assert "comparing the compiled 32-bit export with the 64-bit simulation" in shown and "gamma = 10 they differ by" in shown
    certificate = json.loads(shown)["controllers"]["M"]
    found = [one for one in certificate["entries"] if one["key"] == "gamma_float32"]
    assert all(one["kind"] == "estimate" and one["value"] > 10.0 for one in found)
