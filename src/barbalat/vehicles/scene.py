"""Flights in space as data: the position and attitude of each vehicle. ``film`` and ``picture`` draw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from barbalat.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Mover:
    """The flight of a vehicle at the instants of the scene, up to its loss.

    label     the controller's name
    colour    from the palette, as in the other pictures
    path      (K, 3), in the scene's unit
    attitude  (K, 3, 3), whose columns are the body's axes
    lost      whether control was lost at the end
    """

    label: str
    colour: int
    path: Array
    attitude: Array
    lost: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A scene at a number of instants.

    unit    the unit of all lengths
    t       (K,) the instants [s]
    target  (K, 3) the commanded position; None if no position is commanded
    movers  the vehicles
    wire    the vehicle's frame: lines (P, 3) in the body's axes, of size 1
    fails   the time of the failure [s]
    failing whether there is a failure
    equal   whether all axes have the same scale, which is impossible for a flight of miles at one height
    """

    title: str
    unit: str
    t: Array
    target: Array | None
    movers: tuple[Mover, ...]
    wire: tuple[Array, ...]
    fails: float
    failing: bool = True
    equal: bool = True

    @property
    def box(self) -> tuple[Array, Array]:
        """The smallest and largest coordinates of the vehicles that kept control, or of all vehicles if none did. Each span is at
        least 1."""
        kept = [one.path for one in self.movers if not one.lost] or [one.path for one in self.movers]
        points = np.vstack([*kept, *([] if self.target is None else [self.target])])
        low, high = points.min(axis=0), points.max(axis=0)
        wider = np.maximum(0.55 * (high - low), 0.5)
        if self.equal:
            wider = np.maximum(wider, 0.35 * wider.max())
        middle = 0.5 * (low + high)
        return middle - wider, middle + wider


def attitudes(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Return the attitudes (K, 3, 3) for angles [deg] about the forward, left and up axes, applied in the order yaw, pitch,
    roll."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll]), degrees=True).as_matrix())
