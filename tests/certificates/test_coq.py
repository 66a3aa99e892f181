"""The formal proofs in proofs/ are accepted by Coq, are complete, and prove statements that could be false."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "proofs" / "lyapunov.v"
"""Theorem 1 (i) and the inequality of the sampled law."""

needs_coq = pytest.mark.skipif(shutil.which("coqc") is None, reason="Coq is not installed")

AXIOMS_OF_THE_REALS = {
    "ClassicalDedekindReals.sig_not_dec",
    "ClassicalDedekindReals.sig_forall_dec",
    "FunctionalExtensionality.functional_extensionality_dep",
    "Classical_Prop.classic",
}
"""The axioms of the real numbers in Coq's standard library. Nothing else may be assumed."""


def compiled(source: str, folder: Path) -> subprocess.CompletedProcess[str]:
    (folder / "lyapunov.v").write_text(source, encoding="utf-8")
    return subprocess.run(["coqc", "-q", "lyapunov.v"], cwd=folder, capture_output=True, text=True, check=False, timeout=300)


@needs_coq
@pytest.mark.dear
def test_the_proofs_are_accepted_and_assume_only_the_real_numbers(tmp_path: Path) -> None:
    source = SOURCE.read_text(encoding="utf-8")
    result = compiled(source, tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("Axioms:") == source.count("Print Assumptions")
    assert set(re.findall(r"^([A-Z]\w*\.\w+)", result.stdout, re.MULTILINE)) <= AXIOMS_OF_THE_REALS
    assert not re.search(r"\b(Admitted|admit|Axiom|Parameter|Conjecture)\b", source)


@needs_coq
@pytest.mark.parametrize(
    ("stated", "false"),
    [
        ("<= dot p (z t) (phi t) * form n P (e t) b.", "<= - dot p (z t) (phi t) * form n P (e t) b."),
        ("(scale (- dot p (z t) (phi t)) b)) t.", "(scale (dot p (z t) (phi t)) b)) t."),
        ("  V1 - V0 <= - T * dot n x1 x1 +", "  V1 - V0 <= - 2 * T * dot n x1 x1 +"),
        ("Hypothesis outward : 0 <= dot p z1 g.", "Hypothesis outward : dot p z1 g <= 0."),
        ("Definition s := s0 / (1 + T * k", "Definition s := s0 / (1 + 2 * T * k"),
        (
            "Hypothesis starts_at_rest : forall i, (i < n)%nat -> e 0 i = 0.",
            "Hypothesis starts_at_rest : forall i, (i < n)%nat -> 0 <= e 0 i.",
        ),
    ],
)
def test_a_false_statement_is_not_accepted(stated: str, false: str, tmp_path: Path) -> None:
    source = SOURCE.read_text(encoding="utf-8")
    assert source.count(stated) == 1
    assert compiled(source.replace(stated, false), tmp_path).returncode != 0
