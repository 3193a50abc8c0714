"""A campaign repeated with new noise, and fitted each time, to test whether its uncertainties are valid."""

import json
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, Field

from fit.files import documents
from fit.forecasting import Pulls, coverage
from fit.parallel import one_blas_thread
from fit.units import concise_value
from lpfcosim.campaign import Campaign
from lpfcosim.errors import InputError, RunError, prefix_errors
from lpfcosim.execution import Tasks, Workers, checksums, results_folder, runner, validation
from lpfcosim.execution import fmus as fmu_archives
from lpfcosim.linear import ClosedLoop, saturation
from lpfcosim.messages import grouped
from lpfcosim.models import DELTA_G
from lpfcosim.workflows.campaigns import CampaignLike, PathLike, resolve
from lpfcosim.workflows.montecarlo_trial import MonteCarloTask, Record
from lpfcosim.workflows.progress import LOG, Progress
from lpfcosim.workflows.result import Columns, Result, Row
from lpfcosim.workflows.run import output_folder, validate_simulation
from lpfcosim.workflows.simulate import campaign_fmus

_THROUGH_FMUS = "expected a simulation through the FMUs (fmus)"
MAX_LOG_SIZE = 2**28  # bytes
_Number = Annotated[float, Field(ge=-1e60, le=1e60)]


@dataclass(frozen=True, repr=False)
class MonteCarlo(Result[Pulls]):
    """Pulls of many fitted campaigns; index it by the name of a parameter.

    Attributes
    ----------
    campaign : str
        Name of the campaign.
    pulls : mapping of str to Pulls
        ``pull_mean``, ``pull_std``, ``coverage_1sigma`` and their errors, by parameter.
    n : int
        Number of campaigns that were fitted.
    failures : mapping of int to str
        By number of a campaign without a sound fit, why.
    unfinished : mapping of str to str
        Campaigns that could not be simulated, and why; the same call tries them again.
    verdict : Verdict
        Whether chance explains pulls, coverage and failures.
    path : Path
        ``montecarlo.json``.
    """

    columns: ClassVar[Columns] = {
        "parameter": lambda row: row["parameter"],
        "n": lambda row: str(row["n"]),
        "mean pull": lambda row: concise_value(row["pull_mean"], row["pull_mean_error"]),
        "std": lambda row: concise_value(row["pull_std"], row["pull_std_error"]),
        "within 1 sigma": lambda row: (
            f"{concise_value(100 * row['coverage_1sigma'], 100 * row['coverage_1sigma_error'])} %"
        ),
        "mean sigma": lambda row: f"{row['sigma']:.2g}",
    }
    campaign: str
    pulls: Mapping[str, Pulls]
    n: int
    failures: Mapping[int, str]
    unfinished: Mapping[str, str]
    verdict: coverage.Verdict
    path: Path

    @property
    def entries(self) -> Mapping[str, Pulls]:
        """The pulls by parameter."""
        return self.pulls

    @property
    def notes(self) -> tuple[str, ...]:
        """How many campaigns there are, and that the uncertainties are valid if they are."""
        unfinished = f", {len(self.unfinished)} not done" if self.unfinished else ""
        count = f"{self.n} campaigns, {len(self.failures)} failed{unfinished}: {self.path}"
        parameters = f"{len(self)} parameter{'s' * (len(self) > 1)}"
        valid = f"valid: pulls and coverage of {parameters} are consistent with valid uncertainties"
        return (count, valid) if self.verdict.valid else (count,)

    def rows(self) -> list[Row]:
        """Return a row for each parameter."""
        return [{"parameter": name, **vars(pulls)} for name, pulls in self.pulls.items()]

    def to_json(self) -> str:
        """Return the content of ``montecarlo.json``, schema ``lpf-montecarlo/1``."""
        return self.path.read_text(encoding="utf-8")

    def document(self) -> dict[str, Any]:
        """Return the content of ``montecarlo.json``."""
        document: dict[str, Any] = json.loads(self.to_json())
        return document

    def check_valid(self) -> None:
        """Raise RunError if campaigns are unfinished, or chance does not explain the pulls."""
        if self.unfinished:
            raise _unfinished(self.unfinished)
        if not self.verdict.valid:
            raise RunError(f"{self.campaign}: not valid: {'; '.join(self.verdict.reasons)}")


