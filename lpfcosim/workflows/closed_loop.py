"""The closed loop of one run of a campaign, to linearise or to simulate."""

from fit.errors import shown
from fit.files import closest_match
from lpfcosim.errors import InputError, prefix_errors
from lpfcosim.execution import validation
from lpfcosim.linear import ClosedLoop
from lpfcosim.workflows.campaigns import CampaignLike, resolve


def closed_loop(campaign: CampaignLike, run_name: str) -> ClosedLoop:
    """Return the closed loop of a run, from the equations of its models.

    Parameters
    ----------
    campaign : Campaign or path
        The campaign.
    run_name : str
        Name of the run, which for an experiment is that of its run with injections.

    Raises
    ------
    UnavailableError
        If the campaign has a third-party FMU in the loop.
    InputError
        If the campaign is wrong or has no such run.
    """
    plan, source = resolve(campaign)
    with prefix_errors(source):
        validation.check_linear_model(plan, "the closed loop is")
        runs = {run.name: run for run in plan.runs}
        if str(run_name) not in runs:
            raise InputError(f"no run {shown(run_name)}{closest_match(str(run_name), runs)}")
        return ClosedLoop(runs[str(run_name)])
