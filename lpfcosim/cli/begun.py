"""A campaign as those commands take it up that simulate it. They wait for this, so it imports little."""

from pathlib import Path

from fit.settings import Settings, settings
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli.common import about
from lpfcosim.errors import InputError
from lpfcosim.plant import stability


def begun(campaign: Path, jobs: int | None, scheduler: str | None) -> tuple[Campaign, Settings]:
    """Read a campaign that is to be simulated, and what it says of the fit.

    Raises
    ------
    InputError
        If it is wrong or a loop is unstable, or both processes and a cluster are to do the work.
    """
    if jobs and scheduler:
        raise InputError("--jobs, --scheduler: expected one of them; a cluster has as many workers as it has")
    plan = loading.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    with about(campaign):
        stability.check(*(() if plan.replacements else plan.runs))  # the poles are those of our loop
    return plan, chosen
