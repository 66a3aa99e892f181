"""Rewrites an operation list for speed; the result is the same list for every target, lane width and thread.

The order of a sum and the position of a fused multiply-add determine the last bit of a result. Both are therefore fixed only
here, and no target may change them. This makes runs bit-identical.

A sum or product of many terms is associated in the order in which its terms become available. A time step is one long chain of
dependent operations, so a term that is available late should be followed by as few operations as possible.
"""

from __future__ import annotations

import heapq
import math

from barbalat.lowering.operations import Operation, Program

# Latencies in cycles, rounded, of a current x86-64 core (Fog, "Instruction tables"); only their order matters.
LATENCY = {
    "add": 3, "sub": 3, "mul": 3, "fma": 4, "div": 13, "sqrt": 18, "fmin": 2, "fmax": 2, "le": 3, "if_else_zero": 2,
    "not": 0, "neg": 0, "constant": 0, "input": 0,
}  # fmt: skip
DEFAULT_LATENCY = 3

PARAMETERS = 2
"""The index of a step function's argument that contains the parameters, which are constant from step to step."""


def optimize(program: Program, *, fused: bool = True) -> Program:
    """Recover selections, share reciprocals, associate sums and products by availability, fuse multiply-adds, remove dead
    operations.

    Without ``fused``, for targets that have no fused multiply-add, every product is rounded before it is added.
    """
    prepared = drop_dead(_share_reciprocals(_order_extrema(_recover_selections(program))))
    return drop_dead(_Associator(prepared, fused=fused).run())


def as_written(program: Program) -> Program:
    """The list in its original order, in which every operation is rounded as it would be in C."""
    return drop_dead(_order_extrema(_recover_selections(program)))


def drop_dead(program: Program) -> Program:
    """The list without operations that no output needs."""
    alive = {i for row in program.outputs for i in row}
    for i in range(len(program.operations) - 1, -1, -1):
        if i in alive:
            alive.update(program.operations[i].operands)
    if len(alive) == len(program.operations):
        return program
    place: dict[int, int] = {}
    kept: list[Operation] = []
    for i, op in enumerate(program.operations):
        if i in alive:
            place[i] = len(kept)
            kept.append(Operation(op.name, tuple([place[j] for j in op.operands]), op.value, op.source, op.table))
    return Program(tuple(kept), tuple(tuple(place[i] for i in row) for row in program.outputs))


def _recover_selections(program: Program) -> Program:
    """CasADi expands if_else(c, a, b) to (c ? a : 0) + (!c ? b : 0); this restores the single selection."""
    ops = list(program.operations)
    for i, op in enumerate(ops):
        if op.name != "add":
            continue
        first, second = (ops[j] for j in op.operands)
        if first.name == second.name == "if_else_zero":
            c, n = first.operands[0], second.operands[0]
            if ops[n].name == "not" and ops[n].operands == (c,):
                ops[i] = Operation("select", (c, first.operands[1], second.operands[1]))
            elif ops[c].name == "not" and ops[c].operands == (n,):
                ops[i] = Operation("select", (n, second.operands[1], first.operands[1]))
    return Program(tuple(ops), program.outputs)


def _order_extrema(program: Program) -> Program:
    """Put the operand that changes from step to step first, because a minimum or maximum passes on the NaN of its first
    operand."""
    ops = list(program.operations)
    fixed: list[bool] = []  # depends only on constants and parameters
    for i, op in enumerate(ops):
        is_parameter = op.name == "input" and op.source[0] == PARAMETERS
        fixed.append(op.name == "constant" or is_parameter or (op.name != "input" and all(fixed[j] for j in op.operands)))
        if op.name in ("fmin", "fmax") and fixed[op.operands[0]]:
            ops[i] = Operation(op.name, (op.operands[1], op.operands[0]))
    return Program(tuple(ops), program.outputs)


def _share_reciprocals(program: Program) -> Program:
    """a/d becomes a (1/d), one reciprocal for each divisor.

    The slow division then starts as soon as d is known, and the product fuses with an addition. The disadvantages are one more
    rounding error (1.5 units in the last place instead of 0.5), and an overflow for |d| < 5.6e-309.
    """
    ops: list[Operation] = []
    place: list[int] = []
    reciprocals: dict[int, int] = {}
    for op in program.operations:
        operands = tuple([place[j] for j in op.operands])
        if op.name == "div":
            numerator, divisor = operands
            if divisor not in reciprocals:
                ops += [Operation("constant", (), 1.0), Operation("div", (len(ops), divisor))]
                reciprocals[divisor] = len(ops) - 1
            ops.append(Operation("mul", (numerator, reciprocals[divisor])))
        else:
            ops.append(Operation(op.name, operands, op.value, op.source, op.table))
        place.append(len(ops) - 1)
    return Program(tuple(ops), tuple(tuple(place[i] for i in row) for row in program.outputs))


