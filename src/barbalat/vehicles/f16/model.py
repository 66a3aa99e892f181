"""JSBSim's F-16 with surfaces that this program moves. The installed file is changed in memory and never saved.

There are three changes. The aerodynamic tables read the deflections from properties of this program (``surfaces/...``). Therefore
the actuator, its limits and the failures of a surface are modelled here, and the control system in the file does not act on the
deflections. ``BALLAST_LB`` of the empty weight becomes a separate mass at the same place, which can be moved to shift the centre
of gravity. The coefficients of ``SCALED`` are multiplied by properties of this program (``scale/...``), which are one unless the
aircraft is drawn at random.

Nothing else is changed, neither the tables nor the engine. The leading-edge flaps keep the file's schedule, which jumps at
5 deg of angle of attack.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from barbalat.validate import InputError, require_extra

if TYPE_CHECKING:
    from jsbsim import FGFDMExec

NAME = "f16"
SURFACES = ("elevator", "aileron", "rudder")
BALLAST_LB = 2000.0
"""The movable weight [lb]. It is a tenth of the aircraft's weight, about the weight of its two largest stores."""
BALLAST = 1
"""The ballast's index among the file's point masses. The pilot has index 0."""
SCALED = {
    "lift": "CLDh",
    "pitching_moment": "CmDh",
    "pitch_damping": "Cmq",
    "dihedral": "Clb",
    "roll_damping": "Clp",
    "weathercock": "Cnb",
}
"""Coefficients of the file that can be scaled, by their effect."""
REACHED_ALPHA = (-10.0, 45.0)
"""Angles of attack that the elevator's tables cover [deg]. Beyond them JSBSim holds the last value."""
LIMIT_LOADS = (-4.0, 9.0)
"""The load factor limits of the control system in the file [g]."""


def load(step: float) -> FGFDMExec:
    """Return the aircraft with its landing gear up, a constant fuel mass and this time step [s]. Raises InputError if JSBSim is
    missing or has a different F-16."""
    require_extra("jsbsim", "flight", "a flight model")
    import jsbsim

    with _patched(Path(jsbsim.get_default_root_dir())) as folder:
        fdm = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
        fdm.set_debug_level(0)
        fdm.set_aircraft_path(str(folder))
        if not fdm.load_model(NAME):
            raise InputError(
                f"JSBSim {jsbsim.__version__} cannot load the F-16 that it contains: reinstall it, pip install 'barbalat[flight]'"
            )
    fdm.set_dt(step)
    fdm["fcs/fbw-override"] = 1.0  # the control system in the file would move the flaperons
    fdm["gear/gear-cmd-norm"] = fdm["gear/gear-pos-norm"] = 0.0
    fdm["propulsion/fuel_freeze"] = 1.0
    return fdm


@contextlib.contextmanager
def _patched(root: Path) -> Iterator[Path]:
    """Provide a folder of aircraft that contains the changed F-16 while it is loaded."""
    original = root / "aircraft" / NAME
    with tempfile.TemporaryDirectory(prefix="barbalat-") as made:
        folder = Path(made) / NAME
        shutil.copytree(original, folder)
        tree = ET.parse(original / f"{NAME}.xml")
        _hand_over_surfaces(tree.getroot())
        _make_scalable(tree.getroot())
        _set_ballast_apart(tree.getroot())
        tree.write(folder / f"{NAME}.xml")
        yield Path(made)


def _hand_over_surfaces(aircraft: ET.Element) -> None:
    control, aerodynamics = _part(aircraft, "flight_control"), _part(aircraft, "aerodynamics")
    for surface in SURFACES:
        read = [part for part in aerodynamics.iter() if (part.text or "").strip() == f"fcs/{surface}-pos-rad"]
        if not read:
            raise InputError(
                f"JSBSim's F-16 no longer has aerodynamic tables of its {surface}; install the version in requirements.lock"
            )
        for part in read:
            part.text = f"surfaces/{surface}-rad"
        declared = ET.Element("property")  # an undeclared property ends the process
        declared.text = f"surfaces/{surface}-rad"
        control.insert(0, declared)


def _make_scalable(aircraft: ET.Element) -> None:
    control, aerodynamics = _part(aircraft, "flight_control"), _part(aircraft, "aerodynamics")
    for name, coefficient in SCALED.items():
        products = [
            one.find("product") for one in aerodynamics.iter("function") if one.get("name") == f"aero/coefficient/{coefficient}"
        ]
        if len(products) != 1 or products[0] is None:
            raise InputError(
                f"JSBSim's F-16 no longer has exactly one product {coefficient}; install the version in requirements.lock"
            )
        ET.SubElement(products[0], "property").text = f"scale/{name}"
        declared = ET.Element("property", value="1.0")
        declared.text = f"scale/{name}"
        control.insert(0, declared)


def _set_ballast_apart(aircraft: ET.Element) -> None:
    mass = _part(aircraft, "mass_balance")
    empty, place = _part(mass, "emptywt"), _part(mass, "location")
    empty.text = str(float(empty.text or "") - BALLAST_LB)
    ballast = ET.SubElement(mass, "pointmass", name="Ballast")
    ET.SubElement(ballast, "weight", unit="LBS").text = str(BALLAST_LB)
    ballast.append(place)


def _part(whole: ET.Element, name: str) -> ET.Element:
    found = whole.find(name)
    if found is None:
        raise InputError(f"JSBSim's F-16 no longer has <{name}>; install the version in requirements.lock")
    return found
