"""A copy of the package for additions, and a separate process that imports the copy first."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import barbalat

ROOT = Path(barbalat.__file__).parent


def package_in(folder: Path) -> Path:
    """The package's folder, copied into ``folder``."""
    return Path(shutil.copytree(ROOT, folder / "barbalat", ignore=shutil.ignore_patterns("__pycache__")))


def python_says(*arguments: str, path: Path) -> str:
    """The output of Python in a separate process that imports from this folder first."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(path), *(part for part in sys.path if part)])}
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, check=False, cwd=path)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr
    return done.stdout


def barbalat_says(*arguments: str, path: Path) -> str:
    """The output of the program in a separate process that imports from this folder first."""
    return python_says("-m", "barbalat", *arguments, path=path)


def with_entry_point(folder: Path, group: str, package: str) -> None:
    """Write the files that an installer writes for a distribution with this entry point."""
    made = folder / "others-1.0.dist-info"
    made.mkdir()
    (made / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    (made / "entry_points.txt").write_text(f"[{group}]\nanything = {package}\n")
