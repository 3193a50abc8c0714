"""A campaign simulated into a folder: through the FMUs, or from the equations of their models."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from fit.parallel import one_blas_thread
from lpfcosim.campaign import Campaign
from lpfcosim.cosim import ignored_names
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import results_folder, runner, validation
from lpfcosim.messages import grouped
from lpfcosim.modelica import build
from lpfcosim.models import model_of
from lpfcosim.spacecraft import H
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, as_path, is_described_by_file, resolve
from lpfcosim.workflows.progress import LOG, Progress, check_options


@one_blas_thread
def simulate(
    campaign: CampaignLike,
    folder: PathLike,
    *,
    fmus: bool = True,
    jobs: int | None = None,
    rerun: bool = False,
    trusted: bool = False,
    progress: Progress = LOG,
) -> list[Path]:
    """Simulate a campaign into ``folder/telemetry``, one file per run. Files that exist are kept.

    The campaign and third-party FMUs are written too, so that the folder can be made again; a
    campaign that was changed in Python cannot be written.

    Parameters
    ----------
    campaign : Campaign or path
        What to simulate.
    folder : path
        ``fit.load(folder)`` reads the telemetry.
    fmus : bool
        False: from the equations of the models, without a compiler; the same to 1e-9 of each rms.
    jobs : int, optional
        Number of processes, by default one per processor.
    rerun : bool
        Simulate again what was simulated with another campaign, seed, version or FMU.
    trusted : bool
        Let third-party FMUs run, which are native code.
    progress : Progress, optional
        By default warnings are logged by the logger ``lpfcosim``.

    Returns
    -------
    list of Path
        The files, in the order of the campaign.

    Raises
    ------
    InputError, RunError
        If `check` would refuse the campaign (but runs may be short), or the folder holds other telemetry; if
        a run failed, after the others are finished.
    """
    check_options(progress, fmus=fmus, rerun=rerun, trusted=trusted)
    plan, source = resolve(campaign)
    directory = as_path(folder, "the path of a folder")
    with prefix_errors(source):
        validated = validation.validate(plan, fitted=False)
    if plan.replacements and not fmus:
        models = ", ".join(f"fmus.{r.model}" for r in plan.replacements)
        raise InputError(f"{models}: a third-party FMU, expected fmus=True where a campaign names one")
    paths = campaign_fmus(plan, progress) if fmus else {}
    options = runner.RunOptions(jobs, rerun=rerun)
    with results_folder.lock(directory):
        runs = simulate_into(plan, source, directory, paths, options, validated, progress, trusted=trusted)
    if runs.failures:
        raise RunError("; ".join(failure_causes(runs)))
    return list(runs.files.values())


def campaign_fmus(plan: Campaign, progress: Progress) -> dict[str, Path]:
    """Return the FMUs of a campaign by model: the user's, and ours in the other places, built if need be."""
    return archives.resolve_fmus(plan, lambda models: build_fmus(models, progress))


def build_fmus(models: Sequence[str], progress: Progress) -> dict[str, Path]:
    """Build FMUs that are not in the cache."""
    with progress.counted("FMUs", len(models)) as advance:
        return build.build(models, on_progress=advance)


def simulate_into(
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
    Without `fmus`, the equations of the models are evaluated.
    """

    def begin() -> None:
        for name in ("results.json", "report.html") if options.rerun else ():
            (directory / name).unlink(missing_ok=True)
        third_party = {r.model: copies[r.model] for r in plan.replacements}
        _write_campaign(plan, source, directory, third_party, progress)

    hours = {run.name: run.n_samples * H / 3600 for run in plan.runs}
    done = dict.fromkeys(hours, 0.0)  # of the runs that are simulated now

    def on_existing(name: str) -> None:
        del done[name]
        progress.note(f"run {name}: kept")

    def on_progress(name: str, n_samples: int) -> None:
        done[name] = n_samples * H / 3600
        advance(sum(done.values()), sum(hours[simulated] for simulated in done))
        if done[name] == hours[name]:
            progress.note(f"run {name}: {hours[name]:.3g} h")

    with ExitStack() as stack:
        with prefix_errors(source):
            copies = stack.enter_context(archives.snapshot(plan, fmus, directory, trusted=trusted))
        for line in _describe_replacements(plan, validated):
            progress.note(line)
        for line in validated.warnings:
            progress.warn(line)
        advance = stack.enter_context(progress.counted("simulation", sum(hours.values()), unit="h"))
        listener = runner.ProgressCallbacks(on_progress, on_existing, progress.note, begin)
        simulated = runner.simulate(plan, directory / "telemetry", copies, options, listener)
    if saturated := runner.saturated_samples(simulated.files.values()):
        counts = ", ".join(f"{n} samples of {name}" for name, n in saturated.items())
        progress.warn(f"a command is at its limit, which the fit masks: {counts}")
    return simulated


def failure_causes(simulated: runner.SimulationResult) -> list[str]:
    """Return one sentence for each cause of failed runs."""
    return grouped((name, str(error)) for name, error in simulated.failures.items())


def _write_campaign(
    plan: Campaign, source: Path | None, directory: Path, fmus: Mapping[str, Path], progress: Progress
) -> None:
    """Write the campaign and its third-party FMUs to the folder, if its file describes it as it is."""
    path = directory / results_folder.CAMPAIGN
    if source or is_described_by_file(plan):
        results_folder.write_provenance(directory, plan.tables, fmus)
    else:
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
        yield f"{replacement.model}: {replacement.path}, a third-party FMU; takes {used}{unused}"
    if plan.replacements:
        yield "stability and saturation are not checked beforehand, as its dynamics are not known"
    if unknown := sorted(model_of(run).unknown_truths(run, ignored_names(validated.interfaces))):
        yield f"true values not known, left out of /truth: {', '.join(unknown)}"
