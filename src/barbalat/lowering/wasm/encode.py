"""A WebAssembly module as bytes: the binary format of the core specification, version 1 (chapter 5), as far as loops need it."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum


class Type(IntEnum):
    """The types of values that WebAssembly knows."""

    I32 = 0x7F
    I64 = 0x7E
    F64 = 0x7C


class Do(IntEnum):
    """Instructions without immediate values."""

    END = 0x0B
    SELECT = 0x1B
    I32_EQZ = 0x45
    I32_ADD = 0x6A
    I32_MUL = 0x6C
    I32_AND = 0x71
    I32_OR = 0x72
    I32_WRAP_I64 = 0xA7
    I64_EQZ = 0x50
    I64_LT_U = 0x54
    I64_ADD = 0x7C
    I64_SUB = 0x7D
    I64_MUL = 0x7E
    I64_DIV_U = 0x80
    I64_REM_U = 0x82
    I64_AND = 0x83
    I64_OR = 0x84
    I64_XOR = 0x85
    I64_SHL = 0x86
    I64_SHR_U = 0x88
    I64_EXTEND_I32_U = 0xAD
    I64_REINTERPRET_F64 = 0xBD
    F64_EQ = 0x61
    F64_NE = 0x62
    F64_LT = 0x63
    F64_GT = 0x64
    F64_LE = 0x65
    F64_ABS = 0x99
    F64_NEG = 0x9A
    F64_CEIL = 0x9B
    F64_FLOOR = 0x9C
    F64_SQRT = 0x9F
    F64_ADD = 0xA0
    F64_SUB = 0xA1
    F64_MUL = 0xA2
    F64_DIV = 0xA3
    F64_COPYSIGN = 0xA6
    F64_CONVERT_I32_U = 0xB8
    F64_CONVERT_I64_S = 0xB9
    F64_REINTERPRET_I64 = 0xBF


EMPTY = 0x40
"""The type of a block without a result."""
DOUBLE_BYTES = 8
_DOUBLES_ALIGNED = 3  # as a power of two
_PAGE_BYTES = 65_536


def unsigned(value: int) -> bytes:
    """A whole number from 0 on, in unsigned LEB128."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def signed(value: int) -> bytes:
    """LEB128 with a sign."""
    out = bytearray()
    while not -0x40 <= value < 0x40:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value & 0x7F)
    return bytes(out)


def vector(parts: Sequence[bytes]) -> bytes:
    """Their number and the parts."""
    return unsigned(len(parts)) + b"".join(parts)


def _name(text: str) -> bytes:
    return unsigned(len(text.encode())) + text.encode()


@dataclass(eq=False)
class Code:
    """A function's instructions and its local variables, of which the arguments are the first."""

    arguments: tuple[Type, ...]
    result: Type | None = None
    locals: list[Type] = field(default_factory=list)
    body: bytearray = field(default_factory=bytearray)

    def local(self, kind: Type = Type.F64) -> int:
        """A new local variable."""
        self.locals.append(kind)
        return len(self.arguments) + len(self.locals) - 1

    def do(self, *instructions: Do) -> None:
        self.body += bytes(instructions)

    def get(self, *places: int) -> None:
        for place in places:
            self.body += b"\x20" + unsigned(place)

    def set(self, place: int) -> None:
        self.body += b"\x21" + unsigned(place)

    def tee(self, place: int) -> None:
        """Set it and leave the value on the stack."""
        self.body += b"\x22" + unsigned(place)

    def i32(self, value: int) -> None:
        self.body += b"\x41" + signed(value)

    def i64(self, value: int) -> None:
        self.body += b"\x42" + signed(value)

    def f64(self, value: float) -> None:
        self.body += b"\x44" + struct.pack("<d", value)

    def load(self, entry: int = 0) -> None:
        """The double that stands so many doubles behind the address on the stack."""
        self.body += b"\x2b" + unsigned(_DOUBLES_ALIGNED) + unsigned(entry * DOUBLE_BYTES)

    def store(self, entry: int = 0) -> None:
        """Likewise, of the address and the value on the stack."""
        self.body += b"\x39" + unsigned(_DOUBLES_ALIGNED) + unsigned(entry * DOUBLE_BYTES)

    def load_whole(self) -> None:
        """The 64-bit whole number at the address on the stack."""
        self.body += b"\x29" + unsigned(_DOUBLES_ALIGNED) + unsigned(0)

    def begin_loop(self) -> None:
        self.body += bytes((0x03, EMPTY))

    def begin_if(self, kind: Type | None = None) -> None:
        self.body += bytes((0x04, EMPTY if kind is None else kind))

    def otherwise(self) -> None:
        self.body.append(0x05)

    def end(self) -> None:
        """Of a loop or a branch."""
        self.body.append(Do.END)

    def again_if(self) -> None:
        """To the start of the innermost loop, where the condition on the stack holds."""
        self.body += b"\x0d\x00"

    def call(self, function: int) -> None:
        self.body += b"\x10" + unsigned(function)

    def whole_of_double(self) -> None:
        """i32.trunc_sat_f64_s: a trap for no number."""
        self.body += b"\xfc\x02"

    def encoded(self) -> bytes:
        groups: list[tuple[int, Type]] = []
        for kind in self.locals:
            if groups and groups[-1][1] is kind:
                groups[-1] = (groups[-1][0] + 1, kind)
            else:
                groups.append((1, kind))
        text = vector([unsigned(count) + bytes((kind,)) for count, kind in groups]) + bytes(self.body) + bytes((Do.END,))
        return unsigned(len(text)) + text


def module(functions: Sequence[Code], exports: Iterable[tuple[str, int]], data: bytes) -> bytes:
    """A module with a memory of its own, which holds ``data`` from address 0 on, and the functions exported by their names."""
    types = [_type(code) for code in functions]
    different = list(dict.fromkeys(types))
    pages = -(-len(data) // _PAGE_BYTES) or 1
    named = [_name("memory") + b"\x02\x00", *(_name(name) + b"\x00" + unsigned(place) for name, place in exports)]
    sections = [
        (1, vector(different)),
        (3, vector([unsigned(different.index(kind)) for kind in types])),
        (5, vector([b"\x00" + unsigned(pages)])),
        (7, vector(named)),
        (10, vector([code.encoded() for code in functions])),
    ]
    if data:
        sections.append((11, vector([b"\x00\x41\x00\x0b" + unsigned(len(data)) + data])))
    return b"\x00asm\x01\x00\x00\x00" + b"".join(bytes((i,)) + unsigned(len(text)) + text for i, text in sections)


def _type(code: Code) -> bytes:
    results = () if code.result is None else (code.result,)
    return b"\x60" + vector([bytes((kind,)) for kind in code.arguments]) + vector([bytes((kind,)) for kind in results])
