"""A module of standard Gaussian numbers from Philox counters: the stream that ``np.random.Philox`` and the list ndtri also give.

Philox4x64-10: Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC'11. Each row of numbers begins
with a new count; counts begin with 1, as NumPy's do, and their upper 192 bits are zero.
"""

from __future__ import annotations

from barbalat.lowering.llvm.printer import constant, definitions
from barbalat.lowering.wasm.module import module

ENTRY = "barbalat_normal"
NUMBERS_PER_COUNT = 4
ROUNDS = 10
MULTIPLIERS = 0xD2E7470EE14C6C93, 0xCA5A826395121157
WEYL = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B
"""The increments of the two halves of the key from round to round: the golden ratio and sqrt(3) - 1, in 64 bits."""
UNUSED_BITS = 11
"""Number of unused bits of 64. The other bits are an integer in a double, to which half a unit is added so that the result is
never 0."""

_HIGH_HALF = """
; the upper 64 bits of the product of two 64-bit integers, computed by halves (Knuth, Seminumerical Algorithms, 4.3.1)
define internal i64 @high_half(i64 %a, i64 %b) noinline {
  %a.low = and i64 %a, 4294967295
  %a.high = lshr i64 %a, 32
  %b.low = and i64 %b, 4294967295
  %b.high = lshr i64 %b, 32
  %lowest = mul i64 %a.low, %b.low
  %carried = lshr i64 %lowest, 32
  %cross = mul i64 %a.high, %b.low
  %middle = add i64 %cross, %carried
  %middle.low = and i64 %middle, 4294967295
  %middle.high = lshr i64 %middle, 32
  %crossed = mul i64 %a.low, %b.high
  %all.middle = add i64 %crossed, %middle.low
  %all.carried = lshr i64 %all.middle, 32
  %highest = mul i64 %a.high, %b.high
  %so.far = add i64 %highest, %middle.high
  %value = add i64 %so.far, %all.carried
  ret i64 %value
}"""


def normal_module(channels: int) -> bytes:
    """Its function ``barbalat_normal(seed, member, first, rows, out)`` writes rows of ``channels`` numbers, one after another."""
    counts = -(-channels // NUMBERS_PER_COUNT)
    lines = [
        f"define void @{ENTRY}(i64 %seed, i64 %member, i64 %first, i64 %rows, ptr %out) {{",
        "entry:",
        f"  %count.0 = mul i64 %first, {counts}",
        "  br label %row",
        "row:",
        "  %r = phi i64 [ 0, %entry ], [ %r.next, %row ]",
        f"  %to.0 = mul i64 %r, {channels}",
        f"  %more = mul i64 %r, {counts}",
        "  %count = add i64 %count.0, %more",
    ]
    for k in range(counts):
        lines += _drawn(f"d{k}", k, min(NUMBERS_PER_COUNT, channels - k * NUMBERS_PER_COUNT))
    lines += [
        "  %r.next = add i64 %r, 1",
        "  %again = icmp ult i64 %r.next, %rows",
        "  br i1 %again, label %row, label %exit",
        "exit:",
        "  ret void",
        "}",
        _HIGH_HALF,
    ]
    functions, declared = definitions(["ndtri"], 1)
    return module("\n".join([*lines, *functions, *sorted(declared)]), ENTRY)


def _drawn(name: str, k: int, numbers: int) -> list[str]:
    """The numbers of a row that follow from its ``k``-th counter value, stored in their places; ``name`` is the prefix of value
    names."""
    lines, words = [f"  %{name} = add i64 %count, {k + 1}"], [f"%{name}", "0", "0", "0"]
    for i in range(ROUNDS):
        more, words = _round(f"{name}.{i}", words, i)
        lines += more
    for j, word in enumerate(words[:numbers]):
        at = f"%{name}.{j}"
        lines += [
            f"  {at}.bits = lshr i64 {word}, {UNUSED_BITS}",
            f"  {at}.whole = sitofp i64 {at}.bits to double",
            f"  {at}.middle = fadd double {at}.whole, 0.5",
            f"  {at}.uniform = fmul double {at}.middle, {constant(2.0**-53)}",
            f"  {at}.value = call double @barbalat.ndtri(double {at}.uniform)",
            f"  {at}.index = add i64 %to.0, {k * NUMBERS_PER_COUNT + j}",
            f"  {at}.to = getelementptr double, ptr %out, i64 {at}.index",
            f"  store double {at}.value, ptr {at}.to, align 8",
        ]
    return lines


def _round(name: str, words: list[str], i: int) -> tuple[list[str], list[str]]:
    """words = [high(M1 w2) ^ w1 ^ key0, low(M1 w2), high(M0 w0) ^ w3 ^ key1, low(M0 w0)]."""
    lines, after = [], []
    for factor, multiplied, mixed, key, half in ((1, 2, 1, "seed", 0), (0, 0, 3, "member", 1)):
        at = f"%{name}.{key}"
        lines += [
            f"  {at}.high = call i64 @high_half(i64 {MULTIPLIERS[factor]}, i64 {words[multiplied]})",
            f"  {at}.key = add i64 %{key}, {i * WEYL[half] % 2**64}",
            f"  {at}.mixed = xor i64 {words[mixed]}, {at}.key",
            f"  {at}.word = xor i64 {at}.high, {at}.mixed",
            f"  {at}.low = mul i64 {words[multiplied]}, {MULTIPLIERS[factor]}",
        ]
        after += [f"{at}.word", f"{at}.low"]
    return lines, after
