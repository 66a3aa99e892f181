"""The files of an export, without a folder."""

from barbalat.export.c99.files import sources
from barbalat.export.fmu import archive
from barbalat.export.target import Request


def files(problem, controller, simulation, **options):
    return sources(Request(problem=problem, controller=controller, simulation=simulation, **options))[1]


def units(problem, controller, simulation, *, version, compiled=True, **options):
    return archive.units(
        Request(problem=problem, controller=controller, simulation=simulation, sources_only=not compiled, **options), version
    )
