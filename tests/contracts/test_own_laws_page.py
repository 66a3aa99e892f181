"""The page on laws of one's own: its lines run as they stand there."""

from __future__ import annotations

from pathlib import Path

from barbalat import check_controller
from barbalat.cases import outside

PAGE = (Path(__file__).parents[2] / "docs" / "own-laws.md").read_text(encoding="utf-8")


def test_the_pages_law_runs(problems, tmp_path):
    file = tmp_path / "page.py"
    file.write_text(PAGE.partition("%%writefile mylaws.py\n")[2].partition("```")[0], encoding="utf-8")
    (controller,) = outside.run(file).controllers(named={})
    check_controller(controller, problems[2])
    assert f'entry-points."{outside.ENTRY_POINT_GROUP}"' in PAGE
