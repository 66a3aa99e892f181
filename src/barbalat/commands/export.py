"""``barbalat export``: a case's controller as source for a flight computer, or as a unit for co-simulation."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from barbalat.commands.options import add_budget, add_controllers
from barbalat.commands.output import print_json, require_folder_name
from barbalat.commands.progress import say

if TYPE_CHECKING:
    from collections.abc import Iterator

    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("export", help="a controller as C that computes what was simulated, bit for bit")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    parser.add_argument("--controller", required=True, metavar="NAME", help="one of the case's, which runs sampled")
    parser.add_argument("--target", metavar="TARGET", choices=Targets(), default="c99", help="one of %(choices)s; c99 by default")
    parser.add_argument("--out", required=True, metavar="DIR", help="the folder; an export that is there is replaced as a whole")
    parser.add_argument("--float32", action="store_true", help="numbers of 32 bits instead of 64")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--controller-only", action="store_true", help="nothing but the controller, which is the default")
    which.add_argument("--closed-loop", action="store_true", help="the plant and the whole loop as well")
    parser.add_argument("--sources-only", action="store_true", help="units without a binary, which needs a C compiler here")
    add_controllers(parser)
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    add_budget(parser)
    parser.set_defaults(execute=execute)


class Targets:
    """The names of all targets, looked for when a user asks for one, or for help: other commands don't wait for that."""

    def __iter__(self) -> Iterator[str]:
        from barbalat.export.target import targets

        return iter(targets())

    def __contains__(self, name: str) -> bool:
        return name in iter(self)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import load_case
    from barbalat.export.target import targets
    from barbalat.export.write import export_controller
    from barbalat.validate import InputError, local_path, show

    require_folder_name("--out", options.out)
    out = local_path("--out", options.out)
    case = load_case(options.case, options.controllers)
    found = {controller.name: controller for controller in case.controllers}
    if options.controller not in found:
        raise InputError(f"--controller must be one of {', '.join(map(show, found))}, got {show(options.controller)}")
    controller = found[options.controller]
    folder = export_controller(
        case.problem,
        controller,
        case.simulation,
        out=out,
        target=options.target,
        float32=options.float32,
        closed_loop=options.closed_loop,
        sources_only=options.sources_only,
        place=list(found).index(controller.name),
    )
    check = targets()[options.target].check(shlex.quote(str(folder)), options.closed_loop)
    if options.json:
        from barbalat.report.documents import as_json

        files = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
        about = {"case": case.name, "controller": controller.name, "target": options.target, "folder": str(folder)}
        print_json(as_json({**about, "files": files, "check": check}))
    else:
        say(f"written: {folder}; check it with: {check}")
    return 0
