"""The commands as a user sees them: names, options, help. Calling a command reads in the code behind it."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from lpfcosim.cli import fmu as cli_fmu
from lpfcosim.cli import planners, results
from lpfcosim.cli.common import (
    Bound,
    CampaignFile,
    Fix,
    GaussianPrior,
    Jobs,
    Out,
    Paths,
    Quiet,
    Scheduler,
    Tie,
    Trust,
    duration,
    examples,
    help_without_command,
)

app = typer.Typer(
    help="Calibrate drag-free spacecraft: simulate LISA Pathfinder through FMUs, fit its dynamics, report.",
    epilog=examples(
        "lpfcosim new mine.toml      a campaign to start from",
        "lpfcosim check mine.toml    what to expect of it",
        "lpfcosim run mine.toml      leaves mine/report.html",
    ),
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
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


@app.command(
    epilog=examples(
        "lpfcosim new mine.toml",
        "lpfcosim new --map mission.toml           a map that is an example",
        "lpfcosim new --map A.csv A-noise.csv      A.toml, a map of two archives",
    )
)
def new(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="NAME.toml",
            help="The file to write; the campaign has its name. With --map also the archives to describe.",
            show_default=False,
        ),
    ] = None,
    as_map: Annotated[
        bool, typer.Option("--map", help="Write a map of archives: CSV, MATLAB, FITS, HDF5 or NumPy.")
    ] = False,
) -> None:
    """Write a commented campaign or map of archives to start from.

    Of archives, the map lists the columns of the first, and has those that are recognised by their names;
    the rest is to be filled in.

    Beside it comes lpf-campaign.json or lpf-map.json, its JSON Schema. The first line of the file names it,
    so that editors complete keys and check values as you type. No existing file is overwritten.
    """
    from lpfcosim.cli import new as cli_new

    (cli_new.new_map if as_map else cli_new.new)(files or [])


@app.command(epilog=examples("lpfcosim check mine.toml", "lpfcosim check mine.toml --json | jq .wall_time"))
def check(
    campaign: CampaignFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, schema lpf-check/1.")] = False,
    quiet: Quiet = False,
) -> None:
    """Validate a campaign and print what to expect of it.

    What `run` would refuse is refused, with exit status 2: third-party FMUs that do not fit their places,
    unstable loops, commands at their limits for too long. A campaign with a command at its limit, or with
    a tone that the fit takes nothing from, is called doubtful instead of valid (exit status 0). Then come
    its runs, the stability margins of its loops, the expected sigmas (those of `lpfcosim forecast`), and
    how long it will take. With a third-party FMU in the loop these are not available. Nothing is
    simulated, and none of our FMUs is needed.
    """
    from lpfcosim.cli import check as cli_check
    from lpfcosim.cli.console import Console

    cli_check.check(campaign, Console(quiet=quiet, as_json=as_json))


@app.command(
    epilog=examples(
        "lpfcosim run campaigns/quickstart.toml",
        "lpfcosim run mine.toml --out tuesday --jobs 2",
        "lpfcosim run mine.toml --json | jq .joint.parameters.lambda_2",
    )
)
def run(
    campaign: CampaignFile,
    out: Out = None,
    jobs: Jobs = None,
    engine: Annotated[
        Literal["compiled", "fmpy"],
        typer.Option("--engine", help="Loop over the FMUs; fmpy is the plain one: slow, same bits."),
    ] = "compiled",
    scheduler: Scheduler = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            metavar="DURATION",
            parser=duration,
            help='Longest time a run may take, such as "2 h". A minute without a step always ends it.',
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option(
            "--rerun", help="Simulate anew what was made with another campaign, seed, version or FMU."
        ),
    ] = False,
    trusted: Trust = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a campaign with the FMUs, fit it, report.

    Afterwards the folder holds telemetry/*.h5, results.json and report.html. If it is interrupted, the
    same command continues. A run that fails leaves a log in logs/. Complete experiments
    are fitted all the same, and the exit status is 1.
    """
    from lpfcosim.cli import run as cli_run
    from lpfcosim.cli.console import Console

    cli_run.run(
        campaign,
        out,
        Console(quiet=quiet, as_json=as_json),
        jobs=jobs,
        engine=engine,
        scheduler=scheduler,
        time_limit=time_limit,
        rerun=rerun,
        trusted=trusted,
    )


