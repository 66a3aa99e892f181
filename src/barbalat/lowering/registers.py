"""Orders independent operations so that few values are live at once, for kernels that advance many members.

Such a kernel has two vectors for every value of a step, and a value without a register is stored and loaded again. Only the order
changes: every operation keeps its operands, so all bits stay the same.
"""

from __future__ import annotations

import heapq

from barbalat.lowering.operations import Operation, Program


def few_waiting(program: Program, *, urgent_first: bool) -> Program:
    """The next operation is always the last user of the most operands; constants stay in memory and don't count.

    Ties are decided by the list's order or, with ``urgent_first``, by the longest chain of dependent operations: if there are
    many registers, operations on which others depend should come early.
    """
    return _reordered(program, _Chooser(program, urgent_first=urgent_first).run())


class _Chooser:
    """``unread[j]`` counts the remaining users of value j, ``missing[i]`` the operands that i still lacks."""

    def __init__(self, program: Program, *, urgent_first: bool) -> None:
        self.operations = program.operations
        self.operands = [set(op.operands) for op in self.operations]
        self.users: list[list[int]] = [[] for _ in self.operations]
        for i, operands in enumerate(self.operands):
            for j in operands:
                self.users[j].append(i)
        self.unread = [len(users) for users in self.users]
        for j in {i for row in program.outputs for i in row}:
            self.unread[j] += 1  # used by the next step
        self.missing = [len(operands) for operands in self.operands]
        self.height = self._heights() if urgent_first else [0] * len(self.operations)
        self.ready: list[tuple[int, int, int]] = []

    def _heights(self) -> list[int]:
        """The number of operations in the longest chain that starts from each operation."""
        height = [1] * len(self.operations)
        for i in reversed(range(len(self.operations))):
            for j in self.operands[i]:
                height[j] = max(height[j], height[i] + 1)
        return height

    def run(self) -> list[int]:
        order = [i for i, operands in enumerate(self.operands) if not operands]  # constants and inputs
        for i in order:
            self._hand_on(i)
        done = set(order)
        while self.ready:
            *_, i = heapq.heappop(self.ready)
            if i in done:
                continue  # an outdated entry of the heap: the operation's priority has since improved
            done.add(i)
            order.append(i)
            for j in self.operands[i]:
                self.unread[j] -= 1
                if self.unread[j] == 1:
                    for user in self.users[j]:
                        if user not in done and not self.missing[user]:
                            self._offer(user)
            self._hand_on(i)
        return order

    def _hand_on(self, i: int) -> None:
        for user in self.users[i]:
            self.missing[user] -= 1
            if not self.missing[user]:
                self._offer(user)

    def _offer(self, i: int) -> None:
        freed = sum(self.unread[j] == 1 and self.operations[j].name != "constant" for j in self.operands[i])
        heapq.heappush(self.ready, (-freed, -self.height[i], i))


def _reordered(program: Program, order: list[int]) -> Program:
    place = {old: new for new, old in enumerate(order)}
    operations = []
    for i in order:
        op = program.operations[i]
        operations.append(Operation(op.name, tuple(place[j] for j in op.operands), op.value, op.source, op.table))
    return Program(tuple(operations), tuple(tuple(place[i] for i in row) for row in program.outputs))
