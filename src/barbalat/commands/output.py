"""Writes the results of commands to a folder and to standard output."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from barbalat.commands.progress import Work
    from barbalat.folders import Folder
    from barbalat.report.terminal.layout import Screen


STANDARD_OUTPUT = "-"
"""The file name that means standard output."""


@contextlib.contextmanager
def folder_of(given: str | None, default: str | None) -> Iterator[Folder | None]:
    """Open the folder of ``--out``, or else ``default``. Returns None if neither is given."""
    from barbalat.folders import output_folder
    from barbalat.validate import local_path

    require_folder_name("--out", given)
    name = default if given is None else given
    if name is None:
        yield None
        return
    with output_folder(local_path("--out", name)) as folder:
        yield folder


def require_folder_name(option: str, given: str | None) -> None:
    """Raise InputError for an empty name, and for the name of standard output, which is not a folder."""
    from barbalat.validate import InputError

    if given == "":
        raise InputError(f"{option} must name a folder, got ''; the current folder is '.'")
    if given == STANDARD_OUTPUT:
        raise InputError(f"{option} must name a folder, got '-', which is standard output; './-' is a folder of that name")


def print_text(text: str) -> None:
    """Write a file's text to standard output, byte for byte in UTF-8 if that is its encoding."""
    sys.stdout.write(text)


def print_json(text: str) -> None:
    """Write a JSON document to standard output, with escapes for characters that its encoding lacks."""
    import json

    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(json.loads(text), indent=2)
    print(text)  # noqa: T201


def write_drawn(folder: Folder | None, running: Work, file: str, document: str, draw: Callable[[Folder], None]) -> None:
    """Write a command's document and the files of ``draw``, all at once. Without a folder nothing is written."""
    if folder is not None:
        with running.part("drawing"):
            folder.write(file, document)
            draw(folder)
            folder.commit()


def tell(document: str, show: Callable[[Screen], None], folder: Folder | None, *, as_json: bool, **files: str) -> None:
    """Print the result of a command: only the document, or a screen that lists the ``files`` of the folder by their contents."""
    if as_json:
        print_json(document)
        return
    from barbalat.report.terminal.layout import Screen

    screen = Screen()
    show(screen)
    if folder is not None:
        for what, name in files.items():
            screen.whole(f"{what}: {folder.path / name}")
