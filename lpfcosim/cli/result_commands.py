"""Commands on telemetry and results as a user sees them; calling one reads in the code behind it."""

from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.options import (
    Bound,
    Directory,
    Figures,
    Fix,
    GaussianPrior,
    Jobs,
    Out,
    Paths,
    Quiet,
    Tie,
    examples,
)

app = typer.Typer(rich_markup_mode=None)


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
        typer.Option("--settings", metavar="FIT.toml", help="File with a table [fit], such as a campaign."),
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
        float | None,
        typer.Option("--f-max", metavar="HZ", help="Upper end of the fitted band, between 0.02 and 0.1."),
    ] = None,
    f_min: Annotated[float | None, typer.Option("--f-min", hidden=True)] = None,  # refused with its reason
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")] = False,
    quiet: Quiet = False,
) -> None:
    """Fit telemetry files from anywhere; needs no FMU.

    If a PATH is the folder of an earlier run or fit, its telemetry is read. Runs with injections (kind
    sysid) calibrate the dynamics; noise runs of 12 h or more with torque channels calibrate the inertial
    forces. By default, results are written to a folder in the working directory named after the first PATH
    (NAME-fit if NAME is the input).
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
        band={name: f for name, f in (("f_min", f_min), ("f_max", f_max)) if f is not None},
    )


@app.command(epilog=examples("lpfcosim report quickstart"))
def report(directory: Directory, quiet: Quiet = False) -> None:
    """Rebuild the report of a results folder."""
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

    They are written to DIR/figures. Figure names are printed below the figures in report.html.
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

    The output for NAME.h5 is NAME-deltag.h5, at 1 to 2 Hz. Its channels are the terms of
    delta_g = delta_g_x + delta_g_SC + g_Omega + g_dOmega. Of LISA they are the terms of D_x and D_y.
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
        typer.Argument(metavar="DIR", help="Two or more folders or files of results."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    quiet: Quiet = False,
) -> None:
    """Compare the estimates of several results.

    Each estimate is shown with its uncertainty and its difference from the first result, in units of
    the standard deviation of the difference, sqrt(sigma_1^2 + sigma_2^2). This assumes independent data;
    results of the same telemetry are reported as such. For independent data, chi2 and its p-value test all
    parameters of the joint fits together. The exit status is 0, whether or not the results agree.
    """
    from lpfcosim.cli import compare as cli_compare
    from lpfcosim.cli.console import Console

    cli_compare.compare_results(paths, Console(quiet=quiet, as_json=as_json))


@app.command(
    epilog=examples(
        "lpfcosim jitter lisa --out manoeuvre.h5",
        "lpfcosim jitter lisa --noise --out noise.h5",
        "lpfcosim jitter sc1.h5 sc2.h5 sc3.h5 --out j.h5",
    )
)
def jitter(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="PATH", help="Telemetry of spacecraft 1, 2, 3, or folders of it."),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="J.h5", help="The file to write.")],
    noise: Annotated[bool, typer.Option("--noise", help="Take the noise runs of folders.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write the motion of three simulated LISA spacecraft.

    The file (lisa-jitter/1) has 27 series: attitudes, angles and positions of the six assemblies. In Python,
    lpfcosim.simulate_measurements simulates measurements with this motion, by lisainstrument.
    """
    from lpfcosim.cli import jitter as cli_jitter
    from lpfcosim.cli.console import Console

    cli_jitter.jitter(paths, out, Console(quiet=quiet), noise=noise)


@app.command(
    epilog=examples(
        "lpfcosim ttl manoeuvre.h5 --noise noise.h5", "lpfcosim ttl manoeuvre.h5 --out again --json"
    )
)
def ttl(
    measurements: Annotated[
        Path,
        typer.Argument(
            metavar="MEASUREMENTS.h5", help="TDI and wavefront sensing, or a file of lisainstrument."
        ),
    ],
    noise: Annotated[
        Path | None,
        typer.Option(
            "--noise", metavar="NOISE.h5", help="A run without manoeuvres, whose noise gives the weights."
        ),
    ] = None,
    out: Out = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")] = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate the tilt-to-length coupling of LISA.

    The 24 coefficients go to the section ttl of results.json. A file of measurements holds X2, Y2, Z2 and the
    rates by wavefront sensing (lisa-measurements/1). Files of lisainstrument need the extra lpfcosim[lisa].
    """
    from lpfcosim.cli import ttl as cli_ttl
    from lpfcosim.cli.console import Console

    cli_ttl.ttl(measurements, noise, out, Console(quiet=quiet, as_json=as_json))


@app.command(epilog=examples("lpfcosim mcmc quickstart"))
def mcmc(
    directory: Directory,
    steps: Annotated[
        int, typer.Option("--steps", min=1, metavar="N", help="Largest number of steps.")
    ] = 20000,
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Seed of the chain.")] = 1,
    as_json: Annotated[bool, typer.Option("--json", help="Print mcmc.json instead of a summary.")] = False,
    quiet: Quiet = False,
) -> None:
    """Sample the posterior of the joint fit in DIR.

    The telemetry is fitted again. The chain ends after 50 autocorrelation times of every parameter; mcmc.json
    and figures/corner.pdf are written to DIR, and report.html gets a section. If it does not get there, the
    exit status is 1.
    """
    from lpfcosim.cli import mcmc as cli_mcmc
    from lpfcosim.cli.console import Console

    cli_mcmc.mcmc(directory, Console(quiet=quiet, as_json=as_json), steps=steps, seed=seed)
