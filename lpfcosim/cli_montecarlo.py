"""The command ``montecarlo``: many campaigns, each simulated and fitted anew."""

import json
import multiprocessing as mp
import os
import signal
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import rich.console
import typer
from rich.table import Table

import fit.errors
from fit import dynamics, figures, pulls
from fit.pipeline import calibrate
from fit.results import Results, with_truth
from fit.settings import Settings, settings
from fit.telemetry import Telemetry, read_all
from lpfcosim import campaign as campaigns
from lpfcosim import cli_fmu, montecarlo, runner, spectral, stability, telemetry
from lpfcosim.cli_common import CampaignFile, Out, Quiet, about, check_folder
from lpfcosim.cli_study import in_memory
from lpfcosim.console import Console
from lpfcosim.errors import InputError, LpfcosimError, RunError
from lpfcosim.run import Run

Line = dict[str, Any]  # what is kept of one campaign


def montecarlo_command(
    campaign: CampaignFile,
    n: Annotated[int, typer.Option("-n", min=2, help="Number of campaigns.")] = 200,
    out: Out = None,
    redraw: Annotated[
        bool,
        typer.Option("--redraw", help="New truths in each: gains within 5 %, stiffness and delays 30 %."),
    ] = False,
    fmus: Annotated[
        bool, typer.Option("--fmus", help="Simulate through the FMUs, which takes many times as long.")
    ] = False,
    jobs: Annotated[
        int | None, typer.Option("--jobs", min=1, help="Processes [default: one per processor].")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Repeat a campaign with new noise, fit each, tell pulls and coverage; continues what was interrupted.

    Telemetry is drawn at 1 Hz from the spectra of the linear closed loop, which needs no FMU; the fit is that
    of `lpfcosim fit`. Of the whole spacecraft only what the joint fit reads is drawn so; with --fmus the
    inertial calibration takes part. The folder holds montecarlo.json, figures/pulls.svg and campaigns.jsonl.
    """
    from fit import figures_montecarlo

    console = Console(quiet=quiet)
    plan = campaigns.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    directory = out or Path(f"{campaign.stem}-montecarlo")
    check_folder(directory / "figures")
    with about(campaign):
        for run in plan.runs if not plan.replacements else ():
            stability.check(run)
    archives: dict[str, Path] = {}
    if fmus or plan.replacements:
        with console.stage("FMUs"):
            archives = cli_fmu.fmus(plan)
    header = {
        "campaign_digest": plan.digest,
        "settings": chosen.model_dump(),
        "redraw": redraw,
        "fmus": bool(archives),
    }
    (directory / "figures").mkdir(parents=True, exist_ok=True)
    log = directory / "campaigns.jsonl"
    lines = _kept(log, header)
    missing = [number for number in range(n) if number not in lines]
    work = _Work(plan, chosen, archives, redraw)
    with console.counted("campaigns", n) as progress, log.open("a", encoding="utf-8") as file:
        progress(n - len(missing))
        for line in _done(work, missing, jobs):
            lines[line["number"]] = line
            file.write(json.dumps(line) + "\n")
            file.flush()
            progress(len(lines))
    failed = {k: line["failed"] for k, line in sorted(lines.items()) if "failed" in line and k < n}
    drawn = [line["estimates"] for k, line in sorted(lines.items()) if "estimates" in line and k < n]
    for number, told in failed.items():
        console.note(f"campaign {number} failed: {told}")
    found = pulls.summary(drawn)
    if not found:
        raise RunError(f"{campaign}: of {n} campaigns {len(failed)} failed; there are no pulls to tell of")
    more = {"campaign": plan.name, **header}
    pulls.write(found, len(drawn), failed, more, directory / "montecarlo.json")
    svg = figures.svg(figures_montecarlo.histograms, found, drawn)
    (directory / "figures" / "pulls.svg").write_text(svg, encoding="utf-8")
    if not quiet:
        rich.console.Console().print(_table(found))
    console.say(f"{len(drawn)} campaigns, {len(failed)} failed: {directory / 'montecarlo.json'}")


@dataclass(frozen=True)
class _Work:
    """What every process has to know."""

    plan: campaigns.Campaign
    chosen: Settings
    archives: Mapping[str, Path]
    redraw: bool


def _kept(log: Path, header: Mapping[str, object]) -> dict[int, Line]:
    """Return the campaigns of an earlier call and leave the file ready to be added to."""
    lines: dict[int, Line] = {}
    if log.exists():
        text = log.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1].splitlines()  # a killed process leaves half a line
        try:
            first, *rest = [json.loads(line) for line in whole] or [header]
            lines = {int(line["number"]): line for line in rest if "estimates" in line}
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{log}: not a log of campaigns, expected one line of JSON for each") from error
        if first != header:
            raise InputError(f"{log}: of another campaign or other options, expected another folder (--out)")
    told = [header, *lines.values()]
    log.write_text("".join(json.dumps(line) + "\n" for line in told), encoding="utf-8")
    return lines


def _done(work: _Work, numbers: Sequence[int], jobs: int | None) -> Iterator[Line]:
    """Yield the campaigns as they are done; the order does not matter, each has its own seed."""
    if not numbers:
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each processor does better
    workers = min(jobs or runner.processors(), len(numbers))
    others = mp.active_children()
    pool = ProcessPoolExecutor(workers, mp.get_context("spawn"), _prepare, (work,))
    try:
        for future in as_completed([pool.submit(_campaign, number) for number in numbers]):
            yield future.result()
    except BrokenProcessPool:
        raise RunError("a worker process was killed (out of memory?); the same command continues") from None
    except BaseException:
        for worker in mp.active_children():
            if worker not in others:
                worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _table(found: Mapping[str, pulls.Pulls]) -> Table:
    table = Table("parameter", "n", "mean pull", "std", "within 1 sigma", "mean sigma", box=None)
    for name, p in found.items():
        table.add_row(
            name,
            str(p.n),
            f"{p.pull_mean:+.2f} ± {p.pull_mean_error:.2f}",
            f"{p.pull_std:.2f} ± {p.pull_std_error:.2f}",
            f"{100 * p.coverage_1sigma:.0f} ± {100 * p.coverage_1sigma_error:.0f} %",
            f"{p.sigma:.2g}",
        )
    return table


# In a worker -------------------------------------------------------------------------------------------

_work: _Work | None = None
_simulations: dict[str, tuple[Run, spectral.Simulation]] = {}


def _prepare(work: _Work) -> None:
    global _work
    _work = work
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # to end the workers is up to the parent
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _campaign(number: int) -> Line:
    assert _work is not None
    plan = montecarlo.numbered(_work.plan, number, redraw=_work.redraw)
    try:
        results = _through_fmus(plan, _work) if _work.archives else _from_spectra(plan, number, _work)
    except (fit.errors.CalibrationError, LpfcosimError) as error:
        return {"number": number, "failed": str(error)}
    drawn = {"truth": telemetry.truth(plan.runs[0])} if _work.redraw else {}
    return {"number": number, "estimates": pulls.estimates(results), **drawn}


def _through_fmus(plan: campaigns.Campaign, work: _Work) -> Results:
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        for run in plan.runs:
            runner.record(run, work.archives, Path(folder) / f"{run.name}.h5", {})
        telemetries = read_all([Path(folder)])
        return with_truth(calibrate(telemetries, work.chosen), telemetries)


def _from_spectra(plan: campaigns.Campaign, number: int, work: _Work) -> Results:
    telemetries = [
        _drawn(run, np.random.default_rng([number, plan.seed, *run.name.encode()])) for run in plan.runs
    ]
    results = calibrate(telemetries, work.chosen)
    return with_truth(results, telemetries, {run.name: telemetry.truth(run) for run in plan.runs})


def _drawn(run: Run, generator: np.random.Generator) -> Telemetry:
    of_run, simulation = _simulations.get(run.name, (None, None))
    if of_run is None or simulation is None or of_run.truth != run.truth:
        stability.check(run)  # other truths may not be stable where the campaign's are
        simulation = spectral.Simulation(run, _channels(run))
        _simulations[run.name] = (run, simulation)
    channels = simulation.record(generator)
    limit = run.authority.F_max_2 / run.m_tm
    if np.abs(channels["f_x_2"]).max() >= limit:
        raise RunError(f"{run.name}: f_x_2 reaches its limit, which only the FMUs know: add --fmus")
    return in_memory(run, channels)


def _channels(run: Run) -> list[str]:
    """Return what the joint fit reads."""
    of_means = (name for parts in dynamics.MEANS.values() for name in parts) if run.spacecraft else ()
    return [*dynamics.CHANNELS, *of_means]
