"""The report of a tuning on validation plants."""

import pytest

from barbalat.report.tuning import _broken
from barbalat.sweeps.statistics import Share


@pytest.mark.parametrize(("count", "most"), [(0, 100 * (1 - 0.025 ** (1 / 32))), (32, 100)])
def test_a_count_says_what_it_is_evidence_for(count, most):
    # Clopper and Pearson's limits if none or all of n fail: 1 - (alpha/2)^(1/n), and its mirror image
    least = 100 - 100 * (1 - 0.025 ** (1 / 32)) if count else 0
    said = _broken(Share(count=count, judged=32), "max_abs_u < 9")
    assert said == f"{count} of 32 violate max_abs_u < 9 ({least:.2g} to {most:.2g} % of all, with 95 % confidence)"
