"""Explorers of a sweep's worst members: they simulate the member named in the evidence or state why this is impossible."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from barbalat import simulate
from barbalat.cases.load import CaseText, parse_case
from barbalat.explorer.worst_members import explored
from barbalat.studies import sweep

CASE = """
name = "Two tanks"
[plant]
A_m = [[-2.0]]
b = [1.0]
theta = [1.0]
x0 = [0.5]
[reference_model]
k_0 = 1.0
[reference]
kind = "step"
amplitude = 1.0
[uncertainty]
lower = [-4.0]
upper = [4.0]
[simulation]
t_end = 1.0
dt = 1e-2
[[controller]]
name = "slow"
scheme = "mrac"
gamma = 1.0
[[controller]]
name = "fast & new"
scheme = "mrac"
gamma = 20.0
"""
NOISE = "[sensor]\nnoise = { std = 0.01, sample_time = 0.1 }\n[simulation]"
DIVERGING = CASE.replace("gamma = 20.0", "gamma = 1e8\nprojection = false")


def studied(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text)
    found = sweep(path, sample={"plant.theta[0]": "uniform:-4:4", "plant.x0[0]": "uniform:0:3"}, members=32, bounds=False)
    return found, {one.row.controller: one for one in explored(CaseText.read(path), found)}


def test_the_page_simulates_the_member_that_has_the_largest_error(tmp_path):
    found, pages = studied(tmp_path, CASE)
    assert [one.row.file for one in pages.values()] == ["explore-1-slow.html", "explore-2-fast-new.html"]
    for name, one in pages.items():
        errors = found.column(f"{name}/max_abs_e[0]")
        assert one.row.member == int(errors.argmax()) and one.row.figure == "max_abs_e[0]"
        data = json.loads(re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', one.page, re.DOTALL)[1])
        file = "".join(part if isinstance(part, str) else _filled(part, data) for part in data["case_file"])
        case = parse_case(file)
        assert case.name == f"Two tanks, member {one.row.member}" and [c.name for c in case.controllers] == [name]
        again = simulate(case.problem, case.controllers, case.simulation)[name].metrics.max_abs_e[0, 0]
        assert again == pytest.approx(errors.max(), rel=1e-10)  # only the rounding of fused multiply-adds differs


def _filled(part, data):
    """The contents of the page before a slider is moved."""
    simulation = data["simulation"]
    if "number" in part:
        values = [*(one["value"] for one in data["numbers"]), simulation["t_end"], simulation["dt"]]
        return repr(values[part["number"]])
    return "true" if "projection" in part else json.dumps(simulation["solver"])


@pytest.mark.full
def test_the_first_to_diverge_comes_before_the_largest_error(tmp_path):
    found, pages = studied(tmp_path, DIVERGING)
    at = found.column("fast & new/diverged_at")
    assert pages["fast & new"].row.figure == "diverged_at" and at[pages["fast & new"].row.member] == np.nanmin(at)
    assert pages["slow"].row.figure == "max_abs_e[0]"


def test_a_member_with_noise_of_its_own_has_no_page_and_says_so(tmp_path):
    _, pages = studied(tmp_path, CASE.replace("[simulation]", NOISE))
    assert [(one.page, one.row.file) for one in pages.values()] == [(None, None)] * 2
    assert all("measurement noise" in one.row.why for one in pages.values())
