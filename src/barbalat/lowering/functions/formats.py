"""The two binary formats for which the functions' lists are written, with the constants that depend on the format."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True, slots=True)
class Format:
    """A binary format of IEEE 754.

    bits              of a significand, including the implicit one
    largest_exponent  largest exponent of a number; also the bias of stored exponents
    """

    bits: int
    largest_exponent: int

    @property
    def rounder(self) -> float:
        """The number whose addition and subtraction rounds a number below a third of it to a whole number, ties to even."""
        return 1.5 * 2.0 ** (self.bits - 1)

    @property
    def splitter(self) -> float:
        """Dekker's factor, which splits a significand into halves, the second one signed."""
        return 2.0 ** ((self.bits + 1) // 2) + 1

    @property
    def smallest_normal(self) -> float:
        return 2.0 ** (1 - self.largest_exponent)

    @property
    def linear_range(self) -> float:
        """The limit on |x| below which x^3/3 is less than a quarter of a unit in the last place of x."""
        return 2.0 ** -((self.bits + 1) // 2 + 1)

    @property
    def aligned(self) -> float:
        """The number such that an integer added to it appears, with the bias, in the last bits of the sum."""
        return 2.0 ** (self.bits - 1) + self.largest_exponent

    def nearest(self, value: Fraction) -> float:
        """The number of this format nearest to a value of normal size, with ties to even."""
        unit = self._unit(value, self.bits)
        return float(round(value / unit) * unit)

    def leading(self, value: Fraction, bits: int) -> float:
        """The leading ``bits`` bits of a value."""
        unit = self._unit(value, bits)
        return float(int(value / unit) * unit)

    def parted(self, value: Fraction, *bits: int) -> tuple[float, ...]:
        """A value as an exact sum of parts with these numbers of bits and a remainder."""
        parts: list[float] = []
        for count in bits:
            parts.append(self.leading(value, count))
            value -= Fraction(parts[-1])
        return (*parts, self.nearest(value))

    @staticmethod
    def _unit(value: Fraction, bits: int) -> Fraction:
        """Return the weight of the last of ``bits`` bits."""
        size, exponent = abs(value), 0
        while size >= 2:
            size, exponent = size / 2, exponent + 1
        while size < 1:
            size, exponent = size * 2, exponent - 1
        return Fraction(2) ** (exponent - bits + 1)


DOUBLE, SINGLE = Format(53, 1023), Format(24, 127)


def whole(*parts: float) -> Fraction:
    """The exact sum of the parts of a constant."""
    return sum((Fraction(part) for part in parts), Fraction(0))
