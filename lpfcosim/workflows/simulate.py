"""A campaign simulated into a folder: through the FMUs, or from the equations of their models."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

from fit.telemetry import root_attributes
from lpfcosim.campaign import Campaign, loading
from lpfcosim.cosim import compatibility
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import Provenance, results_folder, runner, telemetry_file, validation
from lpfcosim.execution import fmus as archives
from lpfcosim.linear import ClosedLoop, saturation
from lpfcosim.messages import grouped
from lpfcosim.models import model_of
from lpfcosim.signals import decimation
from lpfcosim.spacecraft import Run
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, resolve
from lpfcosim.workflows.fmus import campaign_fmus
from lpfcosim.workflows.progress import LOG, Progress

MODEL_EQUATIONS = "model equations"  # attribute simulated_by of telemetry that no FMU made


def simulate(
    campaign: CampaignLike,
    folder: PathLike,
    *,
    fmus: bool = True,
    jobs: int | None = None,
    trusted: bool = False,
    progress: Progress = LOG,
) -> list[Path]:
    """Simulate a campaign into ``folder/telemetry``, one file per run. Files that exist are kept.

    The campaign and third-party FMUs beside it make it a folder that `lpfcosim reproduce` takes; a campaign
    that was changed in Python cannot be written.

    Parameters
    ----------
    campaign : Campaign or path
        What to simulate.
    folder : path
        ``fit.load(folder)`` reads the telemetry.
    fmus : bool
        False: from the equations of the same models, without FMU and compiler; the same to 1e-9 of
        each channel's rms.
    jobs : int, optional
        Number of processes, by default one per processor. A script needs ``if __name__ == "__main__":``
        around the call, as with `multiprocessing`.
    trusted : bool
        Let FMUs run that are not built here and not approved (``lpfcosim trust``). They are native code.
    progress : Progress, optional
        By default warnings are logged by the logger ``lpfcosim``.

    Returns
    -------
    list of Path
        The files, in the order of the campaign.

    Raises
    ------
    InputError, RunError
        If `check` would refuse the campaign (but runs may be short), or the folder holds telemetry of another
        one; if a run failed, after the others are finished.
    """
    plan, source = resolve(campaign)
    directory = as_path(folder, "the path of a folder")
    with prefix_errors(source):
        validated = validation.validate(plan, fitted=False)
    if not fmus:
        return _simulate_reference_plant(plan, directory, validated, progress)
    paths = campaign_fmus(plan, progress)
    options = runner.RunOptions(jobs)
    with results_folder.lock(directory):
        simulated = simulate_fmus(
            plan, source, directory, paths, options, validated, progress, trusted=trusted
        )
    if simulated.failures:
        raise RunError("; ".join(failure_causes(simulated)))
    return list(simulated.files.values())


def simulate_fmus(
    plan: Campaign,
    source: Path | None,
    directory: Path,
    fmus: Mapping[str, Path],
    options: runner.RunOptions,
    validated: validation.Validation,
    progress: Progress,
    *,
    trusted: bool,
) -> runner.SimulationResult:
    """Simulate a campaign into a locked folder, which then holds all that it takes to do it again.

    `source` is the file of the campaign, if it has one; the folder is locked by `results_folder.lock`.
    """

    def begin(provenance: Provenance) -> None:
        for name in ("results.json", "report.html") if options.rerun else ():
            (directory / name).unlink(missing_ok=True)
        third_party = {r.model: copies[r.model] for r in plan.replacements}
        _write_campaign(plan, directory, third_party, provenance, progress)

    with ExitStack() as stack:
        with prefix_errors(source):
            copies = stack.enter_context(archives.snapshot(plan, fmus, directory, trusted=trusted))
        for line in _describe_replacements(plan, validated):
            progress.note(line)
        for line in validated.warnings:
            progress.warn(line)
        advance, skip = stack.enter_context(progress.samples({r.name: r.n_samples for r in plan.runs}))
        listener = runner.ProgressCallbacks(advance, skip, progress.note, begin)
        simulated = runner.simulate(plan, directory / "telemetry", copies, options, listener)
    if saturated := runner.saturated_samples(simulated.files.values()):
        counts = ", ".join(f"{n} samples of {name}" for name, n in saturated.items())
        progress.warn(f"a command is at its limit, which the fit masks: {counts}")
    return simulated


def failure_causes(simulated: runner.SimulationResult) -> list[str]:
    """Return one sentence for each cause of failed runs."""
    return grouped((name, str(error)) for name, error in simulated.failures.items())


def _write_campaign(
    plan: Campaign,
    directory: Path,
    fmus: Mapping[str, Path],
    provenance: Provenance,
    progress: Progress,
) -> None:
    """Write the campaign and its third-party FMUs to the folder, if its file describes it as it is."""
    path = directory / results_folder.CAMPAIGN
    described = fmus.keys() <= plan.tables.get("fmus", {}).keys()
    if described:
        results_folder.write_provenance(directory, plan.tables, fmus, provenance.fmus)
        try:
            described = loading.load(path).digest == plan.digest
        except InputError:  # a campaign without a file
            described = False
    if not described:
        path.unlink(missing_ok=True)
        progress.note(f"{path}: not written, as the campaign was changed in Python")


def _describe_replacements(plan: Campaign, validated: validation.Validation) -> Iterator[str]:
    """Yield what there is to know of third-party FMUs in the loop."""
    run = plan.runs[0]
    by_model = {interface.model: interface for interface in validated.interfaces}
    for replacement in plan.replacements:
        interface = by_model[replacement.model]
        ignored = interface.ignored
        used = ", ".join(name for name in interface.settings if name not in ignored) or "no parameter"
        unused = f"; not {', '.join(ignored)}" if ignored else ""
        yield f"{replacement.model}: {replacement.archive}, a third-party FMU; takes {used}{unused}"
    if plan.replacements:
        yield "stability and saturation are not checked beforehand, as its dynamics are not known"
    if unknown := sorted(
        model_of(run).unknown_truths(run, compatibility.ignored_names(validated.interfaces))
    ):
        yield f"true values not known, left out of /truth: {', '.join(unknown)}"


def _simulate_reference_plant(
    plan: Campaign, directory: Path, validated: validation.Validation, progress: Progress
) -> list[Path]:
    for warning in validated.warnings:
        progress.warn(warning)
    if plan.replacements:
        models = ", ".join(f"fmus.{r.model}" for r in plan.replacements)
        raise InputError(f"{models}: a third-party FMU, expected fmus=True where a campaign names one")
    provenance = Provenance.of(plan, {}, MODEL_EQUATIONS)
    paths = [directory / "telemetry" / f"{run.name}.h5" for run in plan.runs]
    with results_folder.lock(directory):
        (directory / "telemetry").mkdir(exist_ok=True)
        for run, path in zip(plan.runs, paths, strict=True):
            if not path.exists():
                _record(run, path, provenance)
                continue
            attributes = root_attributes(path)
            if attributes is None or provenance.mismatch(attributes):
                raise InputError(
                    f"{path}: telemetry of something else, expected another folder or none there"
                )
        _write_campaign(plan, directory, {}, provenance, progress)
    return paths


def _record(run: Run, path: Path, provenance: Provenance) -> None:
    simulated = ClosedLoop(run).simulate()
    channels = {name: simulated[name] for name in model_of(run).record}
    with telemetry_file.create(path, run, channels, provenance.attributes()) as writer:
        for block in decimation.decimate(run, [channels]):
            writer.append(block)
        if saturated := saturation.count(run, channels):
            writer.annotate("saturated_samples", saturated)
