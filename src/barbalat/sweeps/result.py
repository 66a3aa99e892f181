"""A finished sweep: its columns, and their evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from barbalat import validate
from barbalat.judge.judged import CLASSES
from barbalat.judge.verdict import Class
from barbalat.sweeps.audit import Audit
from barbalat.sweeps.chunks import Rows
from barbalat.sweeps.evidence import DIVERGED, DIVERGES, EXAMINED, NOT_SETTLED, Evidence
from barbalat.sweeps.plan import Plan
from barbalat.sweeps.study import FINER_BY, OSCILLATED, SETTLED, VERDICT
from barbalat.validate import Array

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


DID = {str(Class.CYCLE): "in a limit cycle"}
"""Words for classes whose names read badly after a number."""


def _are_settings(paths: Sequence[str]) -> bool:
    """Whether all these paths are settings of a design and not numbers of the plant."""
    return all(path.startswith(("observer.", "baseline.")) for path in paths)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SweepResult:
    """The metrics of all members and their evaluation.

    resumed     number of members found in the store
    seconds     time for everything that was simulated in this call
    redesigned  the designs that are repeated for each member, by the paths on which they depend
    of_the_design  the varied paths of the plant and of parameters that are not simulated, because [truth] has separate numbers
    redesign    whether redesigning was requested
    audit       the effect of a finer step on the verdicts of some members
    member_steps  solver steps of all members simulated in this call, over all controllers; 0 with a tolerance
    """

    case: str
    controllers: tuple[str, ...]
    plan: Plan
    rows: Rows
    evidence: Evidence
    redesigned: Mapping[str, tuple[str, ...]]
    of_the_design: tuple[str, ...]
    redesign: bool
    audit: Audit
    resumed: int
    seconds: float
    member_steps: float

    def __len__(self) -> int:
        return len(self.plan)

    def __repr__(self) -> str:
        diverged = ", ".join(f"{name} {share.count}" for name, share in self.evidence.shares["diverged"].items())
        varied = ", ".join(map(str, self.plan.paths))
        return f"<SweepResult {self.case!r}: {validate.counted(len(self), 'member')} over {varied}; diverged: {diverged}>"

    @property
    def judged(self) -> bool:
        """Whether the members have verdicts; an old store, written before runs were judged, has none."""
        return f"{self.controllers[0]}/{VERDICT}" in self.rows.names

    @property
    def sentences(self) -> dict[str, str]:
        """The results of the members, keyed by controller: "58 of 100 members follow, 40 in a limit cycle, 2 off"; empty without
        verdicts."""
        found, shares = {}, self.evidence.shares
        for name in self.controllers if self.judged else ():
            counts = {str(kind): shares[kind][name].count for kind in Class if name in shares.get(kind, {})}
            unsettled = shares[NOT_SETTLED][name].count
            said = [f"{count} {DID.get(kind, kind)}" for kind, count in counts.items() if count]
            follow = len(self) - sum(counts.values()) - unsettled
            said = [f"follow{'s' if follow == 1 else ''}", *said] + ([f"{unsettled} not settled"] if unsettled else [])
            found[name] = f"{follow} of {validate.counted(len(self), 'member')} {', '.join(said)}"
        return found

    @property
    def unsettled(self) -> dict[str, str]:
        """The reasons why members are not settled, keyed by controller."""
        found = {}
        for name in self.controllers if self.judged else ():
            needed = self.column(f"{name}/{FINER_BY}")[self.column(f"{name}/{SETTLED}") != 1]
            finite = needed[np.isfinite(needed)]
            infinite = "have an oscillation that no step tried resolves"
            if self.audit.tolerance:
                infinite = "stall: no step is short enough where their motion slides along a jump. Give simulation.dt"
            factors = " to ".join(f"{factor:g}" for factor in np.unique([finite.min(), finite.max()])) if len(finite) else ""
            why = {
                f"need a step {factors} times smaller, which was too expensive or did not settle them": len(finite),
                infinite: int(np.isinf(needed).sum()),
                "have too many states for monitoring their oscillations": int(np.isnan(needed).sum()),
            }
            if len(needed):
                found[name] = ", ".join(f"{count} {one}" for one, count in why.items() if count)
        return found

    def kind_of(self, controller: str, member: int) -> Class:
        """The judge's class of one member."""
        return CLASSES[int(self.column(f"{controller}/{VERDICT}")[member])]

    @property
    def redesign_notes(self) -> list[str]:
        """Sentences on which designs change between members."""
        by_design: dict[tuple[str, ...], list[str]] = {}
        for path, designs in self.redesigned.items():
            by_design.setdefault(designs, []).append(path)
        return [
            f"{', '.join(designs)} {'are' if len(designs) > 1 else 'is'} designed again for each member, from its own "
            f"{', '.join(paths)}"
            f": this sweep tries many designs{'' if _are_settings(paths) else self._on_plants(paths)}"
            for designs, paths in by_design.items()
        ]

    def _on_plants(self, paths: Sequence[str]) -> str:
        if set(paths) <= set(self.of_the_design):
            others = (path for path in self.plan.paths if str(path) not in self.of_the_design)
            varies = any(path.keys[0] in ("plant", "parameters", "truth") for path in others)
            return f", each on the {'' if varies else 'one '}plant of [truth]"
        alone = "; without --redesign only the simulated plant varies" if self.redesign else ""
        return f", each on its own plant, and not one design on many plants{alone}"

    def column(self, name: str) -> Array:
        """(M,) a column by its name in a store, in the order of the member numbers: ``plant.theta[0]``, ``L1/max_abs_e[0]``."""
        if name not in self.rows.names:
            raise validate.unknown_name("column", name, self.rows.names)
        return self.rows.column(name)

    def to_pandas(self) -> pd.DataFrame:
        """A row for each member; NaN for a missing metric."""
        validate.require_extra("pandas", "tables", "to_pandas")
        import pandas as pd

        return pd.DataFrame({name: self.rows.column(name) for name in self.rows.names}).set_index("member")

    def plot(self) -> Figure:
        """Histograms of the largest errors with the guaranteed bounds, as a Matplotlib figure."""
        from barbalat.sweeps.picture import histograms

        return histograms(self, shown=True)

    def as_json(self) -> dict[str, Any]:
        """The document of ``sweep --json``."""
        found = self.evidence
        return {
            "case": self.case,
            "members": len(self),
            "resumed": self.resumed,
            "design": self.plan.as_json(),
            "metrics": {name: {c: one.as_json() for c, one in by.items()} for name, by in found.metrics.items()},
            "shares": {name: {c: one.as_json() for c, one in by.items()} for name, by in found.shares.items()},
            "examined": {DIVERGED: {"what": DIVERGES}, OSCILLATED: {"what": EXAMINED, "not_examined": found.unexamined}},
            "sentences": self.sentences,
            "unsettled": self.unsettled,
            "redesign": self.redesign,
            "redesigned": {path: list(designs) for path, designs in self.redesigned.items()},
            "audit": self.audit.as_json(),
            "sensitivity": [one.as_json() for one in found.sensitivities],
            "notes": found.notes,
            "intervals": found.intervals,
            "bound_filled": {c: one.as_json() for c, one in found.filled.items()},
        }
