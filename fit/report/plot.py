"""The figures of the report, one by one, for a notebook.

Each shows itself. You can change its ``figure`` before you ``save`` it. Its ``columns`` are the numbers that
it draws, with units. `runs` are those of `fit.load`, `results` those of `fit.calibrate`, `experiment` is a
name such as ``"A"``, `ax` axes of yours to draw on, one for each panel. A name that is not there raises
an `InputError`.
"""

from collections.abc import Sequence

from markupsafe import Markup

from fit.errors import InputError, shown
from fit.figures import runs as figures_runs
from fit.figures import stiffness as figures_stiffness
from fit.plotting import Plot, PlotAxes, draw
from fit.report import experiments
from fit.report.stiffness import stiffness_points
from fit.results import Results, check_results
from fit.telemetry import Telemetry, check_runs


def responses(runs: Sequence[Telemetry], experiment: str, ax: PlotAxes = None) -> Plot:
    """Draw the injections, and the responses of o_1, o_12 and f_x_1 (if commanded), against time."""
    return draw(figures_runs.responses(_runs(runs, experiment)["sysid"]), ax)


def spectra(results: Results, runs: Sequence[Telemetry], experiment: str, ax: PlotAxes = None) -> Plot:
    """Draw the ASD of signal, residual and noise run of an experiment."""
    return _experiment_plot(results, runs, experiment, "spectra", ax)


def breakdown(results: Results, runs: Sequence[Telemetry], experiment: str, ax: PlotAxes = None) -> Plot:
    """Draw the ASD of every term that adds up to the residual of an experiment."""
    return _experiment_plot(results, runs, experiment, "breakdown", ax)


def residual(results: Results, runs: Sequence[Telemetry], experiment: str, ax: PlotAxes = None) -> Plot:
    """Draw the residual of an experiment against time with its noise run, and the signal of Delta g."""
    return _experiment_plot(results, runs, experiment, "residual", ax)


def stiffness(results: Results, runs: Sequence[Telemetry], test_mass: int = 2, ax: PlotAxes = None) -> Plot:
    """Draw omega2_2 against F_max_2 (or those of test mass 1): every single experiment, and the model."""
    check_results(results, "plot")
    check_runs(runs, "plot")
    if test_mass not in (1, 2):
        raise InputError(f"plot: test_mass: {shown(test_mass)}, expected 1 or 2")
    points = list(stiffness_points(results, runs, test_mass).values())
    if not points:
        raise InputError(
            f"no experiment determines omega2_{test_mass} alone, expected at least one with its run"
        )
    return draw(figures_stiffness.against_authority(points, results.joint), ax)


def _runs(runs: Sequence[Telemetry], experiment: str) -> dict[str, Telemetry]:
    """Return the runs of an experiment by kind, with injections at least."""
    check_runs(runs, "plot")
    names = [run.experiment for run in runs if run.kind == "sysid"]
    if experiment not in names:
        raise InputError(f"no sysid run of {experiment!r}, expected one of {', '.join(names) or 'none'}")
    return {run.kind: run for run in runs if run.experiment == experiment}


def _experiment_plot(
    results: Results, runs: Sequence[Telemetry], experiment: str, name: str, ax: PlotAxes
) -> Plot:
    """Draw one of the figures that the report has of an experiment."""
    check_results(results, "plot")
    pair = _runs(runs, experiment)
    if experiment not in results.experiments:
        known = ", ".join(results.experiments) or "none"
        raise InputError(f"the results have no experiment {experiment!r}, expected one of {known}")
    analysed = experiments.analysed(results, list(pair.values()))[experiment]
    specs = experiments.figure_specs("", experiment, analysed)
    (figure,) = (spec.draw() for spec in specs if spec.name.endswith(f"-{name}"))
    assert not isinstance(figure, Markup)
    return draw(figure, ax)