class _Associator:
    """Rebuilds the list front to back; ``ready[i]`` is the cycle at which new operation i is available."""

    def __init__(self, program: Program, *, fused: bool) -> None:
        self.fused = fused
        self.old = program.operations
        self.outputs = program.outputs
        self.uses = [0] * len(self.old)
        for op in self.old:
            for j in op.operands:
                self.uses[j] += 1
        for row in self.outputs:
            for j in row:
                self.uses[j] += 1
        self.user_kind = {j: _kind(op) for op in self.old for j in op.operands}
        self.new: list[Operation] = []
        self.ready: list[int] = []
        self.known: dict[Operation, int] = {}
        self.place: dict[int, int] = {}

    def run(self) -> Program:
        for i, op in enumerate(self.old):
            if not self._is_part_of_larger(i):
                self.place[i] = self._build(i, op)
        return Program(tuple(self.new), tuple(tuple(self.place[i] for i in row) for row in self.outputs))

    def _is_part_of_larger(self, i: int) -> bool:
        """Whether the operation is built together with its user: a sum used only by one sum, or a product used only by one sum or
        product."""
        if self.uses[i] != 1:
            return False
        kind = _kind(self.old[i])
        user = self.user_kind.get(i)
        return (kind == "sum" and user == "sum") or (kind == "product" and user in ("sum", "product"))

    def _build(self, i: int, op: Operation) -> int:
        kind = _kind(op)
        if kind == "sum":
            return self._sum(self._terms(i))
        if kind == "product":
            return self._emit("mul", *self._two_factors(self._factors(i)))
        return self._emit(op.name, *(self.place[j] for j in op.operands), value=op.value, source=op.source)

    def _emit(self, name: str, *operands: int, value: float = 0.0, source: tuple[int, int] = (0, 0)) -> int:
        op = Operation(name, operands, value, source)
        # -0.0 == 0.0 and NaN != NaN as dictionary keys: constants are keyed by their text instead
        key = op if name != "constant" else Operation(f"constant {value!r}")
        if key not in self.known:
            self.known[key] = len(self.new)
            self.new.append(op)
            start = max((self.ready[j] for j in operands), default=0)
            self.ready.append(start + LATENCY.get(name, DEFAULT_LATENCY))
        return self.known[key]

    def _terms(self, top: int) -> list[tuple[int, int]]:
        """The signed terms (sign, old position) of the sum that ends in ``top``, in order."""
        terms, stack = [], [(1, top)]
        while stack:
            sign, i = stack.pop()
            op = self.old[i]
            if i != top and not (_kind(op) == "sum" and self._is_part_of_larger(i)):
                terms.append((sign, i))
                continue
            signs = {"add": (sign, sign), "sub": (sign, -sign), "neg": (-sign,)}[op.name]
            stack += reversed(list(zip(signs, op.operands, strict=True)))
        return terms

    def _factors(self, top: int) -> list[int]:
        """The new positions of the factors of the product that ends in ``top``, in order."""
        factors, stack = [], [top]
        while stack:
            i = stack.pop()
            if i != top and not (self.old[i].name == "mul" and self._is_part_of_larger(i)):
                factors.append(self.place[i])
            else:
                stack += reversed(self.old[i].operands)
        return factors

    def _two_factors(self, factors: list[int]) -> tuple[int, int]:
        """Multiply the factors, the earliest first, until two are left; constants become one constant."""
        constant = math.prod(self.new[j].value for j in factors if self.new[j].name == "constant")
        queue = [(self.ready[j], j) for j in factors if self.new[j].name != "constant"]
        if len(queue) < len(factors):
            j = self._emit("constant", value=constant)
            queue.append((0, j))
        if len(queue) == 1:
            queue.append((0, self._emit("constant", value=1.0)))
        heapq.heapify(queue)
        while len(queue) > 2:
            (_, a), (_, b) = heapq.heappop(queue), heapq.heappop(queue)
            c = self._emit("mul", a, b)
            heapq.heappush(queue, (self.ready[c], c))
        (_, a), (_, b) = heapq.heappop(queue), heapq.heappop(queue)
        return a, b

    def _sum(self, terms: list[tuple[int, int]]) -> int:
        """Add the terms, the earliest first; a term that is a product may be fused with its addition."""
        queue: list[tuple[int, int, int, tuple[int, ...]]] = []  # (ready, tie-break, sign, one value or two factors)
        for order, (sign, i) in enumerate(terms):
            if self.old[i].name == "mul" and self._is_part_of_larger(i):
                pair = self._two_factors(self._factors(i))
                term = pair if self.fused else (self._emit("mul", *pair),)
                queue.append((max(self.ready[j] for j in term), order, sign, term))
            else:
                queue.append((self.ready[self.place[i]], order, sign, (self.place[i],)))
        heapq.heapify(queue)
        order = len(queue)
        while len(queue) > 1:
            early, late = heapq.heappop(queue), heapq.heappop(queue)
            sign, i = self._add(early[2:], late[2:])
            heapq.heappush(queue, (self.ready[i], order, sign, (i,)))
            order += 1
        _, _, sign, value = queue[0]
        i = value[0] if len(value) == 1 else self._emit("mul", *value)
        return i if sign > 0 else self._emit("neg", i)

    def _add(self, early: tuple[int, tuple[int, ...]], late: tuple[int, tuple[int, ...]]) -> tuple[int, int]:
        """One addition of two signed terms -> (sign, position). The product that is available later is fused."""
        if len(late[1]) == 1 and len(early[1]) == 2:
            early, late = late, early
        (early_sign, early_value), (late_sign, late_value) = early, late
        addend = early_value[0] if len(early_value) == 1 else self._emit("mul", *early_value)
        if len(late_value) == 2:
            name = "fma" if early_sign == late_sign else "fnma"  # fnma(a, b, c) = c - a b
            return early_sign, self._emit(name, *late_value, addend)
        if early_sign == late_sign:
            return early_sign, self._emit("add", addend, late_value[0])
        return early_sign, self._emit("sub", addend, late_value[0])


def _kind(op: Operation) -> str:
    if op.name in ("add", "sub", "neg"):
        return "sum"
    return "product" if op.name == "mul" else "other"
