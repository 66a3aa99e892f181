"""``--target c99``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from barbalat.export.target import Request, Target


def _files(asked: Request) -> dict[str, str]:
    from barbalat.export.c99.files import sources

    _, files = sources(asked)
    return files


def _joined(folder: Path, made: Mapping[str, str | bytes]) -> dict[str, str]:
    from barbalat.export.c99.component import HEADER, joined, present, require_apart

    require_apart(folder, made)
    own = {file.removesuffix(HEADER): str(text) for file, text in made.items() if file.endswith(HEADER)}
    return joined(dict(sorted({**present(folder, own), **own}.items()))) if own else {}


TARGETS = (
    Target(
        name="c99",
        help="controller.h, controller.c, selftest.c, README.md",
        files=_files,
        check=lambda folder, _: f"cd {folder} && cc -std=c99 -ffp-contract=off controller.c selftest.c -lm && ./a.out",
        parameters=True,
        handed=True,
        joined=_joined,
        replaced=("plant.h", "plant.c", "loop.c"),
    ),
)
