"""Commands on results, as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.common import Directory, Figures, Jobs, Out, Paths, Quiet, Trust, examples

app = typer.Typer(rich_markup_mode=None)


@app.command(epilog=examples("lpfcosim report quickstart"))
def report(directory: Directory, quiet: Quiet = False) -> None:
    """Rebuild the report from what DIR holds."""
    from lpfcosim.cli import report as cli_report
    from lpfcosim.cli.console import Console

    cli_report.report(directory, Console(quiet=quiet))


@app.command(
    epilog=examples("lpfcosim figures quickstart", "lpfcosim figures quickstart stiffness A1-spectra")
)
def figures(
    directory: Directory,
    names: Figures = None,
    jobs: Jobs = None,
    quiet: Quiet = False,
) -> None:
    """Draw figures for a journal: PDF, SVG and CSV.

    They go to DIR/figures. The name of a figure stands below it in report.html.
    """
    from lpfcosim.cli import figures as cli_figures
    from lpfcosim.cli.console import Console

    cli_figures.figures(directory, names or [], Console(quiet=quiet), jobs=jobs)


@app.command(
    epilog=examples("lpfcosim deltag quickstart", "lpfcosim deltag flight/*.h5 --calibration quickstart")
)
def deltag(
    paths: Paths,
    calibration: Annotated[
        Path | None,
        typer.Option(
            "--calibration",
            metavar="RESULTS",
            help="Folder of an earlier run or fit, or its results.json [default: that of PATH].",
        ),
    ] = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Write the calibrated Delta g of telemetry, term by term.

    NAME.h5 becomes NAME-deltag.h5, at 1 to 2 Hz. Its channels are the terms of
    delta_g = delta_g_x + delta_g_SC + g_Omega + g_dOmega.
    """
    from lpfcosim.cli import deltag as cli_deltag
    from lpfcosim.cli.console import Console

    cli_deltag.deltag(paths, calibration, out, Console(quiet=quiet))


@app.command(
    epilog=examples(
        "lpfcosim compare quickstart again",
        "lpfcosim compare quickstart quickstart/identified.json",
        "lpfcosim compare quickstart again --json | jq .joint.lambda_2.differences",
    )
)
def compare(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="DIR", help="Two or more folders of results, or files of them."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, schema lpf-compare/1.")] = False,
    quiet: Quiet = False,
) -> None:
    """Compare the estimates of several results.

    Each estimate is shown with its uncertainty, and its difference from that of the first result in units of
    the standard deviation of the difference, sqrt(sigma_1^2 + sigma_2^2). That holds for independent data;
    results of the same telemetry are reported as such. For independent data, chi2 and its p-value test all
    parameters of the joint fits together. The exit status is 0, whether or not the results agree.
    """
    from lpfcosim.cli import compare as cli_compare
    from lpfcosim.cli.console import Console

    cli_compare.compare_results(paths, Console(quiet=quiet, as_json=as_json))


@app.command(epilog=examples("lpfcosim mcmc quickstart"))
def mcmc(
    directory: Directory,
    steps: Annotated[
        int, typer.Option("--steps", min=1, metavar="N", help="Most steps that this call takes.")
    ] = 20000,
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Seed of a new chain.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print mcmc.json instead of a summary.")] = False,
    quiet: Quiet = False,
) -> None:
    """Sample the posterior of the joint fit in DIR.

    The chain has converged after 50 autocorrelation times of every parameter. Then mcmc.h5 (the chain),
    mcmc.json and figures/corner.pdf are in DIR, and report.html has a section on them. Until then the exit
    status is 1, and the same command continues.
    """
    from lpfcosim.cli import mcmc as cli_mcmc
    from lpfcosim.cli.console import Console

    cli_mcmc.mcmc(directory, Console(quiet=quiet, as_json=as_json), steps=steps, seed=seed)


@app.command(epilog=examples("lpfcosim reproduce quickstart"))
def reproduce(directory: Directory, jobs: Jobs = None, trusted: Trust = False, quiet: Quiet = False) -> None:
    """Run the campaign in DIR again elsewhere, and compare.

    Telemetry must have the same bytes. Results must be the same; only their provenance may differ. The exit
    status is 1 if anything differs. DIR is not changed. Another version or other FMUs are reported.
    """
    from lpfcosim.cli import reproduce as cli_reproduce
    from lpfcosim.cli.console import Console

    cli_reproduce.reproduce(directory, Console(quiet=quiet), jobs=jobs, trusted=trusted)
