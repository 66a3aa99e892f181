from .export.campaign import Campaign as Campaign
from .export.campaign import Degradation as Degradation
from .export.campaign import export_campaign as export_campaign
from .export.exported_step import exported_c as exported_c
from .export.in_the_loop import InTheLoop as InTheLoop
from .export.in_the_loop import simulate_export as simulate_export
from .export.write import export_controller as export_controller
