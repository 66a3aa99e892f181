"""A sweep of a case with faults states the fault patterns to which its fractions apply."""

from __future__ import annotations

import pytest

from barbalat.studies import sweep
from barbalat.sweeps.sweep import SAME_FAULTS

CASE = """
name = "lossy"
plant = { A_m = [[-2.0]], b = [1.0], theta = [1.0] }
reference_model = { k_0 = 2.0 }
reference = { kind = "square", amplitude = 1.0, frequency = 1.0 }
uncertainty = { lower = [0.0], upper = [2.0] }
simulation = { t_end = 4.0, dt = 0.01 }
controller = [{ scheme = "mrac", gamma = 5.0, sample_time = 0.05 }]
"""
FAULTS = 'faults = [{ kind = "dropout", share = 0.2 }]\n'


@pytest.mark.parametrize(
    ("text", "varied", "said"),
    [
        (FAULTS + CASE, {"sample": {"plant.theta[0]": "uniform:0:2"}, "members": 8}, True),
        (FAULTS + CASE, {"vary": {"faults[0].seed": "0:7:8"}}, False),
        (CASE, {"sample": {"plant.theta[0]": "uniform:0:2"}, "members": 8}, False),
    ],
)
def test_one_pattern_of_faults_is_told(tmp_path, text, varied, said):
    file = tmp_path / "case.toml"
    file.write_text(text)
    found = sweep(str(file), audit=0, **varied)
    assert (SAME_FAULTS in found.evidence.notes) is said
