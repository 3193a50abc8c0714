"""Commands on campaigns as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from lpfcosim.cli.options import (
    Bound,
    CampaignFile,
    Fix,
    GaussianPrior,
    Jobs,
    Out,
    Quiet,
    Scheduler,
    Tie,
    Trust,
    duration,
    examples,
)

app = typer.Typer(rich_markup_mode=None)


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


@app.command(epilog=examples("lpfcosim forecast mine.toml", "lpfcosim forecast mine.toml --out mine"))
def forecast(
    campaign: CampaignFile,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, schema lpf-forecast/1, with the correlations.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder to write forecast.json to.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Print the expected sigmas of the joint fit; needs no FMU.

    They come from the Fisher matrix at the true parameters of the campaign. It includes the closed-loop
    noise of the channels, which carries information too. They are those of the estimator and of the scatter
    between experiments that the campaign asks for. They are means over many campaigns: those of one fit
    differ by up to 10 %, because it estimates the noise PSDs. Those of the angles of the inertial
    calibration are given by period. With a third-party FMU in the loop they are not available (exit
    status 2; null in JSON).
    """
    from lpfcosim.cli import forecast as cli_forecast
    from lpfcosim.cli.console import Console

    cli_forecast.forecast(campaign, out, Console(quiet=quiet, as_json=as_json))


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


@app.command(
    epilog=examples("lpfcosim design mine.toml", "lpfcosim design mine.toml --out better.toml --json")
)
def design(
    campaign: CampaignFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="D.toml", help="Campaign to write [default: NAME-designed.toml]."),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option("--figure", metavar="FILE", help="Draw what tones tell by frequency (svg, pdf, png)."),
    ] = None,
    jobs: Jobs = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, schema lpf-design/1.")] = False,
    quiet: Quiet = False,
) -> None:
    """Find the best injections within limits.

    It writes a campaign with other tones, each with the reason it is there for, that tells the parameters
    best. The table [design] says what is best and what must not be exceeded; without it, all that the
    campaign itself does not exceed, run by run. A bound tells what no design within the limits on rms goes
    below. The tones are checked through the FMUs. Interrupted, it writes the best that it has found.
    Needs lpfcosim[design].
    """
    from lpfcosim.cli import design as cli_design
    from lpfcosim.cli.console import Console

    cli_design.design(campaign, out, figure, Console(quiet=quiet, as_json=as_json), jobs=jobs)


@app.command(
    epilog=examples("lpfcosim identify quickstart.toml", "lpfcosim identify mine.toml flight/*.h5 --out mine")
)
def identify(
    campaign: CampaignFile,
    paths: Annotated[
        list[Path] | None,
        typer.Argument(metavar="PATH", help="Telemetry, folders, maps [default: what run left in DIR]."),
    ] = None,
    out: Out = None,
    trusted: Trust = False,
    fix: Fix = None,
    tie: Tie = None,
    prior: GaussianPrior = None,
    bound: Bound = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print identified.json instead of a table.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Estimate parameters of the FMUs in the loop.

    The table [identify] of the campaign names them: any parameter of any FMU, with start, bounds and what
    shares it. Without the table, they are those of `lpfcosim fit`. The closed loop is simulated through the
    FMUs with trial values. o_1 and f_x_1 are imposed as measured, o_12 is compared. All else is as the
    campaign says, the controllers too. The folder holds identified.json, and report.html has a section on
    it, with the differences from `lpfcosim fit`. Constraints of parameters, those of FMUs too
    (SuspensionControl.f_p, in the unit of the FMU), are those of `lpfcosim fit`.
    """
    from lpfcosim.cli import identify as cli_identify
    from lpfcosim.cli.console import Console
    from lpfcosim.cli.constraints import Constraints

    console = Console(quiet=quiet, as_json=as_json)
    constraints = Constraints(fix or (), tie or (), prior or (), bound or ())
    cli_identify.identify_files(campaign, paths or [], out, console, trusted=trusted, constraints=constraints)
