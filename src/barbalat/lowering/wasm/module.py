"""Translates LLVM IR to a WebAssembly module: LLVM's wasm32 target writes an object file, and this module does the linker's work.

Little is needed. With only one object, its indices and the addresses of its data, which begin at 0, are final. A memory, a stack
pointer if there is a stack, and exports are added.

Formats: WebAssembly core specification, version 1, chapter 5; "WebAssembly object file linking" of its tool conventions.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache

import llvmlite.binding as llvm

TRIPLE = "wasm32-unknown-unknown"
CPU, FEATURES = "mvp", "+nontrapping-fptoint"
"""The instructions of version 1, and conversions that don't trap: browsers have had both since 2021."""
EFFORT = 0
"""LLVM's level of optimisation. Browsers optimise again. Level 3 makes modules two thirds as large, whose steps take 0 to 15 %
less time. But compilation takes three to ten times as long, and its time grows with the square of the length of a function
(docs/laboratory/kernel.md)."""
PAGE_BYTES = 65_536


class _Section(IntEnum):
    CUSTOM, TYPES, IMPORTS, FUNCTIONS, TABLES, MEMORIES, GLOBALS, EXPORTS, START, ELEMENTS, CODE, DATA = range(12)


class _Kind(IntEnum):
    """The kinds of imports and exports."""

    FUNCTION, TABLE, MEMORY, GLOBAL = range(4)


def module(source: str, entry: str, *, stack_bytes: int = 0) -> bytes:
    """A module that exports the first function of ``source`` as ``entry``, and its ``memory``.

    Its initial memory contains the module's tables and, if its functions need one, a stack of ``stack_bytes``. The host adds
    pages for its data. Raises ValueError for IR that needs an external function.
    """
    sections = _sections(_object_file(source))
    imported = _imported(sections.pop(_Section.IMPORTS))
    if lacking := sorted(imported.keys() - {"__linear_memory", "__stack_pointer"}):
        raise ValueError(f"WebAssembly has no {', '.join(lacking)}, and the modules import no functions")
    pages = imported["__linear_memory"]
    if "__stack_pointer" in imported:
        if not stack_bytes:
            raise ValueError("this code needs a stack: its size must be given")
        pages += -(-stack_bytes // PAGE_BYTES)
        constant = b"\x41" + _leb128(pages * PAGE_BYTES, last=0x3F) + b"\x0b"
        sections[_Section.GLOBALS] = b"\x01\x7f\x01" + constant  # one mutable i32: the stack grows downwards
    sections[_Section.MEMORIES] = b"\x01\x00" + _leb128(pages)
    exports = _exported("memory", _Kind.MEMORY), _exported(entry, _Kind.FUNCTION)
    sections[_Section.EXPORTS] = _leb128(len(exports)) + b"".join(exports)
    written = (bytes((kind,)) + _leb128(len(text)) + text for kind, text in sorted(sections.items()))
    return b"\x00asm\x01\x00\x00\x00" + b"".join(written)


@cache
def _target() -> llvm.Target:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(TRIPLE)


def _object_file(source: str) -> bytes:
    # llvmlite's default codemodel requests an ELF object on Windows
    machine = _target().create_target_machine(cpu=CPU, features=FEATURES, opt=EFFORT, codemodel="default")
    parsed = llvm.parse_assembly(source)
    parsed.triple, parsed.data_layout = TRIPLE, str(machine.target_data)
    return bytes(machine.emit_object(parsed))


class _Reader:
    """Reads a part of a module from ``at`` on."""

    def __init__(self, text: bytes, at: int = 0) -> None:
        self.text, self.at = text, at

    def byte(self) -> int:
        self.at += 1
        return self.text[self.at - 1]

    def whole(self) -> int:
        """Read an unsigned integer in LEB128."""
        value = shift = 0
        while (byte := self.byte()) > 0x7F:
            value |= (byte & 0x7F) << shift
            shift += 7
        return value | byte << shift

    def part(self) -> bytes:
        """Read bytes preceded by their number."""
        size = self.whole()
        self.at += size
        return self.text[self.at - size : self.at]


def _sections(text: bytes) -> dict[int, bytes]:
    """The sections of an object file that a module of version 1 keeps: relocations and symbols are for linkers."""
    reader, found = _Reader(text, at=8), dict[int, bytes]()
    while reader.at < len(text):
        kind, part = reader.byte(), reader.part()
        if _Section.CUSTOM < kind <= _Section.DATA:
            found[kind] = part
    return found


def _imported(text: bytes) -> dict[str, int]:
    """The names of an object's imports, each with the minimum size if it is a memory or a table."""
    reader, found = _Reader(text), dict[str, int]()
    for _ in range(reader.whole()):
        reader.part()  # the name of the module it comes from
        name, kind, least = reader.part().decode(), reader.byte(), 0
        if kind in (_Kind.TABLE, _Kind.GLOBAL):
            reader.byte()  # the type of its entries, or of its value
        if kind in (_Kind.TABLE, _Kind.MEMORY):
            limited, least = reader.byte(), reader.whole()
            if limited:
                reader.whole()
        else:
            reader.whole()  # the type of a function, or whether a global is mutable
        found[name] = least
    return found


def _leb128(value: int, last: int = 0x7F) -> bytes:
    """An unsigned integer; for a signed type the last byte is at most 0x3F."""
    out = bytearray()
    while value > last:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _exported(name: str, kind: _Kind) -> bytes:
    """The first export of this kind and name."""
    return _leb128(len(name)) + name.encode() + bytes((kind, 0))
