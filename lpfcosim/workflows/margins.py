"""How far every control loop of a campaign is from instability."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from fit.errors import shown
from fit.files import closest_match
from fit.parallel import one_blas_thread
from fit.tables import Table
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.linear import margins as loop_margins
from lpfcosim.linear import stability
from lpfcosim.workflows.campaigns import CampaignLike, resolve
from lpfcosim.workflows.result import WorkflowResult

SCHEMA = "lpf-margins/1"
HEAD = ("loop", "crossover", "phase margin", "gain margin")


@dataclass(frozen=True, repr=False)
class Margins(WorkflowResult):
    """The margins of the control loops, each with all others closed; index it by the name of a loop.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    loops : tuple of Margin
        ``loop``, ``unity_gain`` [Hz], ``phase_margin`` [deg] and ``gain_margin`` [dB] of each.
    """

    campaign: str
    loops: tuple[loop_margins.Margin, ...]

    def __getitem__(self, name: str) -> loop_margins.Margin:
        loops = {margin.loop: margin for margin in self.loops}
        if str(name) not in loops:
            raise InputError(f"no loop {shown(name)}{closest_match(str(name), loops)}")
        return loops[str(name)]

    def __iter__(self) -> Iterator[loop_margins.Margin]:
        return iter(self.loops)

    def __len__(self) -> int:
        return len(self.loops)

    def table(self) -> Table:
        """Return a table of margins."""
        rows = [
            (
                m.loop,
                f"{1e3 * m.unity_gain:.4g} mHz",
                f"{m.phase_margin:.1f} deg",
                f"{m.gain_margin:.1f} dB",
            )
            for m in self.loops
        ]
        return Table(HEAD, tuple(rows))

    def records(self) -> list[dict[str, Any]]:
        """Return a row for each loop; the margins of a gain that is never one are NaN and infinite."""
        return [asdict(margin) for margin in self.loops]

    def loop_documents(self) -> list[dict[str, Any]]:
        """Return the loops for JSON; null where a gain is never one."""
        return [
            {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in record.items()}
            for record in self.records()
        ]

    def document(self) -> dict[str, Any]:
        """Return the content of `to_json`, schema ``lpf-margins/1``."""
        return {"schema": SCHEMA, "campaign": self.campaign, "loops": self.loop_documents()}


@one_blas_thread
def margins(campaign: CampaignLike) -> Margins:
    """Compute unity gain, phase margin and gain margin of every control loop.

    Parameters
    ----------
    campaign : Campaign or path
        The loops are those of its first run.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong, or a loop is unstable.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        validation.check_linear_model(plan, "margins are")
        stability.check(plan.runs[0])
        return loop_margins_of(plan)


def loop_margins_of(plan: Campaign) -> Margins:
    """Return the margins of a campaign whose loops are stable."""
    return Margins(plan.name, tuple(loop_margins.margins(plan.runs[0])))
