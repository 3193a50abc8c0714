"""What commands do first that simulate a campaign. They wait for it, so it imports little."""

from pathlib import Path

from fit.settings import Settings, settings
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cli.common import about
from lpfcosim.errors import InputError
from lpfcosim.execution import validation


def prepare(
    campaign: Path, jobs: int | None, scheduler: str | None
) -> tuple[Campaign, Settings, validation.Validation]:
    """Read a campaign that is to be simulated, validate it, and read what it says of the fit.

    Raises
    ------
    InputError
        If it is wrong or cannot be simulated, or both processes and a cluster are to do the work.
    """
    if jobs and scheduler:
        raise InputError("--jobs, --scheduler: expected one of them; a cluster has as many workers as it has")
    plan = loading.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    with about(campaign):
        found = validation.validate(plan)
    return plan, chosen, found