@one_blas_thread
def montecarlo(
    campaign: CampaignLike,
    n: int = 200,
    out: PathLike | None = None,
    *,
    redraw: bool = False,
    fmus: bool = False,
    trusted: bool = False,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: Progress = LOG,
) -> MonteCarlo:
    """Repeat a campaign with new noise, fit each, and test pulls and coverage.

    Telemetry is drawn at 1 Hz from the spectra of the linear closed loop. An interrupted call continues where
    it was; `n` may be larger then.

    Parameters
    ----------
    campaign : Campaign or path
        What is repeated.
    n : int
        Number of campaigns.
    out : path, optional
        Folder of ``montecarlo.json`` and ``figures/pulls.*``; by default ``NAME-montecarlo``.
    redraw : bool
        Draw new truths for every campaign: gains within 5 %, stiffness and delays within 30 %.
    fmus : bool
        Simulate through the FMUs, which takes many times as long.
    trusted : bool
        Let third-party FMUs run, which are native code.
    jobs : int, optional
        Number of processes, by default one per processor.
    executor : concurrent.futures.Executor, optional
        Does the work instead, in processes with the same file system.
    progress : Progress, optional
        By default warnings are logged.

    Raises
    ------
    InputError, RunError
        If the campaign is wrong or needs the FMUs; if no campaign yields an estimate.
    """
    plan, source = resolve(campaign)
    if n < 2:
        raise InputError(f"n: {n}, expected two campaigns or more")
    workers = Workers(jobs, executor)
    directory = output_folder(out, plan, source, "-montecarlo")
    fit_settings, _ = validate_simulation(plan, source, "a Monte Carlo is", *[DELTA_G] * redraw)
    archives = campaign_fmus(plan, progress) if fmus else {}
    if not fmus:
        with prefix_errors(source):
            _check_spectra(plan)
    with results_folder.lock(directory, alternative=True), ExitStack() as stack:
        with prefix_errors(source):
            copies = stack.enter_context(fmu_archives.snapshot(plan, archives, directory, trusted=trusted))
        task = MonteCarloTask(plan, fit_settings, redraw, copies)
        header = _header(task)
        records, unfinished = _run_trials(directory, task, header, n, workers, progress)
        return _summarize(directory, plan.name, header, records, unfinished, progress)


def _header(task: MonteCarloTask) -> dict[str, object]:
    """Return the first line of the log: what all its campaigns have in common."""
    return {
        "campaign_digest": task.plan.digest,
        "settings": task.fit_settings.model_dump(),
        "redraw": task.redraw,
        "fmus": {model: checksums.digest(path) for model, path in task.fmus.items()},
        "lpfcosim_version": metadata.version("lpfcosim"),
    }


def _check_spectra(plan: Campaign) -> None:
    """Refuse a campaign with what telemetry drawn from spectra does not have."""
    validation.check_linear_model(plan, "the spectra that telemetry is drawn from are", _THROUGH_FMUS)
    for run in plan.runs:
        for demand in saturation.demands(run, ClosedLoop(run).limits):
            raise InputError(
                f"run '{run.name}': {demand.channel} is expected beyond its limit of {demand.limit:.3g}; "
                f"telemetry drawn from spectra knows no limit, {_THROUGH_FMUS}"
            )


