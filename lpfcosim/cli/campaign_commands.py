"""Commands on campaigns as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated

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


@app.command(epilog=examples("lpfcosim check mine.toml", "lpfcosim check mine.toml --json | jq .peaks"))
def check(
    campaign: CampaignFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, schema lpf-check/1.")] = False,
    quiet: Quiet = False,
) -> None:
    """Validate a campaign and print what to expect of it.

    A campaign that `run` would refuse is an error (exit status 2): third-party FMUs that do not fit, unstable
    loops, commands at their limits for too long. A campaign with a command briefly at its limit, or with an
    injection that the fit does not use, is doubtful instead of valid (exit status 0). The command prints
    the runs, the stability margins, the expected sigmas (those of `lpfcosim forecast`), and the expected
    run time. With a third-party FMU in the loop, margins, sigmas and run time are not
    available. Nothing is simulated, and no FMU is built.
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

    They follow from the Fisher matrix at the true parameters of the campaign, for its estimator and its
    scatter between experiments. The closed-loop noise of the channels, which also carries information, is
    included. The sigmas of a single fit differ from these means by up to 10 %, because it estimates the
    noise PSDs. The sigmas of the misalignment angles are given by inertial period. With a third-party FMU
    in the loop they are not available (exit status 2; null in JSON).
    """
    from lpfcosim.cli import forecast as cli_forecast
    from lpfcosim.cli.console import Console

    cli_forecast.forecast(campaign, out, Console(quiet=quiet, as_json=as_json))


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
    scheduler: Scheduler = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            "--time-limit",
            metavar="DURATION",
            parser=duration,
            help='Wall time of each run, such as "2 h"; without --scheduler.',
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option("--rerun", help="Repeat simulations made with another campaign, seed, version or FMU."),
    ] = False,
    trusted: Trust = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")] = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a campaign with the FMUs, fit it, report.

    The output folder has telemetry/*.h5, results.json and report.html. After an interruption, the same
    command continues. The log of a failed run is in logs/; the complete experiments are fitted nevertheless,
    and the exit status is 1.
    """
    from lpfcosim.cli import run as cli_run
    from lpfcosim.cli.console import Console

    cli_run.run(
        campaign,
        out,
        Console(quiet=quiet, as_json=as_json),
        jobs=jobs,
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
    that of `lpfcosim fit` without the tests for faults of archives, and for glitches and changing gains
    where the campaign has none. Of a campaign with [spacecraft], only the channels of the joint fit are
    drawn; --fmus includes the inertial calibration. The output folder has montecarlo.json, campaigns.jsonl
    and figures/pulls.*. If interrupted, the same command continues, also with a larger N. A campaign with a
    third-party FMU needs --fmus.

    Finally mean and standard deviation of the pulls, coverage, and the fraction of failed campaigns (at most
    1 %) are tested. The exit status is 1 if they are inconsistent with valid uncertainties; the
    false-positive probability of this test is 1 %.
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
    epilog=examples(
        "lpfcosim design mine.toml",
        "lpfcosim design mine.toml --out better.toml --json",
    )
)
def design(
    campaign: CampaignFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="D.toml", help="Campaign to write [default: NAME-designed.toml]."),
    ] = None,
    jobs: Jobs = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print JSON, schema lpf-design/1."),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Optimise the injections within limits.

    The result is a campaign whose tones determine the parameters best, with a reason for each tone. The table
    [design] gives weights and limits; without it, the limits are what each run of the campaign reaches now.
    A lower bound on the objective holds for every design within the limits on rms. The tones are checked
    through the FMUs. If interrupted, the best design so far is written. Needs lpfcosim[design].
    """
    from lpfcosim.cli import design as cli_design
    from lpfcosim.cli.console import Console

    cli_design.design(campaign, out, Console(quiet=quiet, as_json=as_json), jobs=jobs)


@app.command(
    epilog=examples("lpfcosim identify quickstart.toml", "lpfcosim identify mine.toml flight/*.h5 --out mine")
)
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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print identified.json instead of a table.")
    ] = False,
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
    from lpfcosim.cli import identify as cli_identify
    from lpfcosim.cli.console import Console
    from lpfcosim.cli.constraints import Constraints

    console = Console(quiet=quiet, as_json=as_json)
    constraints = Constraints(fix or (), tie or (), prior or (), bound or ())
    cli_identify.identify_files(campaign, paths or [], out, console, trusted=trusted, constraints=constraints)
