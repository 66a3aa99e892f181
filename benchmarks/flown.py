"""Store a campaign for the ledger: ``barbalat fly NAME --dispersions N --store DIR --json | python -m benchmarks.flown``.

It writes src/barbalat/papers/jafari_2013/flight/flown-NAME.json, which the row ``adaptive-in-flight`` then reads.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from barbalat.papers.jafari_2013.flight import flown

FOLDER = Path(flown.__file__).parent

if __name__ == "__main__":
    document = json.load(sys.stdin)
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
    (FOLDER / f"{flown.PREFIX}{document['flight']}{flown.SUFFIX}").write_text(text, encoding="utf-8")
