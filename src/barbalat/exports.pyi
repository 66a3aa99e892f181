from .export.exported_step import exported_c as exported_c
from .export.in_the_loop import InTheLoop as InTheLoop
from .export.in_the_loop import simulate_export as simulate_export
from .export.write import export_controller as export_controller
