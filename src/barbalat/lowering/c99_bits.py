"""Operations on the bits of a number as C99 functions, without undefined behaviour: ``memcpy`` is how C reads bits."""

from __future__ import annotations

from barbalat.lowering.functions.formats import SINGLE, Format

_EXPONENT = """\
static {real} barbalat_exponent({real} x)
{{
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    return ({real})(int{width}_t)((bits >> {stored}) & {exponents}U) - {bias};
}}
"""
_SIGNIFICAND = """\
static {real} barbalat_significand({real} x)
{{
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits = (bits & UINT{width}_C(0x{fraction:0{digits}x})) | UINT{width}_C(0x{one:0{digits}x});
    memcpy(&x, &bits, sizeof bits);
    return x;
}}
"""
_POW2 = """\
static {real} barbalat_pow2({real} k)
{{
    {real} x = k + {aligned}; /* 2^{stored} + {largest}: k with its bias stands in the last bits */
    uint{width}_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits <<= {stored};
    memcpy(&x, &bits, sizeof bits);
    return x;
}}
"""
OF_BITS = {"exponent": _EXPONENT, "significand": _SIGNIFICAND, "pow2": _POW2}


def of_bits(name: str, real: str, suffix: str, of: Format) -> str:
    """C source of one of OF_BITS on numbers of this type."""
    width, stored = (32 if of is SINGLE else 64), of.bits - 1
    return OF_BITS[name].format(
        real=real,
        width=width,
        digits=width // 4,
        stored=stored,
        largest=of.largest_exponent,
        exponents=2 * of.largest_exponent + 1,
        bias=f"{of.largest_exponent:.1f}{suffix}",
        fraction=2**stored - 1,
        one=of.largest_exponent << stored,
        aligned=f"{of.aligned:.1f}{suffix}",
    )
