"""Test of the equation of motion in all runs together, before anything is masked or left out.

Every run is whitened by the PSD of its noise run and fitted with coefficients of its own, so that runs need
not agree on anything. Where they are driven, the residual of a model that holds has the power of the noise
around it. More than that is signal that the equation lacks: a mask or a glitch template would hide it, and a
joint fit would put it into gains and stiffness. It may be a template whose amount is the same in all runs
(`common_effects`), most of the misfit or a significant part of it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fit.consistency.common_effects import CommonEffect, common_effects, significant_effects
from fit.consistency.run_misfit import RunMisfit, run_misfit
from fit.false_alarms import p_limit
from fit.findings import Finding, either
from fit.model import dynamics
from fit.parallel import parallel_map
from fit.parameters import DELAYS
from fit.quality import MODEL_MISFIT
from fit.whitening import Experiment

Array = NDArray[np.float64]

WIDESPREAD = 1 / 3  # of the runs: a misfit of so many is one of the model
MIN_RUNS = 3  # with a misfit that no template accounts for; of fewer runs all
MAX_DELAY = 3.0  # times the delays of the flight; no actuator comes near
PRECISE = 0.05  # s, standard deviation of a delay that is compared with those of the flight


def model_warnings(experiments: Sequence[Experiment]) -> list[Finding]:
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
    significant = significant_effects(runs)
    if common := common_effects(significant):
        return [_template_warning(common, largest), *delays]
    limit = p_limit("driven bins", len(runs))
    misfits = [run for run in runs if run.p < limit]
    if len(misfits) >= max(min(MIN_RUNS, len(runs)), WIDESPREAD * len(runs)):
        return [_force_warning(misfits, len(runs)), *delays]
    of_several = [effect for effect in significant if not effect.run]
    return [*map(_partial_warning, of_several[:1]), *delays]


def _template_warning(effects: Sequence[CommonEffect], largest_force: tuple[float, float]) -> Finding:
    """Return the warning of the best template and those that the data do not distinguish from it."""
    causes = []
    for effect in effects:
        template = effect.template
        force = largest_force[int(template.channel[-1]) - 1] if template.kind == "gain by force" else 0.0
        scope = "" if effect.epoch is None else f" in the runs of alignment epoch {effect.epoch}"
        causes.append(template.cause(effect.size, effect.sigma, effect.run, scope=scope, force=force))
    run = effects[0].run
    if effects[0].template.by_epoch:
        found = " and ".join(cause.message for cause in causes)
    else:
        found = f"{either(causes)}, {f'shown by {run} alone' if run else 'in all runs alike'}"
    message = f"{found}; the equation of motion does not contain that, and the uncertainties are not valid"
    return Finding(MODEL_MISFIT, message, causes=tuple(causes))


def _partial_warning(effect: CommonEffect) -> Finding:
    """Return the warning of a template that all runs contain, though it is not all of their misfit."""
    words = effect.template.cause(effect.size, effect.sigma).message
    message = (
        f"the residuals of all runs have a part in common, {effect.z:.1f} sigma of what they would have if "
        f"{words}; that does not account for all of it, and no known effect does; the equation of motion is "
        "incomplete, and the uncertainties are not valid"
    )
    return Finding(MODEL_MISFIT, message)


def _force_warning(misfits: Sequence[RunMisfit], n_runs: int) -> Finding:
    """Return the warning of a force that many runs do not record, with its strongest tone in each of them."""
    causes = tuple(_strongest_tone(run) for run in misfits)
    words = ", ".join(f"{cause.run} ({cause.message})" for cause in causes)
    message = (
        f"{len(misfits)} of {n_runs} runs contain forces at the injections that no channel records: {words};"
        " no known effect explains them, the equation of motion is incomplete, and the uncertainties are "
        "not valid"
    )
    return Finding(MODEL_MISFIT, message, causes=causes)


def _strongest_tone(run: RunMisfit) -> Finding:
    """Return the amplitude of Delta g at the driven bin that exceeds the noise most."""
    power = np.where(run.driven, run.power(), 0.0)
    peak = int(np.argmax(power))
    amplitude = float(run.sine_amplitude[peak] * np.sqrt(2 * power[peak]))
    message = f"at {1e3 * run.f[peak]:.3g} mHz, {amplitude:.2g} m s-2"
    return Finding("unrecorded force", message, run.experiment.name)


def _delay_warnings(runs: Sequence[RunMisfit]) -> list[Finding]:
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
    cause = Finding("averaging", words, channel="o_1 o_12")
    message = (
        f"the delay C / lambda is {measured}, more than {MAX_DELAY:g} times that of the flight: {words}, or "
        "the commands are early in the files; the equation of motion lacks an average, and gains are biased"
    )
    return [Finding(MODEL_MISFIT, message, parameters=tuple(f"C_{j}" for j in late), causes=(cause,))]
