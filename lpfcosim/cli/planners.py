"""Commands for planners as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.common import CampaignFile, Jobs, Quiet, examples

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
    """Tell the expected sigmas of the joint fit; needs no FMU.

    They come from the Fisher matrix at the true parameters of the campaign. It includes the closed-loop
    noise of the channels, which carries information too. They are those of the estimator and of the scatter
    between experiments that the campaign asks for; flscov counts as the default estimator. They are means
    over many campaigns: those of one fit differ by up to 10 %, because it estimates the noise PSDs. The
    angles of the inertial calibration are not forecast.
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

    cli_design.design(campaign, out, Console(quiet=quiet, as_json=as_json), jobs=jobs)
