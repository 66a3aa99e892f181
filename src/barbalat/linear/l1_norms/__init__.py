"""L1 norms with guaranteed enclosures, computed in ball arithmetic with python-flint (Arb)."""

from barbalat.linear.enclosure import Enclosure, float_above, float_below
from barbalat.linear.l1_norms.norm import l1_norm

__all__ = ["Enclosure", "float_above", "float_below", "l1_norm"]
