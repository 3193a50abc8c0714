"""The commands as a user sees them: names, options, help. A command imports the workflow that it calls."""

from contextlib import nullcontext
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from lpfcosim.cli import fmu_commands, result_commands
from lpfcosim.cli.console import Console
from lpfcosim.cli.options import (
    Bound,
    CampaignFile,
    Fix,
    GaussianPrior,
    Jobs,
    Json,
    Out,
    Quiet,
    Scheduler,
    Tie,
    Trust,
    examples,
    help_without_command,
)

app = typer.Typer(
    help="Calibrate drag-free spacecraft: simulate LISA Pathfinder through FMUs, fit its dynamics, report.",
    epilog=examples(
        "lpfcosim new mine.toml      a campaign to start from",
        "lpfcosim check mine.toml    what to expect of it",
        "lpfcosim run mine.toml      writes mine/report.html",
    ),
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(show_version: bool) -> None:
    if show_version:
        from importlib import metadata

        print(f"lpfcosim {metadata.version('lpfcosim')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001 (its callback has it)
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    help_without_command(context)


@app.command(epilog=examples("lpfcosim new mine.toml"))
def new(
    name: Annotated[
        Path | None,
        typer.Argument(metavar="NAME.toml", help="The file to write; the campaign has its name."),
    ] = None,
    as_map: Annotated[
        bool, typer.Option("--map", help="Write a map of archives: CSV, MATLAB, FITS or HDF5.")
    ] = False,
) -> None:
    """Write a commented campaign or map of archives to start from.

    The JSON Schema of the file, lpf-campaign.json or lpf-map.json, is written to the same folder. The first
    line of the file names it, so that editors complete keys and check values as you type. No existing file
    is overwritten.
    """
    from lpfcosim.cli.new import write_campaign, write_map

    file = (write_map if as_map else write_campaign)(name)
    advice = "fill it in, then: lpfcosim fit" if as_map else "to check it: lpfcosim check"
    print(f"{file}: written; {advice} {quote(str(file))}")


@app.command(epilog=examples("lpfcosim check mine.toml", "lpfcosim check mine.toml --json | jq .peaks"))
def check(
    campaign: CampaignFile,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Validate a campaign and print what to expect of it.

    A campaign that `run` would refuse is an error (exit status 2): third-party FMUs that do not fit, unstable
    loops, commands at their limits for too long. A campaign with a command briefly at its limit, or with an
    injection that the fit does not use, is doubtful instead of valid (exit status 0). The command prints
    the runs, the stability margins, the peaks of read-outs and commands, and the expected sigmas (those of
    `lpfcosim forecast`). With a third-party FMU in the loop, they are not available. Nothing is simulated,
    and no FMU is built.
    """
    from lpfcosim.workflows import check as workflow

    console = Console(quiet=quiet, as_json=as_json)
    with console.stage("forecast"):
        checked = workflow.check(campaign)
    headline = f"{campaign}: {checked.headline()}"
    console.show_result(checked, headline, warnings=checked.warnings)


@app.command(epilog=examples("lpfcosim forecast mine.toml", "lpfcosim forecast mine.toml --out mine"))
def forecast(
    campaign: CampaignFile,
    as_json: Json = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write forecast.json to.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Print the expected sigmas of the joint fit; needs no FMU.

    They follow from the Fisher matrix at the true parameters of the campaign, for its estimator and its
    scatter between experiments. The closed-loop noise of the channels, which also carries information, is
    included. The sigmas of a single fit differ from these means by up to 10 %, because it estimates the
    noise PSDs. The sigmas of the misalignment angles are given by inertial period. With a third-party FMU
    in the loop they are not available (exit status 2; null in JSON).
    """
    from fit.files import atomic
    from lpfcosim.errors import UnavailableError
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import forecast as workflow

    console = Console(quiet=quiet, as_json=as_json)
    if out is not None:
        results_folder.check_folder(out)
    try:
        with console.stage("forecast"):
            expected = workflow.forecast(campaign)
    except UnavailableError as error:
        console.show(json=workflow.unavailable(error.reason))
        raise
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        atomic.write(out / "forecast.json", expected.to_json() + "\n")
    console.show_result(expected, warnings=expected.warnings)


@app.command(epilog=examples("lpfcosim run mine.toml --out tuesday --jobs 2"))
def run(
    campaign: CampaignFile,
    out: Out = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            metavar="SECONDS",
            help="Longest wall time of a run, without --scheduler.",
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option("--rerun", help="Repeat simulations made with another campaign, seed, version or FMU."),
    ] = False,
    trusted: Trust = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a campaign with the FMUs, fit it, report.

    The output folder has telemetry/*.h5, results.json and report.html. After an interruption, the same
    command continues. The log of a failed run is in logs/; the complete experiments are fitted nevertheless,
    and the exit status is 1.
    """
    from lpfcosim.execution import dask_executor, results_folder
    from lpfcosim.workflows import run as workflow

    console, directory = Console(quiet=quiet, as_json=as_json), out or Path(campaign.stem)
    results_folder.check_folder(directory)
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        calibration = workflow.run(
            campaign,
            directory,
            jobs=jobs,
            executor=executor,
            time_limit=time_limit,
            rerun=rerun,
            trusted=trusted,
            progress=console,
        )
    console.show_calibration(calibration)


@app.command(epilog=examples("lpfcosim montecarlo mine.toml -n 100 --redraw"))
def montecarlo(
    campaign: CampaignFile,
    n: Annotated[int, typer.Option("-n", min=2, metavar="N", help="Number of campaigns.")] = 200,
    out: Out = None,
    redraw: Annotated[
        bool,
        typer.Option("--redraw", help="Draw new truths: gains within 5 %, stiffness and delays within 30 %."),
    ] = False,
    fmus: Annotated[
        bool, typer.Option("--fmus", help="Simulate through the FMUs; takes many times as long.")
    ] = False,
    trusted: Trust = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Repeat a campaign with new noise; report pulls and coverage.

    Telemetry is drawn at 1 Hz from the spectra of the linear closed loop, which needs no FMU. The fit is
    that of `lpfcosim fit` without the tests for faults of archives, and for glitches and changing gains
    where the campaign has none. Of the whole spacecraft, only the channels of the joint fit are
    drawn; --fmus includes the inertial calibration. The output folder has montecarlo.json, campaigns.jsonl
    and figures/pulls.*. If interrupted, the same command continues, also with a larger N. A campaign with a
    third-party FMU needs --fmus.

    Finally mean and standard deviation of the pulls, coverage, and the fraction of failed campaigns (at most
    1 %) are tested. The exit status is 1 if they are inconsistent with valid uncertainties; the
    false-positive probability of this test is 1 %.
    """
    from lpfcosim.execution import dask_executor, results_folder
    from lpfcosim.workflows import montecarlo as workflow

    console = Console(quiet=quiet, as_json=as_json)
    directory = out or Path(f"{campaign.stem}-montecarlo")
    results_folder.check_folder(directory)
    with dask_executor(scheduler) if scheduler else nullcontext() as executor:
        study = workflow.montecarlo(
            campaign,
            n,
            directory,
            redraw=redraw,
            fmus=fmus,
            trusted=trusted,
            jobs=jobs,
            executor=executor,
            progress=console,
        )
    console.show_result(study)
    study.check_valid()


@app.command(epilog=examples("lpfcosim design mine.toml --out better.toml --json"))
def design(
    campaign: CampaignFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="D.toml", help="Campaign to write [default: NAME-designed.toml]."),
    ] = None,
    jobs: Jobs = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Optimise the injections within limits.

    The result is a campaign whose tones determine the parameters best, with a reason for each tone. The table
    [design] gives weights and limits; without it, the limits are what each run of the campaign reaches now.
    A lower bound on the objective holds for every design within the limits on rms. The tones are checked
    through the FMUs. If interrupted, the best design so far is written. Needs lpfcosim[design].
    """
    from lpfcosim.workflows import design as workflow

    console = Console(quiet=quiet, as_json=as_json)
    designed = workflow.design(campaign, out, jobs=jobs, progress=console)
    console.show_result(designed)
    designed.check_valid()
    console.show(f"{designed.path}: written; simulate it with: lpfcosim run {designed.path}")


@app.command(epilog=examples("lpfcosim identify mine.toml flight/*.h5 --out mine"))
def identify(
    campaign: CampaignFile,
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PATH", help="Telemetry, folders, maps [default: those of DIR, from lpfcosim run]."
        ),
    ] = None,
    out: Out = None,
    trusted: Trust = False,
    fix: Fix = None,
    tie: Tie = None,
    prior: GaussianPrior = None,
    bound: Bound = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate parameters of the FMUs in the loop.

    The table [identify] of the campaign lists them: any parameter of any FMU, with start value, bounds, and
    the runs that share it. Without the table, they are those of `lpfcosim fit`. The closed loop is simulated
    through the FMUs with trial values: measured o_1 and f_x_1 are imposed, and o_12 is compared. Everything
    else, the controllers included, is that of the campaign. The output folder has identified.json and a
    section of report.html, with the differences from `lpfcosim fit`. Constraints are given as for `lpfcosim
    fit`, also of parameters of FMUs (SuspensionControl.f_p, in the unit of the FMU).
    """
    from lpfcosim.cli.constraints import read_constraints
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import identify as workflow

    console, files = Console(quiet=quiet, as_json=as_json), paths or []
    directory = out or Path(f"{campaign.stem}-identified" if files else campaign.stem)
    results_folder.check_folder(directory)
    parameters = read_constraints(fix, tie, prior, bound)
    identified = workflow.identify(
        campaign, files, directory, parameters=parameters, trusted=trusted, progress=console
    )
    console.show_calibration(identified, f"identified: {identified.path}, ")


app.add_typer(result_commands.app)
app.add_typer(fmu_commands.app, name="fmu")
