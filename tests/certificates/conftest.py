"""Fixtures of the certificates' tests."""

from __future__ import annotations

import pytest

from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.step_limits import any_regressor


@pytest.fixture
def no_searches(monkeypatch):
    """Searches over the known set and for the largest gain take most of a certificate's time, and no bound comes of them."""
    for name in ("add_at_rest", "add_filtered", "add_fixed"):
        monkeypatch.setattr(over_known_set, name, lambda *_: None)
    monkeypatch.setattr(any_regressor, "of_lyapunov_law", lambda *_, **__: {})
