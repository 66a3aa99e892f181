"""Symbolic execution of LLVM IR without loops, on terms. Branches become choices, and memory is a table by offsets in
bytes."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field

from export.terms import Terms

SIZES = {"double": 8, "float": 4, "i64": 8, "i32": 4, "i8": 1, "i1": 1, "ptr": 8}
Value = object
"""A term's number, ("pointer", base, offset), or ("whole", number or term of truth)."""
PHI = re.compile(r"\[ (\S+), %(\w+) \]")

COMPARED = {  # ordered: false if one is NaN; unordered: the negation of the opposite
    "oeq": ("eq", 0, 0), "olt": ("lt", 0, 0), "ole": ("le", 0, 0), "ogt": ("lt", 1, 0), "oge": ("le", 1, 0),
    "une": ("eq", 0, 1), "uge": ("lt", 0, 1), "ugt": ("le", 0, 1), "ule": ("lt", 1, 1), "ult": ("le", 1, 1),
}  # fmt: skip
"""(comparison, whether the operands are exchanged, whether it is negated)."""


@dataclass
class Run:
    """Symbolic execution of the functions of one text."""

    text: str
    terms: Terms
    real: str
    values: dict[str, Value] = field(default_factory=dict)
    memory: dict[tuple[str, int], Value] = field(default_factory=dict)
    reached: dict[str, int] = field(default_factory=dict)
    edges: dict[tuple[str, str], int] = field(default_factory=dict)

    def run(self, name: str) -> None:
        """Execute from the call to the return. The arguments are pointers to different objects."""
        (arguments, body) = re.search(rf"^define [^\n]*@{name}\(([^\n]*)\)[^\n]*{{\n(.*?)^}}", self.text, re.M | re.S).groups()
        count = len(re.findall(r"%\d+", arguments))
        self.values = {f"%{i}": ("pointer", str(i), 0) for i in range(count)}
        blocks, label = {str(count): []}, str(count)
        for line in body.splitlines():
            if found := re.match(r"(\w+):", line):
                label = found[1]
                blocks[label] = []
            elif line.strip():
                blocks[label].append(re.sub(r", (align \d+|!\S+( !\d+)?)", "", line.split(";")[0]).strip())
        self.reached[str(count)] = self.terms.make("true")
        for label, lines in blocks.items():  # in topological order, as is checked
            assert label in self.reached, f"a loop, or a block out of order: {label}"
            for line in lines:
                self._line(line, label)

    def _line(self, line: str, label: str) -> None:
        if found := re.match(r"(%\w+) = (?:tail |notail |musttail )?(\w+) (.*)", line):
            self.values[found[1]] = self._value(found[2], re.sub(r"^((inbounds|nuw|nsw|noundef) )+", "", found[3]), label)
        elif found := re.match(r"br i1 (\S+), label %(\w+), label %(\w+)", line):
            condition = self._truth(found[1])
            self._edge(label, found[2], condition)
            self._edge(label, found[3], self.terms.negated(condition))
        elif found := re.match(r"br label %(\w+)", line):
            self._edge(label, found[1], self.terms.make("true"))
        elif found := re.match(r"store (\w+) (\S+), ptr (\S+)", line):
            self._store(self._read(found[1], found[2]), self.values[found[3]], label)
        else:
            assert line == "ret void" or "@llvm.lifetime" in line or "@llvm.dbg" in line, line

    def number_at(self, base: str, offset: int) -> int:
        """The term in memory at an address."""
        return self._number(self._load(self.real, ("pointer", base, offset)))

    def _edge(self, origin: str, target: str, condition: int) -> None:
        terms = self.terms
        edge = terms.both(self.reached[origin], condition)
        self.edges[origin, target] = edge
        known = self.reached.get(target)
        either = edge if known is None else terms.negated(terms.both(terms.negated(known), terms.negated(edge)))
        self.reached[target] = either

    def _store(self, value: Value, pointer: Value, label: str) -> None:
        _, base, offset = pointer
        before = self.memory.get((base, offset))
        always = self.terms.nodes[self.reached[label]] == ("true",) or before is None or not isinstance(value, int)
        self.memory[base, offset] = value if always else self.terms.chosen(self.reached[label], value, self._number(before))

    def _number(self, value: Value) -> int:
        assert isinstance(value, int)
        return value

    def _read(self, kind: str, text: str) -> Value:
        """An operand of a type."""
        if text.startswith("%"):
            return self.values[text]
        if kind in ("double", "float"):
            if text.startswith("0x"):
                return self.terms.constant(struct.unpack(">d", bytes.fromhex(text[2:].zfill(16)))[0])
            return self.terms.constant(float(text))
        return "whole", {"true": self.terms.make("true"), "false": self.terms.negated(self.terms.make("true"))}.get(text, text)

    def _truth(self, text: str) -> int:
        found = self._read("i1", text)
        return found if isinstance(found, int) else found[1]

    def _value(self, name: str, rest: str, label: str) -> Value:  # noqa: PLR0912  # one case for each instruction
        terms = self.terms
        match name:
            case "alloca":
                return "pointer", f"{label}:{len(self.values)}", 0
            case "getelementptr":
                kind, pointer, *indices = re.split(r", (?![^{]*\})", rest)
                _, base, offset = self.values[pointer.removeprefix("ptr ")]
                return "pointer", base, offset + self._offset(kind, [int(one.split()[1]) for one in indices])
            case "bitcast":
                return self.values[rest.split()[1]]
            case "load":
                found = re.match(r"(\w+), ptr (\S+)", rest)
                assert found, rest
                kind, pointer = found.groups()
                return self._load(kind, self.values[pointer])
            case "fadd" | "fmul" | "fdiv" | "fsub" | "fneg":
                kind, operands = rest.split(" ", 1)
                x = [self._number(self._read(kind, one)) for one in operands.split(", ")]
                if name == "fneg":
                    return terms.neg(x[0])
                return terms.of("add", x[0], terms.neg(x[1])) if name == "fsub" else terms.of(name[1:], *x)
            case "fcmp":
                which, kind, operands = rest.split(" ", 2)
                x = [self._number(self._read(kind, one)) for one in operands.split(", ")]
                relation, turned, denied = COMPARED[which]
                found = terms.compare(relation, *(x[::-1] if turned else x))
                return terms.negated(found) if denied else found
            case "icmp":
                which, kind, first, second = re.match(r"(eq|ne) (\w+) (\S+), (\S+)", rest).groups()
                assert second == "0"
                zero = terms.negated(self._as_truth(self._read(kind, first)))
                return zero if which == "eq" else terms.negated(zero)
            case "zext" | "sext" | "trunc":
                kind, text = rest.split(" to ", 1)[0].split(" ")
                value = self._read(kind, text)
                return ("whole", value) if isinstance(value, int) else value
            case "uitofp" | "sitofp":
                kind, text = rest.split(" to ", 1)[0].split(" ")
                assert name == "uitofp" or kind != "i1"
                return terms.chosen(self._as_truth(self._read(kind, text)), terms.constant(1.0), terms.constant(0.0))
            case "and" | "or" | "xor":
                kind, operands = rest.split(" ", 1)
                a, b = (self._as_truth(self._read(kind, one)) for one in operands.split(", "))
                found = self._logic(name, a, b)
                return found if kind == "i1" else ("whole", found)
            case "select":
                condition, kind, yes, no = re.match(r"i1 (\S+), (\w+) (\S+), \w+ (\S+)", rest).groups()
                x = [self._read(kind, one) for one in (yes, no)]
                return self._choice(self._truth(condition), kind, *x)
            case "phi":
                kind, pairs = rest.split(" ", 1)
                found = [(self._read(kind, value), self.edges[origin, label]) for value, origin in PHI.findall(pairs)]
                value = found[-1][0]
                for other, edge in found[-2::-1]:
                    value = self._choice(edge, kind, other, value)
                return value
        return self._called(rest)

    def _choice(self, condition: int, kind: str, yes: Value, no: Value) -> Value:
        terms = self.terms
        if kind in ("double", "float"):
            return terms.chosen(condition, self._number(yes), self._number(no))
        found = terms.either(condition, self._as_truth(yes), self._as_truth(no))
        return found if kind == "i1" else ("whole", found)

    def _logic(self, name: str, a: int, b: int) -> int:
        terms = self.terms
        denied = terms.negated
        if name == "xor":
            return denied(terms.both(denied(terms.both(a, denied(b))), denied(terms.both(denied(a), b))))
        return terms.both(a, b) if name == "and" else denied(terms.both(denied(a), denied(b)))

    def _as_truth(self, value: Value) -> int:
        """Whether a whole number, which is 0 or 1 here, or the freeze switch, is not zero."""
        if isinstance(value, int):
            return value
        inner = value[1]
        if isinstance(inner, int):
            return inner
        assert inner in ("0", "1", "-1"), inner
        true = self.terms.make("true")
        return true if inner != "0" else self.terms.negated(true)

    def _load(self, kind: str, pointer: Value) -> Value:
        _, base, offset = pointer
        if (base, offset) not in self.memory:
            whole = kind.startswith("i")
            first = self.terms.input(base, offset, kind="flag" if whole else "input")
            self.memory[base, offset] = ("whole", self.terms.negated(first)) if whole else first
        return self.memory[base, offset]

    def _called(self, rest: str) -> int:
        """A function of numbers."""
        name, arguments = re.search(r"@([\w.]+)\(([^)]*)\)", rest).groups()
        plain = (
            name.removeprefix("llvm.").split(".")[0].removeprefix("barbalat_").removesuffix("f" if self.real == "float" else "")
        )
        assert plain in {"fabs", "sqrt"} or name.startswith("barbalat_"), name
        x = [self._number(self._read(self.real, one.split()[-1])) for one in arguments.split(", ")]
        return self.terms.make(f"f_{plain}" if name.startswith("barbalat_") else plain, *x)

    def _offset(self, kind: str, indices: list[int]) -> int:
        total = indices[0] * self._size(kind)
        for index in indices[1:]:
            inner = self._inner(kind)
            if kind.startswith("["):
                total += index * self._size(inner[0])
                kind = inner[0]
            else:
                total, kind = total + self._starts(inner)[index], inner[index]
        return total

    def _inner(self, kind: str) -> list[str]:
        if kind.startswith("["):
            return [re.match(r"\[\d+ x (.*)\]$", kind)[1]]
        return re.search(rf"^{re.escape(kind)} = type {{ (.*) }}$", self.text, re.M)[1].split(", ")

    def _starts(self, members: list[str]) -> list[int]:
        """The offsets of the members, each a multiple of its alignment."""
        starts, at = [], 0
        for member in members:
            aligned = SIZES[re.findall(r"double|float|ptr|i\d+", member)[-1]]
            starts.append(-(-at // aligned) * aligned)
            at = starts[-1] + self._size(member)
        return starts

    def _size(self, kind: str) -> int:
        if kind in SIZES:
            return SIZES[kind]
        if kind.startswith("["):
            return int(re.match(r"\[(\d+)", kind)[1]) * self._size(self._inner(kind)[0])
        members = self._inner(kind)
        return -(-(self._starts(members)[-1] + self._size(members[-1])) // 8) * 8
