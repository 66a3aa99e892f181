from .linear.enclosure import Enclosure as Enclosure
from .linear.l1_norms import l1_norm as l1_norm
from .linear.margins import Margins as Margins
from .linear.margins import margins as margins
from .linear.systems import StateSpace as StateSpace
