"""Commands on telemetry and results. A command imports what it calls."""

from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

from lpfcosim.cli.console import Console
from lpfcosim.cli.options import (
    Bound,
    Calibration,
    Directory,
    Figures,
    Fix,
    GaussianPrior,
    Jobs,
    Json,
    Out,
    Paths,
    Quiet,
    Tie,
    examples,
)

app = typer.Typer(rich_markup_mode=None)


@app.command(epilog=examples("lpfcosim fit flight/*.h5 --settings fit.toml --fix C_1=0.149"))
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
    calibration: Calibration = None,
    fix: Fix = None,
    tie: Tie = None,
    prior: GaussianPrior = None,
    bound: Bound = None,
    f_max: Annotated[
        float | None,
        typer.Option("--f-max", metavar="HZ", help="Upper end of the fitted band, between 0.02 and 0.1."),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Fit telemetry files from anywhere; needs no FMU.

    If a PATH is the folder of an earlier run or fit, its telemetry is read. Runs with injections (kind
    sysid) calibrate the dynamics; noise runs of 12 h or more with torque channels calibrate the inertial
    forces. By default, results are written to a folder in the working directory named after the first PATH
    (NAME-fit if NAME is the input).
    """
    from fit import settings as fit_settings
    from fit.results import results_file
    from lpfcosim.cli.constraints import read_constraints
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import calibration as workflow

    console, directory = Console(quiet=quiet, as_json=as_json), out or results_folder.default(paths[0])
    results_folder.check_folder(directory)
    dynamics = results_file(calibration) if calibration else None
    chosen = fit_settings.read(settings) if settings else fit_settings.settings()
    options = {"f_max": f_max, "include_short": include_short or None}
    stated = {name: value for name, value in options.items() if value is not None}
    parameters = read_constraints(fix, tie, prior, bound)
    chosen = workflow.constrain(chosen.without_fmu_parameters(), parameters, stated)
    fit_settings.refuse_fmu_parameters(chosen, "options.parameters")
    console.show_calibration(workflow.fit_into(directory, paths, chosen, console, dynamics))


@app.command(epilog=examples("lpfcosim report quickstart"))
def report(directory: Directory, quiet: Quiet = False) -> None:
    """Rebuild the report of a results folder."""
    from fit.crosstalk import refit
    from fit.report import page
    from lpfcosim.execution import results_folder

    console = Console(quiet=quiet)
    with console.stage("reading"):
        results, telemetries = refit.load(directory)
    with results_folder.lock(directory), console.stage("report"):
        path = page.write_report(directory, results, telemetries)
    console.show(f"report: {path}")


@app.command(epilog=examples("lpfcosim figures quickstart stiffness A1-spectra"))
def figures(
    directory: Directory,
    names: Figures = None,
    jobs: Jobs = None,
    quiet: Quiet = False,
) -> None:
    """Draw figures for a journal: PDF, SVG and CSV.

    They are written to DIR/figures. Figure names are printed below the figures in report.html.
    """
    from lpfcosim.cli.figures import write_figures

    console = Console(quiet=quiet)
    n_figures = write_figures(directory, names or [], console, jobs=jobs)
    console.show(f"{n_figures} figures: {directory / 'figures'}")


@app.command(epilog=examples("lpfcosim deltag flight/*.h5 --calibration quickstart"))
def deltag(
    paths: Paths,
    calibration: Calibration = None,
    out: Out = None,
    quiet: Quiet = False,
) -> None:
    """Write the calibrated Delta g of telemetry, term by term.

    The output for NAME.h5 is NAME-deltag.h5, at 1 to 2 Hz. Its channels are the terms of
    delta_g = delta_g_x + delta_g_SC + g_Omega + g_dOmega. Of LISA they are the terms of D_x and D_y.
    """
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import deltag as workflow

    console, directory = Console(quiet=quiet), out or results_folder.default(paths[0], "deltag")
    results_folder.check_folder(directory)
    for path in workflow.write_deltag(paths, calibration, directory, console):
        console.show(str(path))


@app.command(epilog=examples("lpfcosim compare quickstart again --json | jq .joint.lambda_2.differences"))
def compare(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="DIR", help="Two or more folders or files of results."),
    ],
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compare the estimates of several results.

    Each estimate is shown with its uncertainty and its difference from the first result, in units of
    the standard deviation of the difference, sqrt(sigma_1^2 + sigma_2^2). This assumes independent data;
    results of the same telemetry are reported as such. For independent data, chi2 and its p-value test all
    parameters of the joint fits together. The exit status is 0, whether or not the results agree.
    """
    from fit.comparison import compare

    console = Console(quiet=quiet, as_json=as_json)
    with console.stage("reading"):
        comparison = compare(paths)
    console.show(str(comparison), json=comparison.to_json())


@app.command(epilog=examples("lpfcosim jitter sc1.h5 sc2.h5 sc3.h5 --out j.h5"))
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
    from lpfcosim.constellation import join, write_jitter
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import calibration

    console = Console(quiet=quiet)
    results_folder.check_file(out, paths, (".h5", ".hdf5"))
    with console.stage("reading"):
        motion = join(calibration.runs_of_kind(paths, "noise" if noise else "sysid"))
    write_jitter(motion, out, {"lpfcosim_version": metadata.version("lpfcosim")})
    console.show(str(out))


@app.command(epilog=examples("lpfcosim ttl lisa-ttl.toml", "lpfcosim ttl measured.h5 --noise noise.h5"))
def ttl(
    measurements: Annotated[
        Path,
        typer.Argument(
            metavar="MEASUREMENTS.h5",
            help="TDI and wavefront sensing, a file of lisainstrument, or a campaign of three spacecraft.",
        ),
    ],
    noise: Annotated[
        Path | None,
        typer.Option(
            "--noise", metavar="NOISE.h5", help="A run without manoeuvres, whose noise gives the weights."
        ),
    ] = None,
    out: Out = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate the tilt-to-length coupling of LISA.

    The 24 coefficients go to the section ttl of results.json. A file of measurements holds X2, Y2, Z2 and the
    rates by wavefront sensing (lisa-measurements/1). Files of lisainstrument need the extra lpfcosim[lisa]. A
    campaign is simulated first, and measured by lisainstrument.
    """
    from lpfcosim.errors import InputError
    from lpfcosim.execution import results_folder
    from lpfcosim.workflows import calibration
    from lpfcosim.workflows import ttl as workflow

    console = Console(quiet=quiet, as_json=as_json)
    directory = out or results_folder.default(measurements, "ttl")
    results_folder.check_folder(directory)
    if measurements.suffix == ".toml":
        if noise is not None:
            raise InputError(f"--noise {noise}: expected no noise run, a campaign has its own")
        console.show_calibration(workflow.run_ttl(measurements, directory, progress=console))
    else:
        console.show_calibration(calibration.calibrate_ttl_into(directory, measurements, noise, console))


@app.command(epilog=examples("lpfcosim mcmc quickstart"))
def mcmc(
    directory: Directory,
    steps: Annotated[
        int, typer.Option("--steps", min=1, metavar="N", help="Largest number of steps.")
    ] = 20000,
    seed: Annotated[int, typer.Option("--seed", min=0, metavar="N", help="Seed of the chain.")] = 1,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Sample the posterior of the joint fit in DIR.

    The telemetry is fitted again. The chain ends after 50 autocorrelation times of every parameter; mcmc.json
    and figures/corner.pdf are written to DIR, and report.html gets a section. If it does not get there, the
    exit status is 1.
    """
    from lpfcosim.cli.mcmc import write_mcmc

    console = Console(quiet=quiet, as_json=as_json)
    lines, document = write_mcmc(directory, console, steps=steps, seed=seed)
    console.show(*lines, json=document)
