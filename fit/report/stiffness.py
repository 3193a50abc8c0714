"""The parts of the report on stiffness: the model against the experiments, and against what was expected."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from fit.figures import stiffness as figures
from fit.report.section import FigureSpec, Section, single_fits
from fit.results import Estimate, Fit, Results
from fit.telemetry import Telemetry


def model(results: Results, telemetries: Sequence[Telemetry]) -> Section | None:
    """Return the section on the stiffness model, if two experiments or more determine a stiffness alone."""
    specs, words = [], []
    for j in (2, 1):
        points = stiffness_points(results, telemetries, j)
        if len(points) < 2:
            continue
        pulls = (figures.stiffness_pull(point, results.joint) for point in points.values())
        known = [pull for pull in pulls if pull is not None]
        if known:
            rms, largest = math.sqrt(np.mean(np.square(known))), max(map(abs, known))
            words.append(
                f"Test mass {j}: root mean square of the {len(known)} differences {rms:.2f} σ, "
                f"largest {largest:.1f} σ."
            )
        specs.append(_figure_spec(j, points, results.joint))
    if not specs:
        return None
    return Section("stiffness", "Stiffness model", " ".join(words), figures=tuple(specs))


def _figure_spec(j: int, points: Mapping[str, figures.StiffnessPoint], joint: Fit | None) -> FigureSpec:
    is_varied = figures.varies(list(points.values()))
    against = "its force authority" if is_varied else f"the force authority of test mass {3 - j}"
    note = "" if is_varied else f"Its force authority is the same everywhere; the abscissa is {against}. "
    return FigureSpec(
        f"stiffness-{j}",
        f"Stiffness of test mass {j} against {against}, one point per experiment",
        f"Stiffness of test mass {j}, ±1 σ. {note}Dots: each experiment on its own. Squares: stiffness model "
        "of the joint fit at the same authority, where determined (a sum can be, even if its terms are not); "
        "lines: the model at each torque authority. Lower panel: differences in units of their σ, with the "
        "correlation of the two fits.",
        partial(figures.against_authority, list(points.values()), joint),
    )


def stiffness_points(
    results: Results, telemetries: Sequence[Telemetry], j: int = 2
) -> dict[str, figures.StiffnessPoint]:
    """Return omega2_j of every experiment that determines it alone, by name."""
    runs = results.provenance.joint_runs
    points = {}
    for run, fit in single_fits("omega2_2", results, telemetries):
        omega2 = fit.parameters["omega2_2"] if j == 2 else _omega2_1(fit)
        if omega2 is not None:
            is_included = runs is None or run.run in runs
            of_run = (run.experiment, j, *run.authority[j - 1], omega2, is_included)
            points[run.experiment] = figures.StiffnessPoint(*of_run, F_max_other=run.authority[2 - j][0])
    return points


def _omega2_1(fit: Fit) -> Estimate | None:
    """Return omega2_1 = omega2_2 - domega2_12 with the sigma of the difference."""
    names, pair = list(fit.parameters), ("omega2_2", "domega2_12")
    if not fit.parameters.keys() >= set(pair):
        return None
    indices = [names.index(name) for name in pair]
    (variance, shared), (_, variance_2) = fit.covariance_matrix[np.ix_(indices, indices)]
    omega2_2, domega2_12 = (fit.parameters[name].value for name in pair)
    return Estimate(omega2_2 - domega2_12, math.sqrt(max(variance + variance_2 - 2 * shared, 0.0)), "s-2")
