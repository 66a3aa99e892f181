"""The modules that ``run`` must not load, because every unnecessary import delays every run."""

import subprocess
import sys

CODE = """
import sys
from barbalat.cli import main
assert main(["run", "first-order", "--json"]) == 0
loaded = [name for name in sys.modules if name.startswith(("barbalat.export", "barbalat.papers"))]
print(loaded, file=sys.stderr)
"""


def test_a_run_loads_neither_exports_nor_papers() -> None:
    found = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert found.stderr.splitlines()[-1] == "[]"
