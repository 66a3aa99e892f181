"""Keep a campaign for the ledger: ``barbalat fly NAME --dispersions N --store DIR --json | python -m benchmarks.flown``.

It writes src/barbalat/claims/flown-NAME.json, which the row ``adaptive-in-flight`` reads from then on.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from barbalat.claims.stored_flights import PREFIX, SUFFIX

FOLDER = Path(__file__).parents[1] / "src" / "barbalat" / "claims"

if __name__ == "__main__":
    document = json.load(sys.stdin)
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
    (FOLDER / f"{PREFIX}{document['flight']}{SUFFIX}").write_text(text, encoding="utf-8")
