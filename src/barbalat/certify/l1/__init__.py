"""L1 norms with guaranteed enclosures; ball arithmetic by python-flint (Arb)."""

from barbalat.certify.l1.enclosure import Enclosure, float_above, float_below
from barbalat.certify.l1.norm import l1_norm

__all__ = ["Enclosure", "float_above", "float_below", "l1_norm"]
