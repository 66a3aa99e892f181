"""What is certified of the case as it is given, beside the sliders: a page computes no certificate."""

from __future__ import annotations

from html import escape

from barbalat.cases.build import Case
from barbalat.certificates.certify import certified_case
from barbalat.certificates.rows import CertificateRow

TABLE_HEAD = "<tr>" + "".join(f'<th scope="col">{name}</th>' for name in ("quantity", "value", "kind", "meaning")) + "</tr>"


def section(case: Case) -> str:
    """HTML that says what it belongs to; folded, one part for each controller."""
    found = certified_case(case.problem, case.controllers, case.simulation).certificates
    parts = [
        f'<details><summary>{escape(name)}</summary><div class="wide" tabindex="0" role="region" '
        f'aria-label="Certificates of {escape(name)}"><table class="figures"><thead>{TABLE_HEAD}</thead><tbody>'
        f"{''.join(map(_row, certificate.rows))}</tbody></table></div></details>"
        for name, certificate in found.items()
    ]
    note = (
        "They belong to the case as it is given, whatever the sliders say; for a copied case file barbalat certify has its own."
    )
    return f'<h2>Certificates of the case</h2><p class="note">{note}</p>{"".join(parts)}'


def _row(row: CertificateRow) -> str:
    cells = "".join(f"<td>{escape(text)}</td>" for text in (row.value, row.kind, row.meaning))
    return f'<tr><th scope="row">{escape(row.quantity)}</th>{cells}</tr>'
