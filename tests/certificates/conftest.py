"""Fixtures of the certificates' tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from barbalat import certify, load_case
from barbalat.cases.load import Case
from barbalat.certificates.certificates import Certificates
from barbalat.certificates.linear_loops import over_known_set
from barbalat.certificates.step_limits import any_regressor
from turns import once


@pytest.fixture
def no_searches(monkeypatch):
    """Leave out the searches over the known set and for the largest gain. They need most of a certificate's time, and no bound
    depends on them."""
    for name in ("add_at_rest", "add_filtered", "add_fixed", "add_sampled_at"):
        monkeypatch.setattr(over_known_set, name, lambda *_, **__: None)
    monkeypatch.setattr(any_regressor, "of_lyapunov_law", lambda *_, **__: {})


@pytest.fixture
def certified(shared: Path) -> Callable[[str], tuple[Case, Certificates]]:
    """A bundled case by its name, with its certificates, which are computed only once for all of pytest's processes."""

    def found(name: str) -> tuple[Case, Certificates]:
        case = load_case(name)
        return case, once(shared, f"certificates-{name}", lambda: certify(case.problem, case.controllers, case.simulation))

    return found
