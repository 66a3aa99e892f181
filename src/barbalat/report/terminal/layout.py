"""Text that fits a terminal: no line breaks inside a number with its unit or inside a name, and none is longer than the
screen."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.cells import cell_len, chop_cells
from rich.console import Console
from rich.segment import SegmentLines
from rich.table import Table
from rich.text import Text

from barbalat.pictures.symbols import GREEK, HELD_BLANK, held

NARROWEST, FALLBACK = 40, 80
"""Columns that every screen is assumed to have, and columns assumed without a terminal (a file, a pipe)."""
LONGEST_LINE = 100
"""Columns of a paragraph: longer lines are hard to read; tables are as wide as necessary."""
UNITS = r"(?:1/s\^2|1/s|rad/s|rad|deg|s|ms|us|Hz|kHz|dB|%|kB|MB|times|rows|steps)"
PAIR = re.compile(rf"(?<=[\d\]]) (?={UNITS}(?![\w/]))")
"""The space between a number, or a list of numbers, and its unit."""
COMPARED = re.compile(r"(?<=\S) (<=|>=|=|<|>|\*|/) (?=[-+\d\[(|])")
"""The spaces around an operator that belongs to the following number."""
ENCLOSED = re.compile(r"(?<=\d) \.\.\. (?=[-+\d])")
"""The spaces between the two ends of an enclosure."""


def capitalized(text: str) -> str:
    """A sentence with a capital, unless it begins with a symbol."""
    word = text.partition(" ")[0]
    symbol = not word.isalpha() or word in GREEK or (len(word) == 1 and word != "a")
    return text if symbol else f"{text[0].upper()}{text[1:]}"


def fold(text: str, width: int, indent: str = "", start: str = "") -> list[str]:
    """Lines of at most ``width`` columns, with further ones indented; a wider word has its own line."""
    lines, line, empty = [], start, True
    words = [
        part for word in re.split(r"[ \n]+", _bound_to_units(text).strip(" \n")) for part in _released(word, width - len(indent))
    ]
    for word in words:
        longer = line + word if empty else f"{line} {word}"
        if cell_len(longer) > width and not empty:
            lines.append(line)
            longer = indent + word
        line, empty = longer, False
    return [*lines, line]


def _bound_to_units(text: str) -> str:
    return COMPARED.sub(rf"{HELD_BLANK}\1{HELD_BLANK}", PAIR.sub(HELD_BLANK, ENCLOSED.sub(f"{HELD_BLANK}...{HELD_BLANK}", text)))


def _released(word: str, width: int) -> list[str]:
    """A word; or its parts if they are too wide together for a line; or pieces of a part."""
    parts = [word] if cell_len(word) <= width else word.split(HELD_BLANK)
    return [piece for part in parts for piece in ([part] if cell_len(part) <= width else chop_cells(part, width))]


def console(*, to_standard_error: bool = False) -> Console:
    """The console for screens, or with ``to_standard_error`` for notes and progress; as wide as the terminal or COLUMNS says."""
    width = max(shutil.get_terminal_size((FALLBACK, 24)).columns, NARROWEST)
    return Console(stderr=to_standard_error, highlight=False, markup=False, emoji=False, width=width)


class Screen:
    """Lines, labelled lines and tables on a console; ``printed`` counts the lines so far."""

    def __init__(self, target: Console | None = None, *, longest: int = LONGEST_LINE) -> None:
        self.console = target or console()
        self.width = min(self.console.width, longest)
        self.printed = 0

    def title(self, text: str, style: str = "bold") -> None:
        """A heading after an empty line."""
        self._print("")
        self.line(text, style)

    def line(self, text: str, style: str = "", indent: str = "", start: str = "") -> None:
        """A paragraph; its further lines are indented, and the first one begins with ``start``."""
        for line in self.folded(text, indent, start):
            self._print(line, style)

    def folded(self, text: str, indent: str = "", start: str = "") -> list[str]:
        """The lines of a paragraph."""
        return fold(self._shown(text), self.width, indent, start)

    def name(self, text: str) -> str:
        """A controller's name, as one word."""
        return held(self._shown(text))

    def whole(self, text: str) -> None:
        """A line that is to be copied, such as a path: never folded."""
        self._print(self._shown(text))

    def fact(self, label: str, text: str, room: int, style: str = "") -> None:
        """A label in ``room`` columns, followed by a paragraph; the paragraph is below it if the label is too wide or the
        screen narrow."""
        label, text, hanging = self._shown(label), self._shown(text), " " * (room + 4)
        enclosed = ENCLOSED.sub("-...-", text)  # one word as wide as it is
        widest = max((cell_len(word) for word in enclosed.replace(HELD_BLANK, " ").split()), default=0)
        if cell_len(label) > room or self.width - len(hanging) < max(NARROWEST // 2, widest):
            for line in fold(label, self.width, "    ", "  "):
                self._print(line, style)
            hanging, start = "      ", ""
        else:
            start = "  " + label.replace(HELD_BLANK, " ") + " " * (room - cell_len(label) + 2)
        lines = fold(text, self.width - len(hanging))
        for i, line in enumerate(lines):
            before = start if i == 0 and start else hanging
            self.console.print(Text.assemble((before, style), line.replace(HELD_BLANK, " ")), soft_wrap=True)
            self.printed += 1

    def table(self, headings: Sequence[str], rows: Sequence[Sequence[str]], leads: int = 1, left: Sequence[int] = ()) -> None:
        """A line for each row if that fits, or else with the first entries above their rows, or else a paragraph for each.

        leads  number of leading columns that identify a row: they are left-justified, as are those with the indices ``left``; a
               row whose first entry is empty belongs to the one above. Nothing is shown without rows
        """
        if not rows:
            return
        shown = [[self._shown(cell) for cell in row] for row in rows]
        table = _table(headings, shown, leads, left)
        if self._fits(table):
            self.console.print(table)
            self.printed += len(self.console.render_lines(table, pad=False))
            return
        table = _table(headings, [["", *others] for _, *others in shown], leads, left)
        if self._fits(table):
            self._below_names(table, [first for first, *_ in shown])
        else:
            self._paragraphs([heading.replace("\n", " ") for heading in headings], shown, leads)

    def _fits(self, table: Table) -> bool:
        return self.console.measure(table, options=self.console.options.update(width=10_000)).maximum <= self.console.width

    def _below_names(self, table: Table, names: Sequence[str]) -> None:
        """A table in which each name has a line of its own above its rows."""
        lines = self.console.render_lines(table, pad=False)
        before = len(lines) - len(names)
        self.console.print(SegmentLines(lines[:before], new_lines=True))
        self.printed += len(lines)
        for name, line in zip(names, lines[before:], strict=True):
            if name:
                self.line(name, indent="  ")
            self.console.print(SegmentLines([line], new_lines=True))

    def _paragraphs(self, headings: Sequence[str], rows: Sequence[Sequence[str]], leads: int) -> None:
        for row in rows:
            pairs = [held(f"{heading} {cell}".strip()) for heading, cell in zip(headings, row, strict=True) if cell]
            own = [cell for cell in row[:leads] if cell]
            text = ", ".join(pairs[len(own) :])
            if row[0] and leads > 1:
                self.line(row[0], "bold")
                own = own[1:]
            start = "  " if leads > 1 else ""
            said = f"{held(': '.join(own) + ':')} {text}" if own else text
            self.line(said, indent=f"{start}    ", start=start)

    def _shown(self, text: str) -> str:
        """The text with escapes for characters that the terminal's encoding lacks, which the layout has to take into account."""
        encoding, marked = self.console.encoding, text.replace(HELD_BLANK, "\0")
        return marked.encode(encoding, "backslashreplace").decode(encoding).replace("\0", HELD_BLANK)

    def _print(self, line: str, style: str = "") -> None:
        self.console.print(Text(line.replace(HELD_BLANK, " "), style=style), soft_wrap=True)
        self.printed += 1


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]], leads: int, left: Sequence[int]) -> Table:
    """A line for each row, or as many as its first entry has."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for i, heading in enumerate(headings):
        table.add_column(Text(heading), justify="left" if i < leads or i in left else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(Text(cell.replace(HELD_BLANK, " ")) for cell in row))
    return table


def grouped(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """The rows with the first entry only where it changes."""
    found: list[list[str]] = []
    for _, group in groupby(rows, key=lambda row: row[0]):
        found += [[row[0] if i == 0 else "", *row[1:]] for i, row in enumerate(group)]
    return found
