"""``barbalat certify``: conditions, bounds, norms, gain limits, margins; nothing is simulated unless asked."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from barbalat.commands.options import add_controllers
from barbalat.commands.output import print_json
from barbalat.commands.screen import work

if TYPE_CHECKING:
    from barbalat.cases.build import Case
    from barbalat.certificates.certificate import Certificate
    from barbalat.commands import Commands


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser("certify", help="conditions, bounds, norms, gain limits and margins of a case's controllers")
    parser.add_argument("case", metavar="CASE", help="a case file, or a bundled case's name")
    add_controllers(parser)
    parser.add_argument("--simulate", action="store_true", help="also measure each loop's delay margin by simulation")
    parser.add_argument(
        "--share", type=float, metavar="S", help="with --simulate: added error, in motions, that is lost; default 1"
    )
    parser.add_argument("--full", action="store_true", help="every value with its kind, all assumptions, and Table 1")
    parser.add_argument("--json", action="store_true", help="one JSON document on standard output")
    parser.set_defaults(execute=execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from barbalat.cases.load import load_case
    from barbalat.certificates.table_1 import table_1
    from barbalat.report.terminal import certificates as terminal
    from barbalat.report.terminal.layout import Screen
    from barbalat.report.write import as_json
    from barbalat.validate import InputError

    if options.share is not None and not options.simulate:
        raise InputError("--share needs --simulate: without it no loop is simulated")
    case = load_case(options.case, options.controllers)
    certificates = _certified(case, options)
    table = table_1(case.problem, case.controllers, certificates)
    if options.json:
        document = {
            "case": case.name,
            "controllers": {name: c.as_json() for name, c in certificates.items()},
            "table_1": table.as_json(),
        }
        print_json(as_json(document))
        return 0
    screen, dt = Screen(), case.simulation.dt
    if options.full:
        terminal.show_full(screen, case.name, certificates, table, dt)
        return 0
    terminal.show(screen, case.name, certificates, table, dt)
    screen.title("Every value with its kind, all assumptions, Table 1:", "")
    screen.whole(f"  barbalat certify {options.case} --full")
    return 0


CERTIFYING_SECONDS, SIMULATING_SECONDS = 0.5, 20.0
"""Seconds for each controller, about, until its own pace is known."""


def _certified(case: Case, options: argparse.Namespace) -> dict[str, Certificate]:
    """All controllers' certificates, with simulated margins where those are asked for."""
    from barbalat.certificates.certify import certify

    count = len(case.controllers)
    simulating = {"simulating": SIMULATING_SECONDS * count} if options.simulate else {}
    with work({"certifying": CERTIFYING_SECONDS * count} | simulating) as running:
        with running.part("certifying") as progress:
            certificates = certify(case.problem, case.controllers, case.simulation, progress=progress)
        if options.simulate:
            from barbalat.study.criteria import Lost
            from barbalat.study.simulated_margins import with_simulated_margins

            lost = Lost() if options.share is None else Lost(share=options.share)
            with running.part("simulating") as progress:
                certificates = with_simulated_margins(
                    certificates, case.problem, case.controllers, case.simulation, lost=lost, progress=progress
                )
    return certificates