@app.command(
    epilog=examples(
        "lpfcosim fit quickstart --out again",
        "lpfcosim fit flight/*.h5 --settings fit.toml --json",
        "lpfcosim fit quickstart --fix lambda_2=1.0776 --tie alpha_phi_1=alpha_phi_2",
        "lpfcosim fit noise/ --calibration quickstart",
    )
)
def fit(
    paths: Paths,
    out: Out = None,
    settings: Annotated[
        Path | None,
        typer.Option("--settings", metavar="FIT.toml", help="File with a table [fit]; a campaign will do."),
    ] = None,
    include_short: Annotated[
        bool, typer.Option("--include-short", help="Let runs shorter than 6 h take part in the joint fit.")
    ] = False,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="RESULTS",
            help="Take the dynamics from an earlier result (folder or results.json); PATH then holds noise "
            "runs only.",
        ),
    ] = None,
    fix: Fix = None,
    tie: Tie = None,
    prior: GaussianPrior = None,
    bound: Bound = None,
    f_max: Annotated[
        float | None, typer.Option("--f-max", metavar="HZ", help="End of the fitted band (0.02 to 0.1).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")] = False,
    quiet: Quiet = False,
) -> None:
    """Fit telemetry files from anywhere; needs no FMU.

    The folder of an earlier run or fit means the telemetry of its results. Runs with injections (kind sysid)
    calibrate the dynamics. Noise runs of 12 h or more with torques calibrate the inertial forces. Without
    --out, results go to a folder in the working directory that has the name of the first PATH (NAME-fit
    where that is the input itself).
    """
    from lpfcosim.cli import fit as cli_fit
    from lpfcosim.cli.console import Console
    from lpfcosim.cli.constraints import Constraints

    cli_fit.fit_files(
        paths,
        out,
        Console(quiet=quiet, as_json=as_json),
        settings=settings,
        include_short=include_short,
        calibration=calibration,
        constraints=Constraints(fix or (), tie or (), prior or (), bound or ()),
        f_max=f_max,
    )


@app.command(
    epilog=examples(
        "lpfcosim montecarlo mine.toml -n 100 --redraw",
        "lpfcosim montecarlo mine.toml -n 1000 --scheduler tcp://HOST:8786",
    )
)
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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print montecarlo.json instead of a table.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Repeat a campaign with new noise; report pulls and coverage.

    Telemetry is drawn at 1 Hz from the spectra of the linear closed loop, which needs no FMU. The fit is
    that of `lpfcosim fit`, but looks for no faults of archives, and for no glitches, and no gains that
    change, where the campaign has none. Of the whole spacecraft, only the channels of the joint fit are
    drawn; with --fmus the inertial calibration takes part too. The folder holds montecarlo.json,
    campaigns.jsonl and figures/pulls.*. If it is interrupted, the same command continues; N may be larger
    then. A campaign with a third-party FMU needs --fmus.

    In the end mean and standard deviation of the pulls, coverage, and the share of campaigns that failed
    (1 % may) are tested. Exit status 1 says that chance does not explain them; it does so by mistake in
    1 of 100 cases.
    """
    from lpfcosim.cli import montecarlo as cli_montecarlo
    from lpfcosim.cli.console import Console

    cli_montecarlo.montecarlo(
        campaign,
        n,
        out,
        Console(quiet=quiet, as_json=as_json),
        redraw=redraw,
        fmus=fmus,
        trusted=trusted,
        jobs=jobs,
        scheduler=scheduler,
    )


@app.command(epilog=examples("lpfcosim margins mine.toml"))
def margins(
    campaign: CampaignFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, schema lpf-margins/1.")] = False,
) -> None:
    """Print the stability margins of every control loop.

    These are unity gain, phase margin and gain margin of each loop, with the others closed. They are
    computed from our model of the loop. With a third-party FMU in it they are not available (exit status
    2; null in JSON).
    """
    from lpfcosim.cli import margins as cli_margins
    from lpfcosim.cli.console import Console

    cli_margins.margins(campaign, Console(as_json=as_json))


@app.command(
    epilog=examples(
        "lpfcosim trust my_controller.fmu",
        "lpfcosim trust                         what is approved",
        "lpfcosim trust --remove 3f5a09c2       by the first digits of its digest",
    )
)
def trust(
    files: Annotated[
        list[str] | None, typer.Argument(metavar="FILE.fmu", help="FMUs [default: list what is approved].")
    ] = None,
    remove: Annotated[
        bool, typer.Option("--remove", help="Withdraw the approval of files, or of digests.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Approve FMUs that were not built here; list them.

    An FMU is native code with all your rights. Digest, name and date of what you approve go into your own
    configuration. An FMU that has changed since is another one, and wants a new approval.
    """
    from lpfcosim.cli import trust as cli_trust
    from lpfcosim.cli.console import Console

    cli_trust.trust(files or [], Console(quiet=quiet), remove=remove)


@app.command(epilog=examples("lpfcosim schema > lpf-campaign.json", "lpfcosim schema --map > lpf-map.json"))
def schema(
    as_map: Annotated[bool, typer.Option("--map", help="That of a map of archives.")] = False,
) -> None:
    """Print the JSON Schema of a campaign or a map, for editors.

    Begin a campaign with the line "#:schema ./lpf-campaign.json", a map with "#:schema ./lpf-map.json".
    Editors then complete and check it as you type, for instance Visual Studio Code with the extension Even
    Better TOML.
    """
    from lpfcosim.cli import schema as cli_schema

    cli_schema.print_schema(as_map=as_map)


app.add_typer(planners.app)
app.add_typer(results.app)
app.add_typer(cli_fmu.app, name="fmu")
