"""Variable-step members of a batch. Each member is observed at the nodes of its motion."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from barbalat.run.engine.engine import Batch, Group
from barbalat.run.engine.motion import Motion, Nodes
from barbalat.run.kernel.metrics import Metrics
from barbalat.solvers.simulation import Simulation
from barbalat.validate import Array


@dataclass(eq=False)
class ObservedBatch(Batch):
    """Members, each observed at the nodes of its motion.

    remembered  number of entries that the kernel's state has after the judge's memory
    stalled     (M,) whether no step was short enough for the member, in its run or in the continuation by the judge
    """

    remembered: int = 0
    stalled: Array = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.stalled = np.zeros(self.states.shape[1], dtype=bool)

    def metrics(self, simulation: Simulation) -> Metrics:
        """See ``Batch.metrics``; the divergence time is that of the motion."""
        motions = [group.motion for group in self.groups if isinstance(group, ObservedGroup) and group.motion is not None]
        ended = [motion.t if motion.diverged else np.nan for motion in motions]
        return replace(super().metrics(simulation), diverged_at=np.array(ended))

    def _unjudged(self, width: int) -> list[Array]:
        return [*super()._unjudged(width), np.zeros((self.remembered, width))]


@dataclass(eq=False)
class ObservedGroup(Group):
    """The only member of an observed batch, with the motion that continues after its run."""

    motion: Motion | None = None

    @classmethod
    def of(cls, group: Group, motion: Motion) -> ObservedGroup:
        """The group that continues with this motion."""
        given = {name: getattr(group, name) for name in Group.__dataclass_fields__}
        return cls(**given, motion=motion)

    def at_end(self) -> Array:
        """See ``Group.at_end``: the motion includes a sample that is due at the end, which affects only extrema."""
        assert self.motion is not None
        state = super().at_end()
        state[: len(self.motion.x), 0] = self.motion.x
        return state

    def independent_copy(self) -> ObservedGroup:
        """See ``Group.independent_copy``."""
        assert self.motion is not None
        return replace(self, state=self.at_end(), motion=self.motion.copied())

    def held_rows(self, simulation: Simulation, step: int, steps: int, values: Array) -> Array:
        """See ``Group.held_rows``."""
        assert self.motion is not None
        self.motion = self.motion.held(values, float(simulation.time(step + steps)))
        nodes = Nodes(self.motion, simulation, (), step, step + steps, held=values)
        return nodes.rows(step, step + steps, 1 << 62)[0]
