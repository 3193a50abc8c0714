"""Commands for planners, and identification, as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.common import (
    Bound,
    CampaignFile,
    Fix,
    GaussianPrior,
    Jobs,
    Out,
    Quiet,
    Tie,
    Trust,
    examples,
)

app = typer.Typer(rich_markup_mode=None)


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
