"""Text that fits a terminal. Lines do not break inside a name or between a number and its unit, and no line is longer than the
screen is wide."""

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
"""Number of columns that every screen is assumed to have, and number assumed without a terminal (a file or a pipe)."""
LONGEST_LINE = 100
"""Width of a paragraph in columns. Longer lines are hard to read; tables are as wide as necessary."""
UNITS = r"(?:1/s\^2|1/s|rad/s|rad|deg|s|ms|us|Hz|kHz|dB|%|kB|MB|times|rows|steps)"
PAIR = re.compile(rf"(?<=[\d\]]) (?={UNITS}(?![\w/]))")
"""The space between a number, or a list of numbers, and its unit."""
COMPARED = re.compile(r"(?<=\S) (<=|>=|=|<|>|\*|/) (?=[-+\d\[(|])")
"""The spaces around an operator that belongs to the following number."""
ENCLOSED = re.compile(r"(?<=\d) \.\.\. (?=[-+\d])")
"""The spaces between the two ends of an enclosure."""


def capitalized(text: str) -> str:
    """Return the sentence with a capital letter, unless it begins with a symbol."""
    word = text.partition(" ")[0]
    symbol = not word.isalpha() or word in GREEK or (len(word) == 1 and word != "a")
    return text if symbol else f"{text[0].upper()}{text[1:]}"


def fold(text: str, width: int, indent: str = "", start: str = "") -> list[str]:
    """Break the text into lines of at most ``width`` columns and indent all but the first. A wider word has a separate line."""
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
    """Return the word or, if it is too wide for a line, its parts, or pieces of a part."""
    parts = [word] if cell_len(word) <= width else word.split(HELD_BLANK)
    return [piece for part in parts for piece in ([part] if cell_len(part) <= width else chop_cells(part, width))]


def console(*, to_standard_error: bool = False) -> Console:
    """Return the console for screens, or, with ``to_standard_error``, for notes and progress. Its width is that of the terminal
    or of COLUMNS."""
    width = max(shutil.get_terminal_size((FALLBACK, 24)).columns, NARROWEST)
    return Console(stderr=to_standard_error, highlight=False, markup=False, emoji=False, width=width)


class Screen:
    """Prints lines, labelled lines and tables on a console. ``printed`` is the number of lines so far."""

    def __init__(self, target: Console | None = None, *, longest: int = LONGEST_LINE) -> None:
        self.console = target or console()
        self.width = min(self.console.width, longest)
        self.printed = 0

    def title(self, text: str, style: str = "bold") -> None:
        """Print a heading after an empty line."""
        self._print("")
        self.line(text, style)

    def line(self, text: str, style: str = "", indent: str = "", start: str = "") -> None:
        """Print a paragraph. The first line begins with ``start``, and the others are indented."""
        for line in self.folded(text, indent, start):
            self._print(line, style)

    def folded(self, text: str, indent: str = "", start: str = "") -> list[str]:
        """Return the lines of a paragraph."""
        return fold(self._shown(text), self.width, indent, start)

    def name(self, text: str) -> str:
        """Return the name of a controller in a form that is not broken across lines."""
        return held(self._shown(text))

    def whole(self, text: str) -> None:
        """Print a line that is to be copied, such as a path. It is never folded."""
        self._print(self._shown(text))

    def fact(self, label: str, text: str, room: int, style: str = "") -> None:
        """Print a label in ``room`` columns, followed by a paragraph. The paragraph is below the label if the label is too wide
        or the screen is narrow."""
        label, text, hanging = self._shown(label), self._shown(text), " " * (room + 4)
        enclosed = ENCLOSED.sub("-...-", text)  # becomes one word of the same width
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
        """Print a table. Without rows nothing is printed.

        Each row is one line if that fits. Otherwise the first entries are printed above their rows or, if that is still too wide,
        each row is a paragraph. A row whose first entry is empty belongs to the row above.

        leads  number of leading columns that identify a row; they are left-justified
        left   indices of further columns that are left-justified
        """
        if not rows:
            return
        if any(len(row) != len(headings) for row in rows):
            raise ValueError(f"every row must have {len(headings)} entries, one per heading")
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
        """Print a table in which each name has a separate line above its rows."""
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
        """Return the text with escapes for characters that the terminal's encoding lacks; the layout depends on their width."""
        encoding, marked = self.console.encoding, text.replace(HELD_BLANK, "\0")
        return marked.encode(encoding, "backslashreplace").decode(encoding).replace("\0", HELD_BLANK)

    def _print(self, line: str, style: str = "") -> None:
        self.console.print(Text(line.replace(HELD_BLANK, " "), style=style), soft_wrap=True)
        self.printed += 1


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]], leads: int, left: Sequence[int]) -> Table:
    """Return a table with one line for each row, or as many lines as the first entry of the row has."""
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for i, heading in enumerate(headings):
        table.add_column(Text(heading), justify="left" if i < leads or i in left else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(Text(cell.replace(HELD_BLANK, " ")) for cell in row))
    return table


def grouped(rows: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the rows with an empty first entry where it repeats the entry above."""
    found: list[list[str]] = []
    for _, group in groupby(rows, key=lambda row: row[0]):
        found += [[row[0] if i == 0 else "", *row[1:]] for i, row in enumerate(group)]
    return found
