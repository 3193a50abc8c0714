"""Faults that leave a fit running and its sigmas wrong: signs, noise that does not match, contradictions."""

from collections.abc import Mapping, Sequence

import numpy as np

from fit.errors import FitError, InputError
from fit.estimate.irls import Outcome
from fit.estimate.runs import Experiment
from fit.results import Fit, FitWarning
from fit.signal import spectra
from fit.telemetry import Telemetry

OFF = (
    1.5  # factor between chi2 and its degrees of freedom beyond which sigmas, off by 22 %, are no longer told
)
PLAUSIBLE = (0.7, 1.5)  # gains between; a wrong sign or unit, N for m s-2 included, is beyond
FOLLOWED = (5e-4, 0.02)  # Hz: here the drag-free loop makes o_1 follow its guidance


def check_guidance(telemetry: Telemetry) -> None:
    """Refuse a run whose o_1 moves against the guidance that it follows.

    Raises
    ------
    InputError
        If it does.
    """
    if not {"o_1", "guidance_o_1"} <= telemetry.channels.keys():
        return
    guidance, o_1 = (np.nan_to_num(telemetry.channels[name]) for name in ("guidance_o_1", "o_1"))
    if np.ptp(guidance) <= 1e-9 * np.max(np.abs(guidance)):
        return  # constant
    every = np.ones(o_1.size, dtype=bool)
    pair = np.stack([guidance - guidance.mean(), o_1 - o_1.mean()], axis=1)
    found = spectra.transform(pair, every, telemetry.fs)
    tones = np.abs(found.columns[:, 0]) > 0.1 * np.max(np.abs(found.columns[:, 0]))
    G, answer = found.columns[tones & (found.f > FOLLOWED[0]) & (found.f < FOLLOWED[1])].T
    power, answered = np.vdot(G, G).real, np.vdot(answer, answer).real
    if not power or abs(np.vdot(G, answer)) ** 2 < 0.9 * power * answered:
        return  # no tone there, or none that o_1 answers
    gain = np.vdot(G, answer).real / power
    if gain < -0.5:
        raise InputError(
            f"{telemetry.path}: o_1 moves against guidance_o_1, by {gain:.2f} times; expected it to follow: "
            "one of the two has the wrong sign"
        )


def check_gains(outcomes: Mapping[str, Outcome], experiments: Sequence[Experiment]) -> None:
    """Refuse runs that fit, on their own, with a gain that no actuator has.

    Raises
    ------
    InputError
        If there are any; which channel it must be is said where that can be told.
    """
    wrong = [e for e in experiments if e.name in outcomes and wrong_gain(outcomes[e.name])]
    if wrong:
        paths = ", ".join(str(e.sysid.telemetry.path) for e in wrong)
        raise InputError(f"{paths}: {wrong_gain(outcomes[wrong[0].name])}")


def wrong_gain(outcome: Outcome) -> str:
    """Return what is wrong with a channel, told by a gain that no actuator has; empty if there is none."""
    gains = _gains(outcome)
    wrong = [name for name, value in gains.items() if not PLAUSIBLE[0] < value < PLAUSIBLE[1]]
    if not wrong:
        return ""
    force = f"f_x_{wrong[0][-1]}"
    culprit = "o_12" if len(wrong) == 2 else force if len(gains) == 2 else f"o_12 or {force}"
    value = gains[wrong[0]]
    return (
        f"{culprit} has the wrong {'sign' if value < 0 else 'unit'}: {wrong[0]} comes out as {value:.3g}, "
        "expected about 1 with o_12 = x_2 - x_1 in m and forces along +x in m s-2"
    )


def _gains(outcome: Outcome) -> dict[str, float]:
    """Return the gains that the data determine."""
    sigma = np.sqrt(np.diag(outcome.solution.covariance))
    return {
        p.name: float(outcome.solution.theta[i])
        for i, p in enumerate(outcome.parameters)
        if p.name in ("lambda_1", "lambda_2") and not outcome.lost[i] and sigma[i] < 0.1
    }


def suspects(alone: Mapping[str, Outcome | FitError]) -> str:
    """Return words on the experiments that could keep a joint fit from settling, empty if there are none."""
    told = [
        f"{name} alone does not fit either"
        if isinstance(own, FitError)
        else f"{name} alone leaves {own.solution.chi2 / own.solution.dof:.3g} times the power of the noise"
        for name, own in alone.items()
        if isinstance(own, FitError) or own.solution.chi2 > OFF * own.solution.dof
    ]
    return f"; {' and '.join(told)}: mend or exclude it ([fit] exclude)" if told else ""


def is_off(fit: Fit) -> bool:
    """Return whether chi2 and its degrees of freedom have nothing to do with each other."""
    return not 1 / OFF < fit.chi2 / max(fit.dof, 1) < OFF


def of_experiment(experiment: Experiment, outcome: Outcome, fit: Fit) -> list[FitWarning]:
    """Doubt the signs and units of an experiment that was fitted on its own, and its noise run."""
    wrong = wrong_gain(outcome)
    if wrong:
        return [FitWarning("wrong_sign", (), f"{experiment.name}: {wrong}")]
    if experiment.noise is None or not is_off(fit):
        return []
    excess = fit.chi2 / fit.dof
    cause = (
        "its noise run does not match it, or the equation lacks something"
        if excess > 1
        else ("its noise run is louder than the run itself and does not match it")
    )
    message = (
        f"{experiment.name}: the residual has {excess:.3g} times the power of the noise run: {cause}; the "
        "sigmas do not hold"
    )
    return [FitWarning("noise_mismatch", (), message)]


def of_joint(joint: Fit, fits: Mapping[str, Fit], taking_part: Sequence[Experiment]) -> list[FitWarning]:
    """Doubt the joint fit for the sake of its experiments, or for what they say together."""
    mismatched = [
        e.name
        for e in taking_part
        if e.name in fits and any(w.code == "noise_mismatch" for w in fits[e.name].warnings)
    ]
    if mismatched:
        names = ", ".join(mismatched)
        message = f"the noise of {names} is not that of the noise run, which weights and sigmas rest on"
        return [FitWarning("noise_mismatch", (), message)]
    if is_off(joint):
        message = (
            f"each experiment fits on its own, all together leave {joint.chi2 / joint.dof:.3g} times the "
            "power of the noise: what they are said to share differs between them; the sigmas do not hold"
        )
        return [FitWarning("contradiction", (), message)]
    return []
