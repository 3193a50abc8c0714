"""When the runs of a campaign take place: none may reach into the next."""

from datetime import datetime, timedelta

from fit.errors import quote
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError
from lpfcosim.spacecraft import FS

TIME_STEP = 60.0  # s, of which a run has a whole number
HOUR = 3600.0


def check_schedule(plan: Campaign) -> Campaign:
    """Return a campaign whose runs follow each other.

    Raises
    ------
    InputError
        If one would reach into the next.
    """
    for previous, run in zip(plan.runs[:-1], plan.runs[1:], strict=True):
        end = datetime.fromisoformat(previous.t0) + timedelta(seconds=previous.n_samples / FS)
        if datetime.fromisoformat(run.t0) < end:
            raise InputError(
                f"design.hours: experiment {quote(previous.experiment)} would reach into "
                f"{quote(run.experiment)}, which has a start t0 of its own"
            )
    return plan
