"""What a certificate is: numbers with the assumptions they rest on, by the names of the JSON contract."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Certificate:
    """One controller's certificate.

    values       by the contract's keys; a key that has no meaning for the scheme is absent
    guaranteed   the keys whose value is a bound that holds under the assumptions; all others are estimates
    assumptions  sentences
    findings     what failed to hold, as sentences: a condition, a bound that does not exist
    """

    values: dict[str, Any]
    guaranteed: frozenset[str]
    assumptions: tuple[str, ...]
    findings: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The JSON contract's block for a controller."""
        document = {key: value for key, value in self.values.items() if value is not None}
        document["guaranteed"] = sorted(self.guaranteed & document.keys())
        document["assumptions"] = list(self.assumptions)
        if self.findings:
            document["findings"] = list(self.findings)
        return document
