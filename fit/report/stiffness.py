"""The parts of the report on stiffness: the model against the experiments, and against what was expected."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from markupsafe import Markup, escape

from fit import parameters
from fit.figures import stiffness as figures
from fit.parameters import joint_parameter
from fit.report.parts import Drawing, Part, fitted_for
from fit.results import Estimate, Fit, Results
from fit.tables import LIMIT, Grid, Line, flagged, parameter_head, signed
from fit.tables import parameters as tables
from fit.telemetry import Telemetry


def model(results: Results, telemetries: Sequence[Telemetry]) -> Part | None:
    """Return the section on eq. stiff_model, where two experiments or more determine a stiffness alone."""
    grids, drawings, words = [], [], []
    for j in (2, 1):
        points = stiffness_points(results, telemetries, j)
        if len(points) < 2:
            continue
        pulls = {name: figures.stiffness_pull(point, results.joint) for name, point in points.items()}
        known = [pull for pull in pulls.values() if pull is not None]
        if known:
            rms, largest = math.sqrt(np.mean(np.square(known))), max(map(abs, known))
            words.append(
                f"Test mass {j}: root mean square of the {len(known)} differences {rms:.2f} σ, "
                f"largest {largest:.1f} σ."
            )
        grids.append(_grid(j, points, pulls, results.joint))
        drawings.append(_drawing(j, points, results.joint))
    if not grids:
        return None
    return Part("stiffness", "Stiffness model", " ".join(words), tuple(grids), tuple(drawings))


def _grid(
    j: int,
    points: Mapping[str, figures.StiffnessPoint],
    pulls: Mapping[str, float | None],
    joint: Fit | None,
) -> Grid:
    caption = (
        f"Stiffness of test mass {j} in 10⁻⁷ s⁻² from each experiment alone and from the joint fit, at the "
        "experiment's authority in pN and pN m."
    )
    head = ("Experiment", Markup("F, N<sub>max,{}</sub>").format(j), "Alone", "Joint fit", "Δ / σ")
    return Grid(
        caption, head, tuple(_line(name, point, pulls[name], joint) for name, point in points.items())
    )


def _drawing(j: int, points: Mapping[str, figures.StiffnessPoint], joint: Fit | None) -> Drawing:
    figure = "the paper's figure stiffauth" if j == 2 else "as the paper's figure stiffauth"
    is_varied = figures.varies(list(points.values()))
    against = "its force authority" if is_varied else f"the force authority of test mass {3 - j}"
    elsewhere = (
        f"Its own force authority is the same in all of them, so that it is drawn against that of test mass "
        f"{3 - j}, on which it does not depend. "
    )
    note = "" if is_varied else elsewhere
    return Drawing(
        f"stiffness-{j}",
        f"Stiffness of test mass {j} against {against}, one point per experiment",
        f"Stiffness of test mass {j}, ±1 σ ({figure}). {note}Dots: each experiment on its own. "
        "Where the joint fit determines the stiffness (eq. stiff_model), be it the sum and not its parts, "
        "squares show it at the same authority, lines in between, one for each torque authority; the lower "
        "panel gives the differences in units of their σ, the correlation of the two fits included.",
        partial(figures.against_authority, list(points.values()), joint),
    )


def stiffness_points(
    results: Results, telemetries: Sequence[Telemetry], j: int = 2
) -> dict[str, figures.StiffnessPoint]:
    """Return omega2_j of every experiment that determines it alone, by name."""
    runs = results.provenance.joint_runs
    points = {}
    for run, fit in fitted_for("omega2_2", results, telemetries):
        omega2 = fit.parameters["omega2_2"] if j == 2 else _of_test_mass_1(fit)
        if omega2 is not None:
            is_included = runs is None or run.run in runs
            points[run.experiment] = figures.StiffnessPoint(
                run.experiment,
                j,
                *run.authority[j - 1],
                omega2,
                is_included,
                F_max_other=run.authority[2 - j][0],
            )
    return points


def _of_test_mass_1(fit: Fit) -> Estimate | None:
    """Return omega2_1 = omega2_2 - domega2_12 with the sigma of the difference."""
    names, pair = list(fit.parameters), ("omega2_2", "domega2_12")
    if not fit.parameters.keys() >= set(pair):
        return None
    indices = [names.index(name) for name in pair]
    (variance, shared), (_, variance_2) = fit.covariance[np.ix_(indices, indices)]
    omega2_2, domega2_12 = (fit.parameters[name].value for name in pair)
    return Estimate(omega2_2 - domega2_12, math.sqrt(variance + variance_2 - 2 * shared), "s-2")


def _line(name: str, point: figures.StiffnessPoint, pull: float | None, joint: Fit | None) -> Line:
    reconstructed = figures.reconstruction(joint, point.j, point.F_max, point.N_max)
    cells = (
        f"{1e12 * point.F_max:.4g}, {1e12 * point.N_max:.3g}",
        tables.number(point.omega2.value, point.omega2.sigma, -7),
        tables.number(*reconstructed, -7) if reconstructed else None,
        "–" if pull is None else flagged(signed(pull, 1), abs(pull) > LIMIT),
    )
    return Line(escape(name), cells)


def prediction(joint: Fit | None) -> Part | None:
    """Return the section on what the stiffness was expected to be."""
    grids = tuple(grid for grid in (_alphas(joint), _budget(joint)) if grid) if joint else ()
    return Part("prediction", "Predicted stiffness", grids=grids) if grids else None


@dataclass(frozen=True)
class Prediction:
    """One stiffness coefficient as predicted and as fitted.

    Attributes
    ----------
    name : str
        ``alpha_x_j`` or ``alpha_phi_j``.
    value, sigma : float
        Predicted from the capacitances; sigma is that of lambda_V alone.
    paper : float
        What the paper predicts.
    fitted : Estimate
        Of the joint fit.
    lambda_V : Estimate or None
        The gain of the voltages at which the prediction is the fitted value; None if its sign is wrong.
    """

    name: str
    value: float
    sigma: float
    paper: float
    fitted: Estimate
    lambda_V: Estimate | None

    @property
    def excess(self) -> float:
        """Fitted over predicted, less 1."""
        return self.fitted.value / self.value - 1


def predictions(joint: Fit) -> list[Prediction]:
    """Compare with the prediction each stiffness coefficient that the joint fit determines."""
    gain, gain_sigma = parameters.LAMBDA_V
    rows = []
    for kind, model in (("alpha_x", parameters.alpha_x), ("alpha_phi", parameters.alpha_phi)):
        for name in (f"{kind}_1", f"{kind}_2"):
            estimate = joint.parameters.get(name)
            if estimate is None:
                continue
            rows.append(
                Prediction(
                    name=name,
                    value=model(gain),
                    sigma=2 * gain_sigma / gain * abs(model(gain)),
                    paper=parameters.PREDICTED[kind],
                    fitted=estimate,
                    lambda_V=_gain_that_gives(estimate, model(1.0)),
                )
            )
    return rows


def _gain_that_gives(estimate: Estimate, at_one: float) -> Estimate | None:
    ratio = estimate.value / at_one
    if ratio <= 0:
        return None
    gain = math.sqrt(ratio)
    return Estimate(gain, gain * estimate.sigma / (2 * abs(estimate.value)), "1")


def _alphas(joint: Fit) -> Grid | None:
    lines = []
    for p in predictions(joint):
        head, exponent = parameter_head(joint_parameter(p.name))
        lines.append(
            Line(
                head,
                (
                    tables.number(p.value, p.sigma, exponent),
                    signed(p.paper / 10**exponent, 1 if exponent else 0),
                    tables.number(p.fitted.value, p.fitted.sigma, exponent),
                    f"{signed(100 * p.excess, 1)} %",
                    tables.number(p.lambda_V.value, p.lambda_V.sigma) if p.lambda_V else "–",
                ),
            )
        )
    gain, sigma = parameters.LAMBDA_V
    caption = (
        "Stiffness per unit of authority, from eqs alphax and alphaphi, with λ_V = "
        f"{gain} ± {sigma} (paper). The derivatives of the capacitance are a choice: "
        f"∂C/∂x {1e12 * parameters.DC_DX:.0f} pF/m, ∂²C/∂x² {1e9 * parameters.D2C_DX2:.0f} nF/m², "
        f"∂C/∂φ {1e12 * parameters.DC_DPHI:.1f} pF/rad, C_tot {1e12 * parameters.C_TOT:.1f} pF; "
        "the σ of the prediction is that of λ_V alone. Excess: fitted over predicted, less 1. Last column: "
        "the λ_V that makes the prediction the fitted value."
    )
    over = (
        "",
        "Predicted",
        "Paper's prediction",
        "Fitted",
        "Fitted / predicted − 1",
        Markup("λ<sub>V</sub> to match"),
    )
    return Grid(caption, over, tuple(lines)) if lines else None


def _budget(joint: Fit) -> Grid | None:
    fitted = [joint.parameters.get(f"omega2_{j}_0") for j in (1, 2)]
    if not any(fitted):
        return None

    def text(value: float) -> str:
        return signed(1e7 * value, 2)

    lines = [Line(escape(cause), tuple(map(text, values))) for cause, values in parameters.BUDGET.items()]
    totals = parameters.background()
    lines += [
        Line(Markup("<b>total</b>"), tuple(map(text, totals))),
        Line(Markup("fitted"), tuple(tables.number(e.value, e.sigma, -7) if e else None for e in fitted)),
        Line(
            Markup("difference"),
            tuple(
                f"{text(e.value - total)} ({signed(100 * (e.value / total - 1), 1)} %)" if e else "–"
                for e, total in zip(fitted, totals, strict=True)
            ),
        ),
    ]
    caption = (
        "Background stiffness in 10⁻⁷ s⁻² by its causes, from the paper's section Results, which calls 10 % "
        "consistent."
    )
    return Grid(caption, ("", tables.symbol("omega2_1_0"), tables.symbol("omega2_2_0")), tuple(lines))
