"""``barbalat certify``: conditions, bounds, norms, gain limits and margins. It simulates only on request."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.commands.options import add_case, conclude
from barbalat.commands.output import STANDARD_OUTPUT, folder_of, print_json
from barbalat.commands.progress import Work, work

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from barbalat.cases.build import Case
    from barbalat.certificates.certificates import Certificates
    from barbalat.certificates.certify import Certified
    from barbalat.commands import Commands
    from barbalat.folders import Folder


def add(commands: Commands) -> None:
    """Register the command and its options."""
    parser = commands.add_parser(
        "certify", help="compute bounds, margins, and limits on gain and step size for a case's controllers"
    )
    add_case(parser)
    parser.add_argument("--simulate", action="store_true", help="also measure each loop's delay margin by simulation")
    parser.add_argument(
        "--share",
        type=float,
        metavar="S",
        help="with --simulate: a run also counts as lost when the delay increases the largest error in the tail by S times the "
        "largest model state; default 1",
    )
    parser.add_argument(
        "--float32",
        action="store_true",
        help="with --simulate: find the adaptation gain at which a compiled 32-bit export departs from the run",
    )
    parser.add_argument("--out", metavar="DIR", help="folder for the page and the JSON")
    parser.add_argument("--pictures", action="store_true", help="with --out: also write the charts of the loops as PNG and SVG")
    parser.add_argument("--proof", metavar="FILE", help="write each guaranteed number with its witness, for barbalat-check FILE")
    parser.add_argument(
        "--full",
        action="store_true",
        help="print every value with its kind, all assumptions, and the comparison in the form of the paper's Table 1",
    )
    conclude(parser, execute)


def execute(options: argparse.Namespace) -> int:
    """Run the command. Return the exit code."""
    from barbalat.cases.load import load_case
    from barbalat.certificates.certify import Certified
    from barbalat.report.documents import as_json
    from barbalat.validate import InputError

    if options.share is not None and not options.simulate:
        raise InputError("--share needs --simulate, which simulates the loops")
    if options.float32 and not options.simulate:
        raise InputError("--float32 needs --simulate, which simulates the loops")
    proof = _proof_file(options)
    case = load_case(options.case, options.controllers)
    with (
        folder_of(options.out, None) as folder,
        _folder_of_proof(proof, folder) as beside,
        work(_expected(case, options)) as running,
    ):
        certificates = _certified(case, options, running)
        found = Certified(certificates, certificates.table, certificates.further_blocks)
        document = as_json(found.as_document(case.name))
        if folder is not None:
            with running.part("drawing"):
                from barbalat.report.run_pages import write_certificates

                write_certificates(folder, case.name, found, document, pictures=options.pictures)
        if proof is not None and beside is not None:
            with running.part("proving"):
                beside.write(proof.name, _proof_of(case, certificates))
            beside.commit()
        if folder is not None:
            folder.commit()
    if options.json:
        print_json(document)
    else:
        _show(case, found, options)
    return 0


def _show(case: Case, found: Certified, options: argparse.Namespace) -> None:
    from barbalat.report.file_names import PAGE
    from barbalat.report.terminal import certificates as terminal
    from barbalat.report.terminal.layout import Screen

    screen, dt = Screen(), case.simulation.dt
    if options.full:
        terminal.show_full(screen, case.name, found.certificates, found.table, dt)
    else:
        terminal.show(screen, case.name, found.certificates, found.table, dt)
        screen.title("For every value with its kind, all assumptions and Table 1:", "")
        screen.whole(f"  barbalat certify {options.case} --full")
    if options.out is not None:
        screen.whole(f"page: {Path(options.out) / PAGE}")
    if options.proof is not None:
        screen.whole(f"proof: {options.proof}; check it with: barbalat-check {options.proof}")


def _proof_file(options: argparse.Namespace) -> Path | None:
    from barbalat.validate import InputError, local_path

    if options.proof is None:
        return None
    file = local_path("--proof", options.proof)
    if not options.proof or options.proof == STANDARD_OUTPUT or file.is_dir():
        raise InputError(f"--proof must name a file, such as case.proof.json, got {options.proof!r}")
    return file


def _folder_of_proof(file: Path | None, out: Folder | None) -> AbstractContextManager[Folder | None]:
    """Open the folder for the proof, which may be the folder of ``--out``."""
    from barbalat.folders import output_folder

    if file is None or (out is not None and out.path.resolve() == file.parent.resolve()):
        return nullcontext(None if file is None else out)
    return output_folder(file.parent)


def _proof_of(case: Case, certificates: Certificates) -> str:
    import json

    from barbalat.certificates.proof import proof

    return json.dumps(proof(case.name, case.problem, case.controllers, case.simulation, certificates), allow_nan=False) + "\n"


CERTIFYING_SECONDS, SIMULATING_SECONDS = 0.5, 20.0
"""Estimated seconds for each controller until its pace is known."""
DRAWING_SECONDS = 2.0
"""Estimated seconds for drawing the loops of all controllers."""
PROVING_SECONDS = 0.3
"""Estimated seconds, for each controller, for the witnesses of its L1 norms."""


def _expected(case: Case, options: argparse.Namespace) -> dict[str, float]:
    """Return the expected seconds of each part of the work."""
    count = len(case.controllers)
    simulating = {"simulating": SIMULATING_SECONDS * count} if options.simulate else {}
    simulating |= {"float32": SIMULATING_SECONDS * count} if options.float32 else {}
    drawing = {"drawing": DRAWING_SECONDS} if options.out is not None else {}
    proving = {"proving": PROVING_SECONDS * count} if options.proof is not None else {}
    return {"certifying": CERTIFYING_SECONDS * count} | simulating | drawing | proving


def _certified(case: Case, options: argparse.Namespace, running: Work) -> Certificates:
    """Return the certificates of all controllers, with simulated margins if requested."""
    from barbalat.certificates.certify import certify

    with running.part("certifying") as progress:
        certificates = certify(case.problem, case.controllers, case.simulation, progress=progress)
    if options.simulate:
        from barbalat.study.simulated_margins import with_simulated_margins
        from barbalat.study.verdicts import Lost

        lost = Lost() if options.share is None else Lost(share=options.share)
        with running.part("simulating") as progress:
            certificates = with_simulated_margins(
                certificates, case.problem, case.controllers, case.simulation, judge=case.judge, lost=lost, progress=progress
            )
    if options.float32:
        from barbalat.export.single_precision import with_float32_gains

        with running.part("float32") as progress:
            certificates = with_float32_gains(certificates, case.problem, case.controllers, case.simulation, progress=progress)
    return certificates
