"""The metrics of a page's controllers, computed by the page's own scripts in Node.js without a browser."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="Node.js is not installed")

SCRIPT = """
import { readFileSync } from "node:fs";
globalThis.self = {};
const { caseSetting, readData, taskOf } = await import("./setting.js");
const { simulated } = await import("./worker.js");
const data = readData(readFileSync(0, "utf8"));
const setting = { ...caseSetting(data), ...JSON.parse(process.argv[2]) };
const figures = data.controllers.map((controller, i) => [controller.name, simulated(taskOf(data, setting, i)).figures]);
console.log(JSON.stringify(Object.fromEntries(figures)));
"""


def figures(data: dict[str, Any], folder: Path, **setting: object) -> dict[str, dict[str, Any]]:
    """The figures by controller for the page with this data. ``setting`` is as in caseSetting in setting.js."""
    for file in (resources.files("barbalat.explorer") / "templates").iterdir():
        if file.name.endswith(".js"):
            (folder / file.name).write_text(file.read_text("utf-8"), encoding="utf-8")
    (folder / "package.json").write_text('{ "type": "module" }')
    (folder / "run.js").write_text(SCRIPT)
    done = subprocess.run(
        ["node", "run.js", json.dumps(setting)],
        input=json.dumps(data),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return found
