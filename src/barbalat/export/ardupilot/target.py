"""``--target ardupilot``: one axis of a multicopter, through ArduPilot's interface for custom controllers."""

from __future__ import annotations

from barbalat.export.target import Request, Target


def _files(asked: Request) -> dict[str, str]:
    from barbalat.export.ardupilot.files import files

    return files(asked)


TARGETS = (
    Target(
        name="ardupilot",
        help="a backend of ArduPilot's AC_CustomControl for one axis",
        files=_files,
        parameters=True,
        float32=True,
        check=lambda folder, _: f"cd {folder} && cc -std=c99 -ffp-contract=off *_controller.c *_selftest.c -lm && ./a.out",
    ),
)
