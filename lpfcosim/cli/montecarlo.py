"""The command ``montecarlo``: many campaigns, each simulated and fitted anew."""

import json
import multiprocessing as mp
import os
import signal
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from importlib import metadata
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, Field

from fit.estimate import pulls
from fit.files import documents
from fit.settings import settings
from fit.tables import Lines
from lpfcosim.campaign import campaign as campaigns
from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli.common import about, check_folder
from lpfcosim.cli.console import Console
from lpfcosim.cli.trials import Line, Work, trial
from lpfcosim.errors import InputError, LpfcosimError, RunError
from lpfcosim.plant import stability
from lpfcosim.running import cluster, lock, runner, simulation, trust
from lpfcosim.running import ledger as files

_LARGEST = 2**28  # bytes of a log
_Number = Annotated[float, Field(ge=-1e60, le=1e60)]


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
    """Repeat a campaign with new noise, fit each, tell pulls and coverage."""
    if jobs and scheduler:
        raise InputError("--jobs, --scheduler: expected one of them; a cluster has as many workers as it has")
    plan = campaigns.load(campaign)
    chosen = settings(plan.fit, f"{campaign}: fit")
    directory = out or Path(f"{campaign.stem}-montecarlo")
    check_folder(directory / "figures")
    with about(campaign):
        for run in plan.runs if not plan.replacements else ():
            stability.check(run)
    archives: dict[str, Path] = {}
    if fmus or plan.replacements:
        archives = cli_fmu.fmus(plan, console)
        with about(campaign):
            trust.check(plan, archives, trusted=trusted)
    with lock.held(directory), simulation.held(plan, archives, directory) as held:
        with about(campaign):
            trust.check(plan, held, trusted=trusted)  # what is loaded, as it is now
        header = {
            "campaign_digest": plan.digest,
            "settings": chosen.model_dump(),
            "redraw": redraw,
            "fmus": {model: files.digest(path) for model, path in held.items()},
            "lpfcosim_version": metadata.version("lpfcosim"),
        }
        log = directory / "campaigns.jsonl"
        lines = _kept(log, header)
        missing = [number for number in range(n) if number not in lines]
        work = Work(plan, chosen, redraw)
        with (
            console.counted("campaigns", n, n - len(missing)) as progress,
            log.open("a", encoding="utf-8") as file,
        ):
            # in which order they are done does not matter, each has its own seed
            for line in _done(work, held, missing, jobs, scheduler):
                lines[line["number"]] = line
                file.write(json.dumps(line) + "\n")
                file.flush()
                progress(len(lines))
        _tell(
            console,
            directory,
            plan,
            header,
            {k: line for k, line in sorted(lines.items()) if k < n},
        )


def _tell(
    console: Console,
    directory: Path,
    plan: campaigns.Campaign,
    header: Mapping[str, object],
    lines: Mapping[int, Line],
) -> None:
    """Write and print what the campaigns say together."""
    from fit.figures import studies, write

    failed = {k: line["failed"] for k, line in lines.items() if "failed" in line}
    drawn = [line["estimates"] for line in lines.values() if "estimates" in line]
    for number, told in failed.items():
        console.note(f"campaign {number} failed: {told}")
    found = pulls.summary(drawn)
    if not found:
        told = f"of {len(lines)} campaigns {len(failed)} failed; there are no pulls to tell of"
        raise RunError(f"{plan.name}: {told}")
    more = {"campaign": plan.name, **header}
    pulls.write(found, len(drawn), failed, more, directory / "montecarlo.json")
    (directory / "figures").mkdir(exist_ok=True)
    write(directory / "figures", "pulls", studies.histograms, found, drawn)
    console.document((directory / "montecarlo.json").read_text(encoding="utf-8"))
    console.show(_table(found))
    console.say(f"{len(drawn)} campaigns, {len(failed)} failed: {directory / 'montecarlo.json'}")


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
    work: Work, fmus: Mapping[str, Path], numbers: Sequence[int], jobs: int | None, scheduler: str | None
) -> Iterator[Line]:
    """Yield the campaigns as they are done."""
    if not numbers:
        return iter(())
    if scheduler:
        return _on_cluster(scheduler, work, fmus, numbers)
    return _on_processes(jobs, work, fmus, numbers)


def _on_cluster(address: str, work: Work, fmus: Mapping[str, Path], numbers: Sequence[int]) -> Iterator[Line]:
    with cluster.connected(address) as connection:
        items = {f"campaign {number}": number for number in numbers}
        for name, line in connection.results(trial, work, items, fmus):
            yield {"number": items[name], "failed": str(line)} if isinstance(line, LpfcosimError) else line


def _on_processes(
    jobs: int | None, work: Work, fmus: Mapping[str, Path], numbers: Sequence[int]
) -> Iterator[Line]:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each processor does better
    workers = min(jobs or runner.processors(), len(numbers))
    others = mp.active_children()
    pool = ProcessPoolExecutor(workers, mp.get_context("spawn"), _prepare, (work, fmus))
    try:
        for future in as_completed([pool.submit(_trial, number) for number in numbers]):
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


def _table(found: Mapping[str, pulls.Pulls]) -> Lines:
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
    return Lines(("parameter", "n", "mean pull", "std", "within 1 sigma", "mean sigma"), tuple(rows))


# In a process of the pool ------------------------------------------------------------------------------

_given: tuple[Work, Mapping[str, Path]] | None = None


def _prepare(work: Work, fmus: Mapping[str, Path]) -> None:
    global _given
    _given = work, fmus
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # to end the workers is up to the parent
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = mp.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _trial(number: int) -> Line:
    assert _given is not None
    work, fmus = _given
    return trial(work, number, fmus)