def _run_trials(
    directory: Path,
    task: MonteCarloTask,
    header: Mapping[str, object],
    n: int,
    workers: Workers,
    progress: Progress,
) -> tuple[dict[int, Record], dict[str, str]]:
    """Run the campaigns that the log does not hold, and add them to it.

    Returns
    -------
    records : dict of int to dict
        Of the first n campaigns, by number.
    unfinished : dict of str to str
        Reasons, by campaign that could not be simulated.
    """
    log = directory / "campaigns.jsonl"
    records = read_log(log, header)
    missing = {f"campaign {number}": number for number in range(n) if number not in records}
    models = runner.fmu_order(task.plan)
    tasks = Tasks(task.run, missing, directory, directory / "logs", "{}", models)
    unfinished: dict[str, str] = {}
    with (
        progress.counted("campaigns", n, n - len(missing)) as advance,
        log.open("a", encoding="utf-8") as file,
        closing(workers.results(tasks)) as outcomes,
    ):
        for name, outcome in outcomes:  # in any order, as each has its own seed
            if isinstance(outcome, InputError | RunError):
                unfinished[name] = str(outcome)
                tasks.append_to_log(name, unfinished[name])
                continue
            records[outcome["number"]] = outcome
            file.write(json.dumps(outcome) + "\n")
            file.flush()
            advance(len(records))
    return {number: record for number, record in sorted(records.items()) if number < n}, unfinished


def _summarize(
    directory: Path,
    name: str,
    header: Mapping[str, object],
    records: Mapping[int, Record],
    unfinished: Mapping[str, str],
    progress: Progress,
) -> MonteCarlo:
    """Write the pulls of all campaigns and their figure."""
    failures = {k: record["failed"] for k, record in records.items() if "failed" in record}
    estimates = [record["estimates"] for record in records.values() if "estimates" in record]
    if unfinished and not estimates:
        raise _unfinished(unfinished)
    causes = ((str(number), f"failed: {reason}") for number, reason in failures.items())
    for line in grouped(causes, "campaign"):
        progress.note(line)
    pulls = coverage.summary(estimates)
    if not pulls:
        raise RunError(f"{name}: of {len(records)} campaigns {len(failures)} failed; there are no pulls")
    path = directory / "montecarlo.json"
    coverage.write(pulls, len(estimates), failures, {"campaign": name, **header}, path)
    with progress.stage("figure"):
        from fit.plotting import studies, write  # matplotlib, which workers do without

        (directory / "figures").mkdir(exist_ok=True)
        write(directory / "figures", "pulls", studies.histograms, pulls, estimates)
    verdict = coverage.verdict(pulls, len(estimates), len(failures))
    return MonteCarlo(name, pulls, len(estimates), failures, unfinished, verdict, path)


def _unfinished(unfinished: Mapping[str, str]) -> RunError:
    reason, *other_reasons = unfinished.values()
    count = f" and {len(other_reasons)} more" if other_reasons else ""
    return RunError(f"{reason}{count}; what is finished is kept, the same command continues")


class _FittedRecord(BaseModel, extra="allow", allow_inf_nan=False):
    """A line of the log about a campaign that was fitted."""

    number: Annotated[int, Field(ge=0)]
    estimates: dict[str, tuple[_Number, _Number]]


def read_log(log: Path, header: Mapping[str, object]) -> dict[int, Record]:
    """Return the fitted campaigns of an earlier call, and leave the log ready to be appended to.

    Raises
    ------
    InputError
        If it is not a log of campaigns, or its header is another one.
    """
    records: dict[int, Record] = {}
    if log.exists():
        text = documents.text(log, "a log of campaigns", MAX_LOG_SIZE)
        lines = text[: text.rfind("\n") + 1].splitlines()  # a killed process leaves half a line
        try:
            log_header, *entries = [json.loads(line) for line in lines] or [header]
            fitted = [_FittedRecord.model_validate(entry) for entry in entries if "estimates" in entry]
            records = {record.number: record.model_dump() for record in fitted}
        except (ValueError, TypeError, RecursionError) as error:
            raise InputError(f"{log}: not a log of campaigns, expected one line of JSON for each") from error
        if log_header != header:
            raise InputError(f"{log}: of another campaign or other options, expected another folder")
    content = [header, *records.values()]
    checksums.write(log, "".join(json.dumps(entry) + "\n" for entry in content))
    return records
