"""The warnings of a calibration: what each code means for a fit, and what to do about it.

Code that raises a warning, or judges a fit by one, looks it up here. Only the user reads the message.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple


class Severity(Enum):
    """What a warning does to the verdict on the fit it is raised in."""

    NOTE = "to be known, nothing more"
    DOUBT = "casts doubt on it"
    FAILURE = "spoils it"


@dataclass(frozen=True)
class Kind:
    """What all warnings of one code have in common.

    Attributes
    ----------
    advice : str
        What to do about it, in one sentence; words between backquotes are code.
    severity : Severity
        What it does to the verdict.
    words : str
        How the verdict names it; empty for a note.
    unsound : bool
        Whether the sigmas of the fit do not hold.
    biased : bool
        Whether its parameters differ from the truth by more than their sigmas tell.
    """

    advice: str
    severity: Severity = Severity.NOTE
    words: str = ""
    unsound: bool = False
    biased: bool = False


class Span(NamedTuple):
    """A stretch of a run, `begin` and `end` in seconds since its t0."""

    run: str
    begin: float
    end: float


@dataclass(frozen=True)
class FitWarning:
    """What the user must know before trusting a fit.

    Attributes
    ----------
    code, message : str
        Short identifier for programs, one of `KINDS`, and one plain sentence.
    parameters : tuple of str
        The parameters concerned.
    combination : mapping of str to float, optional
        Coefficients of the degenerate combination.
    spans : tuple of Span
        What was masked, or is a glitch that was taken out.
    """

    code: str
    parameters: tuple[str, ...]
    message: str
    combination: Mapping[str, float] | None = None
    spans: tuple[Span, ...] = ()

    @property
    def kind(self) -> Kind:
        """What its code stands for; results written elsewhere may hold one that nobody here knows."""
        return KINDS.get(self.code, _UNKNOWN)


def masked(warnings: Iterable[FitWarning], run: str) -> list[tuple[float, float]]:
    """Return begin and end [s] of what was masked in a run, or is a glitch that was taken out."""
    return [(span.begin, span.end) for w in warnings for span in w.spans if span.run == run]


_UNKNOWN = Kind(advice="")

#: By code: first what spoils a fit and what casts doubt on it, in the order in which a verdict tells them.
KINDS: Mapping[str, Kind] = {
    "not_converged": Kind(
        "Look for gaps, glitches or lines in the noise run, take another one or another `estimator` in "
        "the table [fit], and fit again; until then add 0.05 sigma to every error.",
        severity=Severity.FAILURE,
        words="Did not converge",
        unsound=True,
    ),
    "chi2": Kind(
        "Look where residual and noise part in the experiments' spectra: a peak at an injected frequency "
        "is something the model lacks, a raised floor a noise run that is too old or too quiet; do not "
        "trust the sigmas until it is found.",
        severity=Severity.FAILURE,
        words="χ² is off by more than 20 %, and sigmas by more than 10 %",
    ),
    "noise_mismatch": Kind(
        "Pair the experiment with a noise run of its own authority and season; if the excess lies at "
        "injected frequencies, the model lacks something.",
        severity=Severity.FAILURE,
        words="The noise is not that of the noise run",
        unsound=True,
    ),
    "contradiction": Kind(
        "Compare gain and stiffness of the experiments alone; exclude the odd one (`exclude` of the "
        "table [fit]) or let the gains scatter (`scatter`).",
        severity=Severity.FAILURE,
        words="The experiments contradict each other",
        unsound=True,
    ),
    "faulty": Kind(
        "Mend the file, or archive the run anew, and fit again; do not use this experiment by itself.",
        severity=Severity.FAILURE,
        words="The data are not what they say",
        unsound=True,
    ),
    "frame_contradicted": Kind(
        "Put `x_axis` into the files as the archive has it: `towards test mass 1` is the paper's frame, "
        "`towards test mass 2` the one meant without it; or check the sign of all channels along x.",
        severity=Severity.FAILURE,
        words="The telemetry is not in the frame it states",
        unsound=True,
    ),
    "controller_differs": Kind(
        "Put the controller that flew into the campaign (`[control]` or `[fmus]`): its gain and the gain of "
        "the actuation are one number to the read-out.",
        severity=Severity.FAILURE,
        words="The simulated controller is not the one that flew",
        unsound=True,
    ),
    "loop_contradicts": Kind(
        "See which FMU adds to what is named, or turns its sign round: to the read-out both are one number. "
        "If it is the equation that lacks something, let a campaign with these FMUs show it.",
        severity=Severity.FAILURE,
        words="The FMUs contradict the equation of motion",
        unsound=True,
    ),
    "bound_contradicted": Kind(
        "Widen `bounds` in the table [identify], or look for what the FMUs lack; do not use the estimates "
        "that are named, which compensate for the bound.",
        severity=Severity.FAILURE,
        words="The data contradict the bounds",
        unsound=True,
    ),
    "loop_differs": Kind(
        "See which of the two lacks something: look at chi2 of both, and at what the FMUs have that the "
        "equation of motion has not.",
        severity=Severity.DOUBT,
        words="The FMUs and the equation of motion differ",
    ),
    "another_loop": Kind(
        "Nothing if that is meant, such as a model of yours on telemetry of another; otherwise name the "
        "campaign and the FMUs that simulated the telemetry.",
        severity=Severity.DOUBT,
        words="The telemetry was simulated with another loop",
    ),
    "left_out": Kind(
        "Mend what is named and fit again; the fit of the others is not touched by it.",
        severity=Severity.DOUBT,
        words="Experiments are left out, whose data are not what they say",
    ),
    "changing": Kind(
        "Look at gain and delay by parts of the runs; let them scatter, or repeat the runs.",
        severity=Severity.FAILURE,
        words="Runs do not obey one equation from begin to end",
        unsound=True,
    ),
    "lagging": Kind(
        "Archive `o_1` anew, at the times of the other channels; until then trust no `delta_ifo` of these "
        "runs.",
        severity=Severity.FAILURE,
        words="o_1 is not of the time of the other channels",
        unsound=True,
    ),
    "bent": Kind(
        "Compare runs that move test mass 2 far and little; correct the read-out, or inject less.",
        severity=Severity.FAILURE,
        words="o_12 is not in proportion to the distance",
        unsound=True,
    ),
    "misguided": Kind(
        "Compare the units and scales of `o_1` and `guidance_o_1` in the archive; if the guidance is wrong, "
        "mend it or leave it out, and fit again.",
        severity=Severity.FAILURE,
        words="o_1 does not follow its guidance by one",
        unsound=True,
    ),
    "interpolated": Kind(
        "Archive the channels anew, as they were sampled.",
        severity=Severity.FAILURE,
        words="Samples are made from their neighbours",
        unsound=True,
    ),
    "coarse": Kind(
        "Archive the channels anew with more digits, in double precision, or with their offset subtracted.",
        severity=Severity.FAILURE,
        words="Channels are rounded too coarsely",
        unsound=True,
    ),
    "acausal": Kind(
        "Archive the channels anew, each at its own times; until then trust no delay.",
        severity=Severity.FAILURE,
        words="A command acts before it is given",
        unsound=True,
    ),
    "unjudged": Kind(
        "Fit with another estimator too: that one is judged, and its sigmas hold.",
        severity=Severity.DOUBT,
        words="Nobody looked whether the experiments contradict each other",
    ),
    "odd_samples": Kind(
        "See how the files were made: what most have in common is hardly an accident.",
        severity=Severity.DOUBT,
        words="Samples look as no instrument gives them",
    ),
    "centrifugal_strength": Kind(
        "Check the units of star tracker and torques, and the gain of the torques.",
        severity=Severity.DOUBT,
        words="The centrifugal term is not as strong as the rotation tells",
    ),
    "missing_run": Kind(
        "Read the log of the run in the folder logs, mend what it names and give the same command again; "
        "what is finished is kept.",
        severity=Severity.DOUBT,
        words="Experiments are missing, whose runs failed",
    ),
    "no_noise_run": Kind(
        "Record a noise run at the same authority next to the experiment and fit both together.",
        severity=Severity.DOUBT,
        words="Without a noise run χ² tells nothing",
    ),
    "too_many_glitches": Kind(
        "Treat the experiment as failed: repeat it, or pair it with a noise run of the same noise.",
        severity=Severity.DOUBT,
        words="Too many glitches to mask them",
        unsound=True,
    ),
    "saturated_too_long": Kind(
        "Repeat the run with a smaller injection or more authority; do not use this one.",
        severity=Severity.DOUBT,
        words="For too long at the limit of authority",
        unsound=True,
    ),
    "constraint_contradicted": Kind(
        "Release in the table [fit.parameters] what is named, or look for what the model lacks; do not use "
        "the estimates, which compensate for it.",
        severity=Severity.FAILURE,
        words="The data contradict what the settings say of parameters",
        unsound=True,
    ),
    "constrained": Kind(
        "Nothing if what the settings say holds; the other estimates and their sigmas rest on it.",
    ),
    "at_bound": Kind(
        "Nothing if the bound is known to hold; otherwise widen `bounds` in the table [identify], or `min` "
        "and `max` in [fit.parameters]. The other estimates hold only if the bound does.",
        severity=Severity.DOUBT,
        words="Parameters are held at their bounds",
    ),
    "attenuated": Kind(
        "Use these b_i to subtract the motion, not as couplings; a quieter inertial sensor or larger "
        "motion would bring them closer to the truth.",
        biased=True,
    ),
    "drift": Kind(
        "For the coupling at one date fit the experiments near it by themselves; the mean over the epoch is "
        "what subtracts best from all of them.",
    ),
    "correlation": Kind(
        "Nothing while the coefficients are below 0.9; above, move the spacecraft about phi and eta in "
        "one more experiment of the epoch.",
    ),
    "correction_adds_noise": Kind(
        "Use `delta_g_x` there; calibrate with noise runs of the same inertial period, so that rotation and "
        "cross-talk are told apart.",
    ),
    "degenerate_with_actuation_crosstalk": Kind(
        "Bound the actuation cross-talk by other means (ground calibration, a torque injection of its "
        "own) before reading the angles as a misalignment.",
    ),
    "euler_included": Kind(
        "Fit a noise run of 12 h or more with torques from the same inertial period along; until then "
        "subtract with these b_1 and b_2, but do not read them as couplings.",
        biased=True,
    ),
    "euler_separated": Kind(
        "Nothing to do; where Delta g is corrected, use b_1 and b_2 and the inertial fit together.",
    ),
    "excluded": Kind(
        "Nothing if that was intended; otherwise change `exclude` of the table [fit], or repeat the "
        "experiment at a quieter time.",
    ),
    "glitches": Kind(
        "Look at the residual at these times; if it is no glitch but signal, set `glitches = false` in "
        "the table [fit].",
    ),
    "indeterminable": Kind(
        "Add a run that injects or varies what is named here; `lpfcosim forecast` tells beforehand "
        "whether it suffices.",
    ),
    "instruments": Kind(
        "Nothing to do; read these b_i as couplings, and subtract the motion with those of the provenance "
        "(`subtraction`), as `lpfcosim deltag` does.",
    ),
    "levels": Kind(
        "Nothing if the noise may have changed since the noise run; with one that matches the sigmas would "
        "be a little smaller.",
    ),
    "louder": Kind(
        "Nothing if the spacecraft may have moved more than in the noise run; otherwise look at the spectrum "
        "of o_1 above 0.1 Hz: motion falls off there, noise of a read-out does not.",
    ),
    "no_star_tracker": Kind(
        "Archive the star tracker (ast_theta, ast_eta, ast_phi or ast_q_1 to ast_q_4) along with the run.",
    ),
    "no_torsional_stiffness": Kind(
        "Put the attributes into the telemetry files if the torsional stiffness is known.",
    ),
    "noise_run_lacks": Kind(
        "Archive the same read-outs in the noise run as in the experiment.",
    ),
    "not_calibrated": Kind(
        "Calibrate with a run that determines them before relying on a Delta g where they matter.",
    ),
    "not_fitted_alone": Kind(
        "Nothing for the joint fit; to have this experiment by itself, inject more strongly, for longer "
        "or at more frequencies.",
    ),
    "rests_on_one_run": Kind(
        "Trust it as far as you trust that run; a second one of its kind would be a check.",
    ),
    "guidance": Kind(
        "See whether guidance and read-outs are of the same run; the fit takes nothing from guidance, but "
        "read-outs of another run would be fitted under a wrong name.",
        severity=Severity.DOUBT,
        words="Read-outs do not answer the guidance",
    ),
    "rounding": Kind(
        "Nothing while estimates move by less than you need; otherwise archive the channel with more digits.",
    ),
    "same_time": Kind(
        "Put the start of every run into its attribute t0; the fit does not use it.",
    ),
    "saturated": Kind(
        "Nothing if little is lost; otherwise lower the injection or give the run more authority.",
    ),
    "one_test_mass": Kind(
        "Archive torques and wavefront angles of both test masses: each then tells the noise of the other.",
    ),
    "scatter": Kind(
        "Quote the mean with this sigma; to use an experiment on its own, take its own value instead of "
        "the joint one.",
    ),
    "short_run": Kind(
        "Run it for 6 h or more, or let it take part with `include_short = true` in the table [fit] "
        "(`lpfcosim fit --include-short`).",
    ),
    "single_tone": Kind(
        "Nothing if the other experiments determine the rest; otherwise inject a second frequency at "
        "least three times lower or higher.",
    ),
    "stepped_back": Kind(
        "Nothing to do if the search ended well; start values closer to the result spare it.",
    ),
    "star_tracker_reversed": Kind(
        "Check the convention of the archive: quaternions turn J2000 into the body's frame, scalar last.",
    ),
    "torque_noise": Kind(
        "Take runs with quieter torques, or in which the spacecraft turns more; read the angles as lower "
        "bounds until then.",
        biased=True,
    ),
    "torque_alone": Kind(
        "Archive the wavefront angles (o_phi_1, o_eta_1 and their differences) along with the torques.",
    ),
    "unsound": Kind(
        "Fit the telemetry once more with this version.",
        severity=Severity.FAILURE,
        words="The file says that it is not sound",
        unsound=True,
    ),
    "unsteady": Kind(
        "Nothing if the noise may have changed; look at the residual of the run if it should not have.",
    ),
    "wrong_sign": Kind(
        "Check sign and unit of the channel in the archive, or of the map that reads it.",
        unsound=True,
    ),
}
