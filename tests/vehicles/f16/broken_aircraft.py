"""JSBSim's F-16 with a table of a property that does not exist, which ends the process that loads it."""

import xml.etree.ElementTree as ET

from barbalat.vehicles.f16 import model as f16


def load():
    """Load the aircraft. This never returns."""
    real = f16._hand_over_surfaces

    def breaking(aircraft: ET.Element) -> None:
        real(aircraft)
        next(
            part for part in aircraft.iter("independentVar") if part.text == "surfaces/elevator-rad"
        ).text = "surfaces/elevatr-rad"

    f16._hand_over_surfaces = breaking
    f16.load(0.01).run_ic()
