"""Operations on the bits of a number as C99 functions, without undefined behaviour: ``memcpy`` is how C reads bits."""

from __future__ import annotations

OF_BITS = {
    "exponent": """\
static double barbalat_exponent(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (double)(int64_t)((bits >> 52) & 2047U) - 1023.0;
}
""",
    "significand": """\
static double barbalat_significand(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits = (bits & UINT64_C(0x000fffffffffffff)) | UINT64_C(0x3ff0000000000000);
    memcpy(&x, &bits, sizeof bits);
    return x;
}
""",
    "pow2": """\
static double barbalat_pow2(double k)
{
    double x = k + 4503599627371519.0; /* 2^52 + 1023: k with its bias stands in the last bits */
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits <<= 52;
    memcpy(&x, &bits, sizeof bits);
    return x;
}
""",
}
