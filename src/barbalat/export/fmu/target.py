"""``--target fmu2`` and ``--target fmu3``."""

from __future__ import annotations

from functools import partial

from barbalat.export.target import Request, Target


def _units(asked: Request, version: int) -> dict[str, bytes]:
    from barbalat.export.fmu.archive import units

    return units(asked, version)


def _check(folder: str, closed_loop: bool) -> str:
    if closed_loop:
        return f'for unit in {folder}/*.fmu; do fmpy validate "$unit"; done'  # fmpy accepts one unit at a time
    return f"fmpy validate {folder}/*.fmu"


TARGETS = tuple(
    Target(
        name=f"fmu{version}",
        help=f"an FMU for Co-Simulation (FMI {version}.0); its gains, limits and initial estimates are parameters",
        files=partial(_units, version=version),
        check=_check,
        compiles=True,
    )
    for version in (2, 3)
)
