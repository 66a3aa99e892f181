"""``--target c99``."""

from __future__ import annotations

from barbalat.export.target import Request, Target


def _files(asked: Request) -> dict[str, str]:
    from barbalat.export.c99.files import files

    return files(
        asked.problem, asked.controller, asked.simulation, float32=asked.float32, closed_loop=asked.closed_loop, name=asked.name
    )


TARGETS = (
    Target(
        name="c99",
        help="controller.h, controller.c, selftest.c, README.md",
        files=_files,
        check=lambda folder, _: f"cd {folder} && cc -std=c99 -ffp-contract=off controller.c selftest.c -lm && ./a.out",
        replaced=("plant.h", "plant.c", "loop.c"),
    ),
)
