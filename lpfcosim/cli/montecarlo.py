"""The command ``montecarlo``: many campaigns, each simulated and fitted anew."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

import fit.errors
from fit.crosstalk import euler_fit
from fit.files import documents
from fit.forecasting import coverage
from fit.model import dynamics, rotation
from fit.parallel import one_blas_thread, processors, serial
from fit.pipeline import calibrate
from fit.results import Results
from fit.settings import Settings
from fit.tables import Table
from fit.telemetry import Telemetry, read_all
from lpfcosim.campaign import Campaign
from lpfcosim.campaign import montecarlo as campaign_montecarlo
from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.planned import in_memory
from lpfcosim.cli.preparation import prepare
from lpfcosim.cosim import FmuLibraryCache, SimulationProgress
from lpfcosim.errors import InputError, LpfcosimError, RunError
from lpfcosim.execution import (
    checksums,
    dask_executor,
    process_pool,
    results_folder,
    runner,
    telemetry_file,
    validation,
)
from lpfcosim.execution import fmus as fmu_archives
from lpfcosim.linear import spectral, stability
from lpfcosim.messages import grouped
from lpfcosim.models import world_of
from lpfcosim.spacecraft import Run

if TYPE_CHECKING:  # which the processes do without
    from lpfcosim.cli.console import Console

Line = dict[str, Any]  # what is kept of one campaign

_LARGEST = 2**28  # bytes of a log
_Number = Annotated[float, Field(ge=-1e60, le=1e60)]


@dataclass(frozen=True)
class Work:
    """What all campaigns have in common.

    Attributes
    ----------
    plan : Campaign
        Of number and seed, and of truths if `redraw`, it gets others.
    chosen : Settings
        Of the fit.
    redraw : bool
        Whether every campaign has truths of its own.
    """

    plan: Campaign
    chosen: Settings
    redraw: bool


def _check_spectra(plan: Campaign, found: validation.Validation, campaign: Path) -> None:
    """Refuse what telemetry that is drawn from spectra does not have."""
    with about(campaign):
        validation.check_linear_model(plan, "the spectra that telemetry is drawn from are", "add --fmus")
    if found.saturation:
        raise InputError(
            f"{campaign}: {'; '.join(found.saturation)}; expected --fmus, as telemetry drawn from spectra "
            "knows no limit"
        )
    if plan.events and plan.events.noise_drift:
        raise InputError(
            f"{campaign}: events.noise_drift: the noise drawn from spectra keeps its level; expected --fmus, "
            "or a campaign without it"
        )
    for name in plan.truth.living:
        raise InputError(
            f"{campaign}: truth.{name}: the loop behind the spectra keeps its gains; expected --fmus, or a "
            "campaign without it"
        )


def montecarlo(
    campaign: Path,
    n: int,
    out: Path | None,
    console: Console,
    *,
    redraw: bool,
    fmus: bool,
    trusted: bool,
    jobs: int | None,
    scheduler: str | None,
) -> None:
    """Repeat a campaign with new noise, fit each, report pulls and coverage."""
    directory = out or Path(f"{campaign.stem}-montecarlo")
    check_folder(directory, "figures")
    plan, chosen, found = prepare(campaign, jobs, scheduler)
    archives: dict[str, Path] = {}
    if fmus:
        archives = cli_fmu.fmus(plan, console)
    else:
        _check_spectra(plan, found, campaign)
    with results_folder.lock(directory, "--out"), ExitStack() as stack:
        with about(campaign):
            held = stack.enter_context(fmu_archives.snapshot(plan, archives, directory, trusted=trusted))
        header = {
            "campaign_digest": plan.digest,
            "settings": chosen.model_dump(),
            "redraw": redraw,
            "fmus": {model: checksums.digest(path) for model, path in held.items()},
            "lpfcosim_version": metadata.version("lpfcosim"),
        }
        log = directory / "campaigns.jsonl"
        lines = _kept(log, header)
        missing = [number for number in range(n) if number not in lines]
        work, lost = Work(plan, chosen, redraw), dict[str, str]()
        with (
            console.counted("campaigns", n, n - len(missing)) as progress,
            log.open("a", encoding="utf-8") as file,
            closing(_done(directory, work, held, missing, lost, jobs, scheduler)) as done,
        ):
            for line in done:  # in which order does not matter, each has its own seed
                lines[line["number"]] = line
                file.write(json.dumps(line) + "\n")
                file.flush()
                progress(len(lines))
        asked = {k: line for k, line in sorted(lines.items()) if k < n}
        verdict = None
        if not lost or any("estimates" in line for line in asked.values()):
            verdict = _report(console, directory, plan, header, asked, len(lost))
    if lost:
        first, *others = lost.values()
        more = f" and {len(others)} more" if others else ""
        raise RunError(f"{first}{more}; what is finished is kept, the same command continues")
    if verdict and not verdict.valid:
        raise RunError(f"{plan.name}: not valid: {'; '.join(verdict.reasons)}")


def _report(
    console: Console,
    directory: Path,
    plan: Campaign,
    header: Mapping[str, object],
    lines: Mapping[int, Line],
    lost: int,
) -> coverage.Verdict:
    """Write and print what the campaigns say together, though some are not done."""
    failed = {k: line["failed"] for k, line in lines.items() if "failed" in line}
    drawn = [line["estimates"] for line in lines.values() if "estimates" in line]
    for told in grouped(((str(number), f"failed: {why}") for number, why in failed.items()), "campaign"):
        console.note(told)
    found = coverage.summary(drawn)
    if not found:
        raise RunError(f"{plan.name}: of {len(lines)} campaigns {len(failed)} failed; there are no pulls")
    more = {"campaign": plan.name, **header}
    document = coverage.write(found, len(drawn), failed, more, directory / "montecarlo.json")
    with console.stage("figure"):
        from fit.plotting import studies, write  # takes its time

        (directory / "figures").mkdir(exist_ok=True)
        write(directory / "figures", "pulls", studies.histograms, found, drawn)
    console.document(document)
    console.show(_table(found))
    not_done = f", {lost} not done" if lost else ""
    console.say(f"{len(drawn)} campaigns, {len(failed)} failed{not_done}: {directory / 'montecarlo.json'}")
    verdict = coverage.verdict(found, len(drawn), len(failed))
    if verdict.valid:
        parameters = f"{len(found)} parameter{'s' * (len(found) > 1)}"
        console.say(f"valid: pulls and coverage of {parameters} are consistent with true sigmas")
    return verdict


class _Done(BaseModel, extra="allow", allow_inf_nan=False):
    """A line of the log about a campaign that was fitted."""

    number: Annotated[int, Field(ge=0)]
    estimates: dict[str, tuple[_Number, _Number]]


def _kept(log: Path, header: Mapping[str, object]) -> dict[int, Line]:
    """Return the campaigns of an earlier call and leave the file ready to be added to."""
    lines: dict[int, Line] = {}
    if log.exists():
        text = documents.text(log, "a log of campaigns", _LARGEST)
        whole = text[: text.rfind("\n") + 1].splitlines()  # a killed process leaves half a line
        try:
            first, *rest = [json.loads(line) for line in whole] or [header]
            done = [_Done.model_validate(line) for line in rest if "estimates" in line]
            lines = {line.number: line.model_dump() for line in done}
        except (ValueError, TypeError, RecursionError) as error:
            raise InputError(f"{log}: not a log of campaigns, expected one line of JSON for each") from error
        if first != header:
            raise InputError(f"{log}: of another campaign or other options, expected another folder (--out)")
    told = [header, *lines.values()]
    log.write_text("".join(json.dumps(line) + "\n" for line in told), encoding="utf-8")
    return lines


def _done(
    directory: Path,
    work: Work,
    fmus: Mapping[str, Path],
    numbers: Sequence[int],
    lost: dict[str, str],
    jobs: int | None,
    scheduler: str | None,
) -> Generator[Line]:
    """Yield the campaigns as they are done; say in `lost` which of them nothing is known of, and why."""
    items = {f"campaign {number}": number for number in numbers}
    setting = process_pool.WorkerConfig(partial(trial, work), directory, directory / "logs", "{}")
    for name, outcome in _outcomes(setting, work, fmus, items, jobs, scheduler) if items else ():
        if isinstance(outcome, process_pool.WorkerFailure):
            component = runner.failed_component(work.plan.runs[0], outcome)
            lost[name] = f"{name}: {component} {outcome.description}"
        elif isinstance(outcome, LpfcosimError):
            lost[name] = str(outcome)
        else:
            yield outcome
            continue
        setting.append_to_log(name, lost[name])


def _outcomes(
    setting: process_pool.WorkerConfig,
    work: Work,
    fmus: Mapping[str, Path],
    items: Mapping[str, int],
    jobs: int | None,
    scheduler: str | None,
) -> Iterator[tuple[str, Any]]:
    if scheduler:
        with dask_executor.connected(scheduler) as connection:
            yield from connection.results(trial, work, items, fmus)
        return
    tasks = {name: (number, fmus) for name, number in items.items()}
    yield from process_pool.results(setting, tasks, jobs or processors())


def _table(found: Mapping[str, coverage.Pulls]) -> Table:
    rows = [
        (
            name,
            str(p.n),
            f"{p.pull_mean:+.2f} ± {p.pull_mean_error:.2f}",
            f"{p.pull_std:.2f} ± {p.pull_std_error:.2f}",
            f"{100 * p.coverage_1sigma:.0f} ± {100 * p.coverage_1sigma_error:.0f} %",
            f"{p.sigma:.2g}",
        )
        for name, p in found.items()
    ]
    return Table(("parameter", "n", "mean pull", "std", "within 1 sigma", "mean sigma"), tuple(rows))


# In a process of its own, or of a cluster --------------------------------------------------------------


@one_blas_thread
def trial(work: Work, number: int, fmus: Mapping[str, Path], where: SimulationProgress | None = None) -> Line:
    """Simulate campaign `number`, through FMUs if there are any, and fit it.

    The same comes out in whatever process, and whatever came before in it. `where` tells when FMUs are at
    work, which alone can hang.
    """
    where = where or SimulationProgress()
    where.set_idle()
    plan = campaign_montecarlo.numbered(work.plan, number, redraw=work.redraw)
    try:
        with serial():  # a process for each processor does better
            results = (
                _through_fmus(plan, work.chosen, fmus, where) if fmus else _from_spectra(plan, number, work)
            )
    except (fit.errors.CalibrationError, LpfcosimError) as error:
        return {"number": number, "failed": str(error)}
    if results.joint and results.joint.unsound:
        return {"number": number, "failed": results.joint.unsound[0].message}
    drawn = {"truth": telemetry_file.truth(plan.runs[0])} if work.redraw else {}
    return {"number": number, "estimates": coverage.estimates(results), **drawn}


def _through_fmus(
    plan: Campaign, chosen: Settings, fmus: Mapping[str, Path], where: SimulationProgress
) -> Results:
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        with FmuLibraryCache() as shelf:
            for run in plan.runs:
                runner.write_telemetry(
                    run, fmus, Path(folder) / f"{run.name}.h5", {}, where=where, shelf=shelf
                )
                where.set_idle()
        telemetries = read_all(sorted(Path(folder).glob("*.h5")), trusted=True)
        return coverage.with_truth(calibrate(telemetries, chosen), telemetries)


def _from_spectra(plan: Campaign, number: int, work: Work) -> Results:
    if work.redraw:
        stability.check(*plan.runs)  # other truths may not be stable where the campaign's are
    telemetries = [
        _drawn(run, np.random.default_rng([number, plan.seed, *run.name.encode()])) for run in plan.runs
    ]
    results = calibrate(telemetries, work.chosen)
    return coverage.with_truth(
        results, telemetries, {run.name: telemetry_file.truth(run) for run in plan.runs}
    )


#: What the last campaign left, by run, the newest last: made anew only if more than the seed is another.
_simulations: dict[str, tuple[Run, spectral.Simulation]] = {}


def _drawn(run: Run, generator: np.random.Generator) -> Telemetry:
    of_run, simulation = _simulations.get(run.name, (None, None))
    same = of_run is not None and of_run == (run if run.events else replace(run, seed=of_run.seed))
    if simulation is None or not same:
        _simulations.pop(run.name, None)
        _, beside = next(reversed(_simulations.values()), (None, None))
        simulation = spectral.Simulation(run, _channels(run), beside)
        _simulations[run.name] = (run, simulation)
    channels = simulation.record(generator)
    limit = run.authority.F_max_2 / run.m_tm
    if np.nanmax(np.abs(channels["f_x_2"])) >= limit:
        raise RunError(f"{run.name}: f_x_2 reaches its limit, which only the FMUs know: add --fmus")
    return in_memory(run, channels)


def _channels(run: Run) -> list[str]:
    """Return what fits read of what is recorded; of the star tracker that is long noise runs alone."""
    of_means = (name for parts in dynamics.MEANS.values() for name in parts)
    turning = run.kind == "noise" and run.n_samples / run.fs >= euler_fit.MIN_DURATION
    stars = [f"ast_{axis}" for axis in rotation.AXES] if turning else []
    return [*dynamics.CHANNELS, *(name for name in (*of_means, *stars) if name in world_of(run).record)]
