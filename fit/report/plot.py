"""The figures of the report, one by one, for a notebook.

Each shows itself. You can change its ``figure`` before you ``save`` it. Its ``columns`` are the numbers that
it draws, with units. `runs` are those of `fit.load`, `results` those of `fit.calibrate`, `experiment` is a
name such as ``"A"``. A name that is not there raises an `InputError`.
"""

import base64
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fit.errors import InputError
from fit.figures import Figure, analysis
from fit.figures import runs as figures_runs
from fit.figures import stiffness as figures_stiffness
from fit.plotting import Plot as Drawn
from fit.plotting import drawn, save, svg
from fit.report.experiments import parameters
from fit.report.stiffness import stiffness_points
from fit.results import Results
from fit.telemetry import Telemetry
from fit.warnings import masked_spans

SCALE = 2.2  # a figure of one column of a journal's page, on a screen


@dataclass(frozen=True)
class Plot(Drawn):
    """A figure of the report."""

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the figure as it is in the report. The suffix gives the format: pdf, svg or png."""
        save(self, Path(path))

    def _repr_html_(self) -> str:
        """Return what Jupyter shows: a picture on white, in any colour scheme of the notebook."""
        data = base64.b64encode(svg(self).encode()).decode()
        width = round(96 * SCALE * self.figure.get_figwidth())
        return f'<img src="data:image/svg+xml;base64,{data}" style="width:{width}px;max-width:100%" alt="">'


def responses(runs: Sequence[Telemetry], experiment: str) -> Plot:
    """Draw the injections, and the responses of o_1, o_12 and f_x_1 (if commanded), against time."""
    return _drawn(figures_runs.responses, _sysid(runs, experiment))


def spectra(results: Results, runs: Sequence[Telemetry], experiment: str) -> Plot:
    """Draw the ASD of signal, residual and noise run of an experiment."""
    run = _fitted(results, runs, experiment)
    return _drawn(figures_runs.acceleration, *_analysed(results, runs, run))


def breakdown(results: Results, runs: Sequence[Telemetry], experiment: str) -> Plot:
    """Draw the ASD of every term that adds up to the residual Delta g of an experiment."""
    run = _fitted(results, runs, experiment)
    return _drawn(figures_runs.breakdown, _analysis(results, run, run))


def residual(results: Results, runs: Sequence[Telemetry], experiment: str) -> Plot:
    """Draw signal and residual Delta g of an experiment against time, the residual beside its noise run."""
    run = _fitted(results, runs, experiment)
    return _drawn(figures_runs.residual, run, *_analysed(results, runs, run))


def stiffness(results: Results, runs: Sequence[Telemetry], test_mass: int = 2) -> Plot:
    """Draw omega2_2 against F_max_2 (or those of test mass 1): every experiment alone, and the model."""
    points = list(stiffness_points(results, runs, test_mass).values())
    if not points:
        raise InputError(
            f"no experiment determines omega2_{test_mass} alone, expected at least one with its run"
        )
    return _drawn(figures_stiffness.against_authority, points, results.joint)


def _drawn(draw: Callable[..., Figure], *arguments: object) -> Plot:
    return Plot(**vars(drawn(draw(*arguments))))


def _sysid(runs: Sequence[Telemetry], experiment: str) -> Telemetry:
    """Return the run of an experiment, and refuse one that is not there."""
    sysid_runs = {run.experiment: run for run in runs if run.kind == "sysid"}
    if experiment not in sysid_runs:
        raise InputError(f"no sysid run of {experiment!r}, expected one of {', '.join(sysid_runs) or 'none'}")
    return sysid_runs[experiment]


def _fitted(results: Results, runs: Sequence[Telemetry], experiment: str) -> Telemetry:
    run = _sysid(runs, experiment)
    if experiment not in results.experiments:
        known = ", ".join(results.experiments) or "none"
        raise InputError(f"the results have no experiment {experiment!r}, expected one of {known}")
    return run


def _analysed(
    results: Results, runs: Sequence[Telemetry], run: Telemetry
) -> tuple[analysis.Analysis, analysis.Analysis | None]:
    """Return what the figures of a run and of its noise run show, None without one."""
    noise = next((r for r in runs if r.experiment == run.experiment and r.kind == "noise"), None)
    return _analysis(results, run, run), _analysis(results, run, noise) if noise else None


def _analysis(results: Results, run: Telemetry, noise_run: Telemetry) -> analysis.Analysis:
    """Return what the figures of a run, or of its noise run, show."""
    spans = masked_spans(results.experiments[run.experiment].warnings, noise_run.run)
    return analysis.analyse(noise_run, parameters(results, run), spans)
