"""Write requirements.lock: everything that any command of ./dev installs, each requirement under the groups that need it.

The file is an ordinary requirements file with hashes. A comment above each requirement names its groups; ``./dev`` installs the
requirements of the groups that a command needs. All groups are resolved under the versions of ``dev``, and share one environment.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

LOCK = Path("requirements.lock")
GROUPS = {
    "dev": ["--extra", "tables", "--extra", "control", "--extra", "robust", "--extra", "study", "--group", "dev"],
    "peers": ["--group", "peers"],
    "package": ["--group", "package"],
    "browser": ["--group", "browser"],
    "docs": ["--group", "docs"],
    "flight": ["--extra", "flight"],
}
"""What uv is asked for, by group; ``dev`` comes first, since the others are resolved under its versions."""
COMPILE = (
    *("pip", "compile", "--universal", "--python-version", "3.11", "--generate-hashes"),
    *("--no-header", "--no-annotate", "--quiet", "--upgrade", "pyproject.toml"),
)
HEAD = """\
# Written by ./dev lock from pyproject.toml. The comment above a requirement names the groups of ./dev that install it.
"""
REQUIREMENT = re.compile(r"^[^\s#].*(?:\n[ ].*)*", re.MULTILINE)


def main() -> None:
    """Resolve every group and replace the lock."""
    found: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for group, asked in GROUPS.items():
            written = Path(folder, group)
            under = [] if group == "dev" else ["--constraint", str(Path(folder, "dev"))]
            uv = Path(sys.executable).parent / "uv"
            subprocess.run([uv, *COMPILE, *asked, *under, "--output-file", written], check=True)
            for requirement in REQUIREMENT.findall(written.read_text()):
                found.setdefault(requirement, []).append(group)
    LOCK.write_text(HEAD + "".join(f"# {' '.join(groups)}\n{requirement}\n" for requirement, groups in sorted(found.items())))


if __name__ == "__main__":
    main()
