"""A campaign simulated from Python: through the FMUs, as ``lpfcosim run``, or through the reference plant."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from pathlib import Path

from fit.telemetry import root_attributes
from lpfcosim.campaign import Campaign, loading
from lpfcosim.errors import InputError, RunError
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import results_folder as results
from lpfcosim.execution import runner, telemetry_file, validation
from lpfcosim.linear import saturation
from lpfcosim.messages import grouped
from lpfcosim.models import world_of
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run

_messages = logging.getLogger(__name__)

PathLike = str | os.PathLike[str]


def load_campaign(path: PathLike) -> Campaign:
    """Read a campaign.

    Raises
    ------
    InputError
        If the file cannot be read or is not a valid campaign. The message gives the place in the file.
    """
    return loading.load(Path(path))


def simulate(
    campaign: Campaign | PathLike,
    folder: PathLike,
    *,
    fmus: bool = True,
    jobs: int | None = None,
    trusted: bool = False,
) -> list[Path]:
    """Simulate a campaign into ``folder/telemetry``, one file per run. Files that exist are kept.

    The warnings that ``lpfcosim run`` prints, such as that of an FMU that is accepted because of
    ``validate = false``, are logged by the logger ``lpfcosim.api`` at level WARNING.

    Parameters
    ----------
    campaign : Campaign or path
        What to simulate.
    folder : path
        Made if need be. ``fit.load(folder)`` reads the telemetry.
    fmus : bool
        True: through the FMUs, as ``lpfcosim run``. False: through the reference plant, one run after the
        other. This needs neither FMU nor compiler, and gives the same to 1e-9 of each channel's rms.
    jobs : int, optional
        Number of processes that step the FMUs, by default one per processor. A script needs
        ``if __name__ == "__main__":`` around the call, as with `multiprocessing`.
    trusted : bool
        Let FMUs run that were not built here and that the user has not approved (``lpfcosim trust``). They
        are native code.

    Returns
    -------
    list of Path
        The files, in the order of the campaign.

    Raises
    ------
    InputError
        If the campaign is wrong or cannot be simulated, as `lpfcosim check` would say (a run may be shorter
        than a fit takes), or the folder holds telemetry of another campaign.
    RunError
        If a run failed. The others are finished first.
    """
    plan = campaign if isinstance(campaign, Campaign) else load_campaign(campaign)
    for warning in validation.validate(plan, fitted=False).warnings:
        _messages.warning("%s", warning)
    directory = Path(folder) / "telemetry"
    with results.lock(Path(folder)):
        if not fmus:
            directory.mkdir(exist_ok=True)
            return _without_fmus(plan, directory)
        with archives.snapshot(plan, archives.resolve_fmus(plan), Path(folder), trusted=trusted) as copies:
            simulated = runner.simulate(plan, directory, copies, runner.RunOptions(jobs))
    if simulated.failures:
        failures = ((name, str(error)) for name, error in simulated.failures.items())
        raise RunError("; ".join(grouped(failures)))
    return list(simulated.files.values())


def _without_fmus(plan: Campaign, directory: Path) -> list[Path]:
    if plan.replacements:
        named = ", ".join(f"fmus.{r.model}" for r in plan.replacements)
        raise InputError(f"{named}: a third-party FMU, expected fmus=True where a campaign names one")
    origin = {**runner.provenance(plan, {}), "simulated_by": "reference plant"}
    paths = []
    for run in plan.runs:
        path = directory / f"{run.name}.h5"
        if path.exists():
            found = root_attributes(path)
            if found is None or runner.provenance_mismatch(found, origin):
                raise InputError(
                    f"{path}: telemetry of something else, expected another folder or none there"
                )
        else:
            _record(run, path, origin)
        paths.append(path)
    return paths


def _record(run: Run, path: Path, origin: Mapping[str, str | int | float]) -> None:
    world = world_of(run)
    found = world.simulate(run)
    channels = {name: found[name] for name in world.record}
    with telemetry_file.create(path, run, channels, origin) as writer:
        for block in decimation.decimate(run, [channels]):
            writer.append(block)
        if saturated := saturation.count(run, channels):
            writer.annotate("saturated_samples", saturated)
