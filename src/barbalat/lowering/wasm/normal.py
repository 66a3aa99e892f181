"""A module of standard Gaussian numbers from Philox counters: the stream that ``np.random.Philox`` and the list ndtri make.

Philox4x64-10: Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11. A row of numbers begins on a
count of its own; counts begin with 1, as NumPy's do, and their upper 192 bits are zero.
"""

from __future__ import annotations

from barbalat.lowering.wasm.encode import DOUBLE_BYTES, Code, Do, Type, module
from barbalat.lowering.wasm.functions import coded, tables_of

ENTRY = "barbalat_normal"
NUMBERS_PER_COUNT = 4
ROUNDS = 10
MULTIPLIERS = 0xD2E7470EE14C6C93, 0xCA5A826395121157
WEYL = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B
"""What the two halves of the key grow by from round to round: the golden ratio and sqrt(3) - 1, in 64 bits."""
HALF_BITS, LOW_HALF = 32, 2**32 - 1
UNUSED_BITS = 11
"""Of 64: what is left is a double's whole number, of which half a unit more is never 0."""
_NDTRI, _HIGH = range(2)  # functions of the module


def normal_module(channels: int) -> bytes:
    """Its function ``barbalat_normal(seed, member, first, rows, out)`` writes rows of so many numbers, one after another."""
    tables, data = tables_of(["ndtri"])
    free = Code((), Type.I32)
    free.i32(len(data))
    functions = [coded("ndtri", tables), _high_half(), _rows(channels), free]
    return module(functions, [(ENTRY, 2), ("free", 3)], data)


def _signed(word: int) -> int:
    """As instructions have a constant of 64 bits."""
    return word - 2**64 if word >= 2**63 else word


def _high_half() -> Code:
    """The upper 64 bits of the product of two whole numbers of 64, by halves (Knuth, Seminumerical Algorithms, 4.3.1)."""
    c = Code((Type.I64, Type.I64), Type.I64)
    a_low, a_high, b_low, b_high, middle = (c.local(Type.I64) for _ in range(5))
    for given, low, high in ((0, a_low, a_high), (1, b_low, b_high)):
        c.get(given)
        _low(c)
        c.set(low)
        c.get(given)
        _high(c)
        c.set(high)
    c.get(a_high, b_low)
    c.do(Do.I64_MUL)
    c.get(a_low, b_low)
    c.do(Do.I64_MUL)
    _high(c)
    c.do(Do.I64_ADD)
    c.set(middle)
    c.get(a_high, b_high)
    c.do(Do.I64_MUL)
    c.get(middle)
    _high(c)
    c.do(Do.I64_ADD)
    c.get(a_low, b_high)
    c.do(Do.I64_MUL)
    c.get(middle)
    _low(c)
    c.do(Do.I64_ADD)
    _high(c)
    c.do(Do.I64_ADD)
    return c


def _low(c: Code) -> None:
    c.i64(LOW_HALF)
    c.do(Do.I64_AND)


def _high(c: Code) -> None:
    c.i64(HALF_BITS)
    c.do(Do.I64_SHR_U)


def _rows(channels: int) -> Code:
    c = Code((Type.I64, Type.I64, Type.I64, Type.I64, Type.I32))
    seed, member, first, rows, out = range(5)
    count, words = c.local(Type.I64), [c.local(Type.I64) for _ in range(NUMBERS_PER_COUNT)]
    counts = -(-channels // NUMBERS_PER_COUNT)
    c.get(first)
    c.i64(counts)
    c.do(Do.I64_MUL)
    c.set(count)
    c.begin_loop()
    for place in range(0, channels, NUMBERS_PER_COUNT):
        c.get(count)
        c.i64(1)
        c.do(Do.I64_ADD)
        c.tee(count)
        c.set(words[0])
        for word in words[1:]:
            c.i64(0)
            c.set(word)
        for k in range(ROUNDS):
            _round(c, words, (seed, member), k)
        for j, word in enumerate(words[: channels - place]):
            _store(c, out, place + j, word)
    c.get(out)
    c.i32(channels * DOUBLE_BYTES)
    c.do(Do.I32_ADD)
    c.set(out)
    c.get(rows)
    c.i64(1)
    c.do(Do.I64_SUB)
    c.tee(rows)
    c.do(Do.I64_EQZ, Do.I32_EQZ)
    c.again_if()
    c.end()
    return c


def _round(c: Code, words: list[int], key: tuple[int, int], k: int) -> None:
    """words = [high(M1 w2) ^ w1 ^ key0, low(M1 w2), high(M0 w0) ^ w3 ^ key1, low(M0 w0)]."""
    for factor, multiplied, mixed, half in ((1, 2, 1, 0), (0, 0, 3, 1)):
        c.i64(_signed(MULTIPLIERS[factor]))
        c.get(words[multiplied])
        c.call(_HIGH)
        c.get(words[mixed], key[half])
        c.i64(_signed(k * WEYL[half] % 2**64))
        c.do(Do.I64_ADD, Do.I64_XOR, Do.I64_XOR)
        c.i64(_signed(MULTIPLIERS[factor]))
        c.get(words[multiplied])
        c.do(Do.I64_MUL)
    for word in reversed(words):
        c.set(word)


def _store(c: Code, out: int, entry: int, word: int) -> None:
    """Of a word's upper bits, as a number between 0 and 1."""
    c.get(out, word)
    c.i64(UNUSED_BITS)
    c.do(Do.I64_SHR_U, Do.F64_CONVERT_I64_S)
    c.f64(0.5)
    c.do(Do.F64_ADD)
    c.f64(2.0**-53)
    c.do(Do.F64_MUL)
    c.call(_NDTRI)
    c.store(entry)
