"""The table of the kinds of findings: severity, what the verdict says, what is left out, what to do."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Literal


class Severity(Enum):
    """Effect of a finding on the verdict on its fit."""

    NOTE = "for information"
    DOUBT = "casts doubt on the fit"
    FAILURE = "makes the fit unusable"


@dataclass(frozen=True)
class Kind:
    """What all findings of one code have in common.

    Attributes
    ----------
    advice : str
        What to do about it, if the message does not say it; words between backquotes are code.
    severity : Severity
        Effect on the verdict.
    headline : str
        How the verdict names it; empty for a note.
    unsound : bool
        Whether the standard deviations of the fit are invalid.
    biased : bool
        Whether its parameters may differ from the truth by more than their standard deviations suggest.
    excludes : float
        Largest share of the experiments that it leaves out of the joint fit, 0 if it leaves none out. What
        more of them have is not theirs alone: it is a finding of the joint fit. Infinite where no fit of them
        is possible.
    adapts : str
        Attribute of an experiment that it sets, so that the fit allows for it.
    """

    advice: str = ""
    severity: Severity = Severity.NOTE
    headline: str = ""
    unsound: bool = False
    biased: bool = False
    excludes: float = 0.0
    adapts: Literal["", "marginalised", "readout_excess"] = ""


#: A note without advice, of the codes of other versions.
UNKNOWN = Kind()
_ALL_BUT_ONE = 1.0  # share of the experiments that a kind excludes

#: By code; failures and doubts come first, in the order in which a verdict lists them.
KINDS: Mapping[str, Kind] = {
    "not_converged": Kind(
        "Look for gaps, glitches or lines in the noise run, use another noise run or another `estimator` in "
        "the table [fit], and repeat the fit; until then add 0.05 sigma to every error.",
        Severity.FAILURE,
        "Did not converge",
        unsound=True,
    ),
    "chi2": Kind(
        "Compare the residual with the noise in the spectra of the experiments: a peak at an injected "
        "frequency is an effect missing from the model, a raised floor means that the noise run does not "
        "represent the noise; do not rely on the sigmas until the cause is known.",
        Severity.FAILURE,
        "χ² is off by more than chance makes it",
    ),
    "no_estimate": Kind(
        "Inject more, longer or at more frequencies; check the units of channels and attributes.",
        Severity.FAILURE,
        "Determines no parameter",
        unsound=True,
    ),
    "noise_mismatch": Kind(
        "Pair the experiment with a noise run of the same authority and season; if the excess lies at "
        "injected frequencies, an effect is missing from the model.",
        Severity.FAILURE,
        "The noise is not that of the noise run",
        unsound=True,
        excludes=1 / 2,
    ),
    "model_misfit": Kind(
        "Look for what acts at the injections and is not recorded: guidance that leaks into a read-out, an "
        "actuator that is not linear, an unrecorded force; do not use the estimates until it is found.",
        Severity.FAILURE,
        "The equation of motion lacks a signal at the injections",
        unsound=True,
    ),
    "contradiction": Kind(
        "Compare gain and stiffness of the fits of single experiments; exclude the outlier (`exclude` of the "
        "table [fit]) or fit the gains as random effects (`scatter`).",
        Severity.FAILURE,
        "The experiments contradict each other",
        unsound=True,
        excludes=math.inf,
    ),
    "too_many_exclusions": Kind(
        "Find what the experiments that are left out have in common, correct or repeat them, and repeat the "
        "fit; those that are left need not be the right ones.",
        Severity.FAILURE,
        "More than a third of the experiments are left out",
        unsound=True,
    ),
    "invalid_data": Kind(
        "Correct the file, the archive or the map that reads it, and repeat the fit; do not use this "
        "experiment by itself.",
        Severity.FAILURE,
        "The data are not what their labels say",
        unsound=True,
        excludes=math.inf,
    ),
    "implausible_gain": Kind(
        "Correct unit or sign of the channel in the archive or the map that reads it, and repeat the fit.",
        Severity.FAILURE,
        "A gain is not that of an actuator",
        unsound=True,
        excludes=math.inf,
    ),
    "misfit": Kind(
        "Compare the channels with those of the other experiments; do not use this one.",
        Severity.FAILURE,
        "The channels do not follow the equation of motion",
        unsound=True,
        excludes=math.inf,
    ),
    "frame_contradicted": Kind(
        "Set `x_axis` in the files to the frame of the archive: `towards test mass 1` is that of the paper, "
        "`towards test mass 2` the default; or check the sign of all channels along x.",
        Severity.FAILURE,
        "The telemetry is not in the frame that it states",
        unsound=True,
    ),
    "loop_contradiction": Kind(
        "Find the FMU that adds to the named parameters or reverses a sign: the read-outs determine only the "
        "product. If the equation of motion lacks an effect, show it by a campaign with these FMUs.",
        Severity.FAILURE,
        "The FMUs contradict the equation of motion",
        unsound=True,
    ),
    "loop_discrepancy": Kind(
        "Find out which of the two lacks an effect: compare their chi2, and look for effects that only the "
        "FMUs have.",
        Severity.DOUBT,
        "The FMUs and the equation of motion differ",
    ),
    "rejected": Kind(
        "Correct the named data and repeat the fit; the fit of the other experiments does not use them.",
        Severity.DOUBT,
        "Experiments with invalid data are left out",
    ),
    "drift": Kind(
        "Look for a gain or a delay that follows the temperature, drifts or jumps, and compare fits of parts "
        "of the runs; do not use the estimates until it is found.",
        Severity.FAILURE,
        "Gains, delays or stiffness change within runs",
        unsound=True,
        excludes=1 / 3,
    ),
    "guidance_scale": Kind(
        "Compare units and scales of `o_1` and `guidance_o_1` in the archive; if the guidance is wrong, "
        "correct or omit it, and repeat the fit.",
        Severity.FAILURE,
        "The gain from guidance to o_1 is not one",
        unsound=True,
        excludes=1 / 2,
    ),
    "interpolated": Kind(
        "Archive the channels again without interpolation.",
        Severity.FAILURE,
        "Samples are interpolated",
        unsound=True,
        excludes=1 / 2,
    ),
    "implausible_delay": Kind(
        "Archive the channels again with the correct times of each; until then do not use any delay.",
        Severity.FAILURE,
        "A delay is not that of an actuator",
        unsound=True,
    ),
    "consistency_untested": Kind(
        "Repeat the fit with another estimator, for which consistency is tested and the sigmas are valid.",
        Severity.DOUBT,
        "The consistency of the experiments is not tested",
    ),
    "centrifugal_strength": Kind(
        "Check the units of star tracker and torques, and the gain of the torques.",
        Severity.DOUBT,
        "The centrifugal term does not match the rotation",
    ),
    "missing_run": Kind(
        "Read the log of the run in the folder logs, remove the cause that it names and give the same "
        "command again; finished runs are not repeated.",
        Severity.DOUBT,
        "Experiments are missing because their runs failed",
    ),
    "wavefront_channels": Kind(
        "Check signs and names of the wavefront sensing of the assemblies named, in the file and where it "
        "comes from; their coefficients are those of another channel or sign.",
        Severity.FAILURE,
        "Channels of wavefront sensing are not what they are labelled as",
        unsound=True,
    ),
    "light_times": Kind(
        "Check the light travel times, and the time stamps of wavefront sensing and beat notes.",
        Severity.FAILURE,
        "The light travel times are not those of the response",
        unsound=True,
    ),
    "missing_variables": Kind(
        "Nothing if a link is lost; the coefficients of its two assemblies need one that is not.",
        Severity.DOUBT,
        "Michelson variables are missing",
    ),
    "no_noise_run": Kind(
        "Record a noise run at the same authority next to the experiment and fit both together.",
        Severity.DOUBT,
        "Without a noise run χ² does not test the fit",
    ),
    "too_many_glitches": Kind(
        "Treat the experiment as failed: repeat it, or pair it with a noise run of the same noise.",
        Severity.DOUBT,
        "Too many glitches to mask them",
        unsound=True,
        excludes=_ALL_BUT_ONE,
    ),
    "saturated_too_long": Kind(
        "Repeat the run with a smaller injection or more authority; do not use this one.",
        Severity.DOUBT,
        "Too long at the limit of authority",
        unsound=True,
        excludes=_ALL_BUT_ONE,
    ),
    "constraint_contradicted": Kind(
        "Remove the named constraints from [fit.parameters], or widen `bounds` in [identify], or look for an "
        "effect missing from the model; do not use the estimates, which compensate for it.",
        Severity.FAILURE,
        "The data contradict constraints on parameters",
        unsound=True,
    ),
    "at_bound": Kind(
        "Nothing if the bound is known to be true; otherwise widen `bounds` in the table [identify], or "
        "`min` and `max` in [fit.parameters]. The other estimates are valid only if the bound is.",
        Severity.DOUBT,
        "Parameters are at their bounds",
    ),
    "attenuation_bias": Kind(
        "Use these b_i to subtract the motion, not as couplings; a quieter inertial sensor or larger "
        "motion would reduce the bias.",
        biased=True,
    ),
    "degenerate_with_actuation_crosstalk": Kind(
        "Bound the actuation cross-talk by other means (ground calibration, a dedicated torque injection) "
        "before interpreting the angles as a misalignment."
    ),
    "euler_included": Kind(
        "Include a noise run of 12 h or more with torques from the same inertial period; until then "
        "subtract with these b_1 and b_2, but do not interpret them as couplings.",
        biased=True,
    ),
    "excluded": Kind(excludes=math.inf),
    "glitches": Kind(
        "Inspect the residual at these times; if it is signal and no glitch, set `glitches = false` in "
        "the table [fit]."
    ),
    "indeterminable": Kind(
        "Add a run that injects or varies the named quantity; `lpfcosim forecast` shows in advance whether "
        "it suffices."
    ),
    "instrumental_variables": Kind(
        "Nothing to do; these b_i are couplings; subtract the motion with those of the provenance "
        "(`subtraction`), as `lpfcosim deltag` does."
    ),
    "marginalised_noise": Kind(adapts="marginalised"),
    "wavefront_noise": Kind(
        "State `dws_asd` in the file of measurements; or move more, so that the noise does not count."
    ),
    "readout_excess_noise": Kind(adapts="readout_excess"),
    "short_run": Kind(
        "Extend the run to 6 h or more, or include it by `include_short = true` in the table [fit] "
        "(`lpfcosim fit --include-short`).",
        excludes=math.inf,
    ),
    "star_tracker_reversed": Kind(
        "Check the convention of the archive: quaternions rotate J2000 to the body frame, scalar last."
    ),
    "torque_noise": Kind(
        "Use runs with quieter torques or larger rotation; until then the angles are lower bounds.",
        biased=True,
    ),
    "unsound_file": Kind(
        "Fit the telemetry again with this version.",
        Severity.FAILURE,
        "The file states that its fit is unsound",
        unsound=True,
    ),
    **dict.fromkeys(
        (
            "attenuation",
            "constrained",
            "correlation",
            "cross_talk_drift",
            "euler_separated",
            "high_leverage",
            "no_single_fit",
            "no_star_tracker",
            "no_torsional_stiffness",
            "no_wavefront_angle",
            "noise_run_channel_missing",
            "not_calibrated",
            "one_test_mass",
            "random_effects",
            "saturated",
            "step_halved",
        ),
        Kind(),
    ),  # notes whose message says all
    **dict.fromkeys(
        (
            "averaging",
            "gain by force",
            "guidance leak",
            "label",
            "lag",
            "non-linearity",
            "scale",
            "sign",
            "stiffness",
            "unit",
            "unrecorded force",
        ),
        Kind("Correct it in the archive, or in what writes it, and repeat the fit."),
    ),  # what explains other findings
}
