"""Test of the equation of motion in all runs together, before anything is masked or left out.

Every run is whitened by the PSD of its noise run and fitted with coefficients of its own, so that runs need
not agree on anything. Where they are driven, the residual of a model that holds has the power of the noise
around it. More than that is signal that the equation lacks: a mask or a glitch template would hide it, and a
joint fit would put it into gains and stiffness. It may be a template whose amount is the same in all runs
(`templates.MODEL_TEMPLATES`) and that accounts for most of the misfit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from fit.consistency.fault_templates import MODEL_TEMPLATES, RunSeries, Template
from fit.consistency.score_test import ScoreTest
from fit.false_alarms import chi2_limit, p_limit, sigma_limit
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.parameters import DELAYS
from fit.quality import MODEL_MISFIT, initial_fit
from fit.spacecraft import DELTA_G
from fit.spectra import windowing
from fit.warnings import Cause, FitWarning, either
from fit.whitening import Experiment, Run, whitened_run

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DRIVEN = 14.0  # amplitude of o_12'' in units of the noise, from which a bin is driven
NEIGHBOURS = 60  # bins at most that give the level of the noise around a driven one
MIN_NEIGHBOURS = 8  # half of them below it: the lowest bins have no level, and do not count
EFFECTIVE = 0.3  # degrees of freedom of that level by those of the driven bins: neighbours are shared
WIDESPREAD = 1 / 3  # of the runs: a misfit of so many is one of the model
MIN_RUNS = 3  # with a misfit that no template accounts for; of fewer runs all
ACCOUNTED = 0.8  # share of the misfit that a template must account for
CHANCE = 3.0  # standard deviations of the sum of the power, that noise may make
INDISTINCT, DELTA_CHI2 = 0.01, 10.0  # share of Delta chi^2, and more, up to which templates are alike
MAX_DELAY = 3.0  # times the delays of the flight; no actuator comes near
ITERATIONS = 4  # of parameters that equations share, nearly linear
PRECISE = 0.05  # s, standard deviation of a delay that is compared with those of the flight


@dataclass(frozen=True)
class RunMisfit:
    """The residual of a run with coefficients of its own.

    Attributes
    ----------
    experiment : Experiment
        The run.
    f : ndarray, shape (B,)
        Frequencies [Hz].
    driven : ndarray of bool, shape (B,)
        Which bins are driven.
    sine_amplitude : ndarray, shape (B,)
        Amplitude [m s^-2] of a sine that lasts all of the run and has the whitened amplitude 1.
    test : ScoreTest
        Of further effects, 2 B rows.
    variance : float
        By how much the window makes amounts vary more than independent bins would.
    delays : ndarray, shape (2, 2)
        Delay [s] and standard deviation of the commands of test masses 1 and 2.
    information, scores : ndarray, shape (Q,)
        ``e' P e`` and ``e' P r`` of every template e, see `score_test`.
    effects : ndarray, shape (2 B, Q)
        Whitened, of the templates.
    """

    experiment: Experiment
    f: Array
    driven: Flags
    sine_amplitude: Array
    test: ScoreTest
    variance: float
    delays: Array
    information: Array
    scores: Array
    effects: Array

    def power(self, amounts: Array | None = None) -> Array:
        """Return the power of the residual without some amounts of the templates, 1 for noise, shape (B,)."""
        r = self.test.residual
        if amounts is not None:
            r = r - self.test.project(self.effects @ amounts)
        return np.asarray(np.sum(r.reshape(-1, 2) ** 2, axis=1) / 2)

    def relative_power(self) -> Array:
        """Return the power of driven bins by the level of the noise, that of the noise run at least.

        The level is the mean of the next undriven bins or the median of as many bins below as above, if the
        noise departs from its model at the lowest frequencies: all of these may be driven.
        """
        power, n = self.power(), self.driven.size
        driven = np.flatnonzero(self.driven)
        driven = driven[(driven >= MIN_NEIGHBOURS // 2) & (driven < n - MIN_NEIGHBOURS // 2)]
        half = np.minimum(np.minimum(driven, n - 1 - driven), NEIGHBOURS // 2)
        medians = [np.median(power[i - m : i + m + 1]) for i, m in zip(driven, half, strict=True)]
        level = np.maximum(np.array(medians) / np.log(2), 1.0)
        undriven = np.flatnonzero(~self.driven)
        if undriven.size >= NEIGHBOURS:
            sums = np.concatenate([[0.0], np.cumsum(power[undriven])])
            begin: NDArray[np.intp] = np.clip(
                np.searchsorted(undriven, driven) - NEIGHBOURS // 2, 0, undriven.size - NEIGHBOURS
            )
            level = np.maximum(level, (sums[begin + NEIGHBOURS] - sums[begin]) / NEIGHBOURS)
        return np.asarray(power[driven] / level)

    def beyond_noise(self, amounts: Array | None = None) -> float:
        """Return the excess over all bins, as far as the noise does not make it, whatever its level."""
        power = self.power(amounts)
        level = max(1.0, float(np.median(power)) / np.log(2))
        chance = float(np.sqrt(self.variance * power.size))
        return max(0.0, float(np.sum(power / level - 1)) - CHANCE * chance)

    @cached_property
    def p(self) -> float:
        """Return an upper limit of how often noise makes the excess as large.

        The level of the noise, that of the noise run at least, comes from bins that driven ones share, with
        few degrees of freedom (`EFFECTIVE`): p of twelve clean runs was 0.66 to 0.98.
        """
        ratios = self.relative_power()
        dof = 2 * ratios.size / self.variance
        return float(scipy.special.fdtrc(dof, EFFECTIVE * dof, np.mean(ratios))) if dof else 1.0


@dataclass(frozen=True)
class CommonEffect:
    """A template with one amount in all runs.

    Attributes
    ----------
    template : Template
        Which.
    size, sigma : float
        Amount.
    accounted : float
        Share of the misfit that it accounts for.
    scatters : bool
        Whether the amounts of the runs differ by more than noise makes them.
    epoch : int or None
        Alignment epoch of the runs; None for all.
    run : str
        Name of the only run that determines it; empty if several do.
    """

    template: Template
    size: float
    sigma: float
    accounted: float
    scatters: bool
    epoch: int | None = None
    run: str = ""

    @property
    def z(self) -> float:
        """Size in standard deviations."""
        return abs(self.size) / self.sigma


def model_warnings(experiments: Sequence[Experiment]) -> list[FitWarning]:
    """Return warnings of what the equation of motion lacks in all runs.

    Parameters
    ----------
    experiments : sequence of Experiment
        As they were read, without masks. Those without a noise run do not count.
    """
    measured = [e for e in experiments if e.noise is not None]
    if not measured:
        return []
    series = [e.sysid.channels.series for e in measured]
    forces = [[float(np.abs(x.get(f"f_x_{j}", np.zeros(1))).max()) for j in (1, 2)] for x in series]
    largest = (max(f for f, _ in forces), max(f for _, f in forces))
    runs = parallel_map(lambda e: run_misfit(e, largest), measured, Experiment.samples)
    delays = _delay_warnings(runs)
    if common := common_effects(runs):
        return [_template_warning(common, largest), *delays]
    limit = p_limit("driven bins", len(runs))
    misfits = [run for run in runs if run.p < limit]
    if len(misfits) >= max(min(MIN_RUNS, len(runs)), WIDESPREAD * len(runs)):
        return [_force_warning(misfits, len(runs)), *delays]
    return delays


def run_misfit(
    experiment: Experiment,
    largest_force: tuple[float, float],
    templates: Sequence[Template] = MODEL_TEMPLATES,
) -> RunMisfit:
    """Fit a run with parameters of its own and take the products of templates with its residual.

    Parameters
    ----------
    experiment : Experiment
        With a noise run.
    largest_force : tuple of float
        See `RunSeries`.
    templates : sequence of Template
        All of them by default; those of other equations are left out.
    """
    run = experiment.sysid
    tau = initial_fit.initial_fit(run).tau
    terms = run.spectra(tau)
    PSDs = [initial_fit.initial_noise_psd(experiment, k).expected(terms.f) for k in range(len(run.equations))]
    whitened = [
        whitened_run.as_real(whitened_run.whiten(equation.spectra(terms), S)[0])
        for equation, S in zip(run.equations, PSDs, strict=True)
    ]
    signal = np.concatenate([U[:, 0] for U in whitened])
    w, f, S = terms.window, np.tile(terms.f, len(PSDs)), np.concatenate(PSDs)
    misfit = RunMisfit(
        experiment=experiment,
        f=f,
        driven=np.linalg.norm(signal.reshape(-1, 2), axis=1) > DRIVEN * np.sqrt(2),
        sine_amplitude=np.sqrt(S * (w @ w) * run.channels.fs) / w.sum(),
        test=_refitted(run, whitened, tau),
        variance=windowing.variance_factor(w),
        delays=np.array([(t, np.inf) for t in tau]),
        information=np.zeros(0),
        scores=np.zeros(0),
        effects=np.zeros((2 * f.size, 0)),
    )
    if [equation.name for equation in run.equations] != [DELTA_G.name]:  # whose templates these are
        return misfit
    test, columns = misfit.test, run.columns(tau)
    series = RunSeries(run, columns, np.array([1.0, *-test.refit.amounts]), largest_force)
    added = [template.effect(series) for template in templates]
    values = np.stack([np.zeros(len(columns.values)) if x is None else x for x in added], axis=1)
    effects = whitened_run.as_real(whitened_run.whiten(run.transformed(values, columns), S)[0])
    independent = test.independent(effects)
    rms = max(1.0, float(np.sqrt(np.mean(test.residual**2))))  # beyond noise, the delays are less precise
    return replace(
        misfit,
        delays=_delays(tau, series.coefficients, test.refit.sigmas * rms),
        information=np.sum(independent**2, axis=0),
        scores=independent.T @ test.residual,
        effects=effects,
    )


def _refitted(run: Run, whitened: Sequence[Array], tau: tuple[float, float]) -> ScoreTest:
    """Return the residual of the whitened columns of each equation, its parameters refitted."""
    if len(whitened) == 1:  # a coefficient for each parameter
        return ScoreTest(whitened[0][:, 0], whitened[0][:, 1:])
    names = run.channels.parameters
    values = {p.name: p.value for p in run.spacecraft.parameters(run.telemetry, names)}
    theta = np.array([values[name] for name in names])
    for _ in range(ITERATIONS):
        pairs = list(zip(whitened, run.equations, strict=True))
        residual = np.concatenate([U @ e.coefficients(theta, tau) for U, e in pairs])
        test = ScoreTest(residual, np.concatenate([U @ e.gradient(theta, tau) for U, e in pairs]))
        theta = theta - test.refit.amounts
    return test


def common_effects(runs: Sequence[RunMisfit]) -> list[CommonEffect]:
    """Return the template that accounts for what is in all runs, and those as likely; empty without one."""
    epochs: dict[int, list[RunMisfit]] = {}
    runs = [run for run in runs if run.information.size]
    for run in runs:
        epochs.setdefault(run.experiment.sysid.telemetry.alignment_epoch, []).append(run)
    effects = []
    for i, template in enumerate(MODEL_TEMPLATES if runs else ()):
        if template.by_epoch:
            effects += [_common_effect(of_epoch, i, template, k) for k, of_epoch in epochs.items()]
        else:
            effects.append(_common_effect(runs, i, template))
    limit = sigma_limit("templates", len(effects))
    possible = [e for e in effects if e.z > limit and e.accounted > ACCOUNTED and not e.scatters]
    possible = [e for e in possible if e.template.admits(e.size, e.sigma)]
    possible.sort(key=lambda e: -e.z)
    if possible and (epoch_template := possible[0].template).by_epoch:
        return [e for e in possible if e.template is epoch_template]
    return [e for e in possible if e.z**2 > possible[0].z ** 2 * (1 - INDISTINCT) - DELTA_CHI2]


def _common_effect(
    runs: Sequence[RunMisfit], i: int, template: Template, epoch: int | None = None
) -> CommonEffect:
    """Return the common amount of a template, the i-th that runs were tested for."""
    sums = np.array([(run.information[i], run.scores[i]) for run in runs])
    amounts = np.zeros(runs[0].effects.shape[1])
    information, score = sums.sum(axis=0)
    if not information > 0:
        return CommonEffect(template, 0.0, np.inf, 0.0, scatters=True, epoch=epoch)
    amounts[i] = score / information
    # misfit beyond the template counts as noise
    noise = [run.variance * max(1.0, float(np.mean(run.power(amounts)))) for run in runs]
    weights = sums / np.array(noise)[:, None]
    information, score = weights.sum(axis=0)
    amounts[i] = size = score / information
    total, remainder = (sum(run.beyond_noise(a) for run in runs) for a in (None, amounts))
    accounted = 1 - remainder / total if total else 1.0
    z2 = size**2 * information
    contributions = _ratio(weights[:, 1] ** 2, weights[:, 0])
    scatter = float(np.sum(contributions)) - z2  # Cochran's Q of the amounts
    largest = int(np.argmax(contributions))
    single = np.sum(np.delete(contributions, largest)) < chi2_limit(
        "templates", len(runs), len(MODEL_TEMPLATES)
    )
    limit = chi2_limit("templates", max(len(runs) - 1, 1), len(MODEL_TEMPLATES)) + INDISTINCT * z2
    return CommonEffect(
        template,
        float(size),
        float(information**-0.5),
        accounted,
        bool(scatter > limit),
        epoch,
        runs[largest].experiment.name if single else "",
    )


def _template_warning(effects: Sequence[CommonEffect], largest_force: tuple[float, float]) -> FitWarning:
    """Return the warning of the best template and those that the data do not distinguish from it."""
    causes = []
    for effect in effects:
        template = effect.template
        force = largest_force[int(template.channel[-1]) - 1] if template.kind == "gain by force" else 0.0
        scope = "" if effect.epoch is None else f" in the runs of alignment epoch {effect.epoch}"
        causes.append(template.cause(effect.size, effect.sigma, effect.run, scope=scope, force=force))
    run = effects[0].run
    if effects[0].template.by_epoch:
        found = " and ".join(cause.words for cause in causes)
    else:
        found = f"{either(causes)}, {f'shown by {run} alone' if run else 'in all runs alike'}"
    message = f"{found}; the equation of motion does not contain that, and the uncertainties are not valid"
    return FitWarning(MODEL_MISFIT, (), message, causes=tuple(causes))


def _ratio(squares: Array, information: Array) -> Array:
    return np.divide(squares, information, out=np.zeros_like(squares), where=information > 0)


def _force_warning(misfits: Sequence[RunMisfit], n_runs: int) -> FitWarning:
    """Return the warning of a force that many runs do not record, with its strongest tone in each of them."""
    causes = tuple(_strongest_tone(run) for run in misfits)
    words = ", ".join(f"{c.run} ({c.words}, {c.size:.2g} m s-2)" for c in causes)
    message = (
        f"{len(misfits)} of {n_runs} runs contain forces at the injections that no channel records: {words};"
        " no known effect explains them, the equation of motion is incomplete, and the uncertainties are "
        "not valid"
    )
    return FitWarning(MODEL_MISFIT, (), message, causes=causes)


def _strongest_tone(run: RunMisfit) -> Cause:
    """Return the amplitude of Delta g at the driven bin that exceeds the noise most."""
    power = np.where(run.driven, run.power(), 0.0)
    peak = int(np.argmax(power))
    amplitude = float(run.sine_amplitude[peak] * np.sqrt(2 * power[peak]))
    words = f"at {1e3 * run.f[peak]:.3g} mHz"
    return Cause(run.experiment.name, "", "unrecorded force", amplitude, None, "m s-2", words)


def _delays(tau: tuple[float, float], c: Array, sigmas: Array) -> Array:
    """Return delay and standard deviation [s] of both commands, shape (2, 2); infinite if not determined."""
    delays = np.empty((2, 2))
    for j, columns in enumerate(dynamics.FORCES):
        gain, slope = columns.start, columns.start + 1
        if c[gain] == 0:
            delays[j] = tau[j], np.inf
        else:
            delays[j] = tau[j] - c[slope] / c[gain], sigmas[slope - 1] / abs(c[gain])
    return delays


def _delay_warnings(runs: Sequence[RunMisfit]) -> list[FitWarning]:
    """Return a warning of delays that no actuator has."""
    delays = np.array([run.delays for run in runs])
    late = {}
    for j, flight in enumerate(DELAYS):
        precise = delays[delays[:, j, 1] < PRECISE, j, 0]
        if precise.size and np.median(precise) > MAX_DELAY * flight:
            late[j + 1] = float(np.median(precise))
    if not late:
        return []
    extra = float(np.mean([tau - DELAYS[j - 1] for j, tau in late.items()]))
    span = 2 * extra + dynamics.LOOP_PERIOD  # of n samples, whose mean is late by (n - 1) / 2 of them
    measured = " and ".join(f"{tau:.3g} s for f_x_{j}" for j, tau in late.items())
    words = f"the read-outs seem to be averaged over {span:.2g} s"
    cause = Cause("", "o_1 o_12", "averaging", span, None, "s", words)
    message = (
        f"the delay C / lambda is {measured}, more than {MAX_DELAY:g} times that of the flight: {words}, or "
        "the commands are early in the files; the equation of motion lacks an average, and gains are biased"
    )
    return [FitWarning(MODEL_MISFIT, tuple(f"C_{j}" for j in late), message, causes=(cause,))]
