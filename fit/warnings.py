"""What to do about each warning of a calibration, one sentence by code."""

ADVICE = {
    "attenuated": (
        "Use these b_i to subtract the motion, not as couplings; a quieter inertial sensor or larger motion "
        "would bring them closer to the truth."
    ),
    "chi2": (
        "Look where residual and noise part in the experiments' spectra: a peak at an injected frequency is "
        "something the model lacks, a raised floor a noise run that is too old or too quiet; do not trust "
        "the sigmas until it is found."
    ),
    "contradiction": (
        "Compare gain and stiffness of the experiments alone; exclude the odd one (`exclude` of the table "
        "[fit]) or let the gains scatter (`scatter`)."
    ),
    "correlation": (
        "Nothing while the coefficients are below 0.9; above, move the spacecraft about phi and eta in one "
        "more experiment of the epoch."
    ),
    "degenerate_with_actuation_crosstalk": (
        "Bound the actuation cross-talk by other means (ground calibration, a torque injection of its own) "
        "before reading the angles as a misalignment."
    ),
    "euler_included": (
        "Fit a noise run of 12 h or more with torques from the same inertial period along; until then "
        "subtract with these b_1 and b_2, but do not read them as couplings."
    ),
    "euler_separated": (
        "Nothing to do; where Delta g is corrected, use b_1 and b_2 and the inertial fit together."
    ),
    "excluded": (
        "Nothing if that was intended; otherwise change `exclude` of the table [fit], or repeat the "
        "experiment at a quieter time."
    ),
    "glitches": (
        "Look at the residual at these times; if it is no glitch but signal, set `glitches = false` in the "
        "table [fit]."
    ),
    "indeterminable": (
        "Add a run that injects or varies what is named here; `lpfcosim forecast` tells beforehand whether "
        "it suffices."
    ),
    "missing_run": (
        "Read the log of the run in the folder logs, mend what it names and give the same command again; "
        "what is finished is kept."
    ),
    "no_noise_run": "Record a noise run at the same authority next to the experiment and fit both together.",
    "no_star_tracker": (
        "Archive the star tracker (ast_theta, ast_eta, ast_phi or ast_q_1 to ast_q_4) along with the run."
    ),
    "no_torsional_stiffness": (
        "Put the attributes into the telemetry files if the torsional stiffness is known."
    ),
    "noise_mismatch": (
        "Pair the experiment with a noise run of its own authority and season; if the excess lies at "
        "injected frequencies, the model lacks something."
    ),
    "noise_run_lacks": "Archive the same read-outs in the noise run as in the experiment.",
    "not_calibrated": (
        "Calibrate with a run that determines them before relying on a Delta g where they matter."
    ),
    "not_converged": (
        "Look for gaps, glitches or lines in the noise run, take another one or another `estimator` in the "
        "table [fit], and fit again; until then add 0.05 sigma to every error."
    ),
    "not_fitted_alone": (
        "Nothing for the joint fit; to have this experiment by itself, inject more strongly, for longer or "
        "at more frequencies."
    ),
    "saturated": "Nothing if little is lost; otherwise lower the injection or give the run more authority.",
    "saturated_too_long": "Repeat the run with a smaller injection or more authority; do not use this one.",
    "scatter": (
        "Quote the mean with this sigma; to use an experiment on its own, take its own value instead of the "
        "joint one."
    ),
    "short_run": (
        "Run it for 6 h or more, or let it take part with `include_short = true` in the table [fit] "
        "(`lpfcosim fit --include-short`)."
    ),
    "single_tone": (
        "Nothing if the other experiments determine the rest; otherwise inject a second frequency at least "
        "three times lower or higher."
    ),
    "star_tracker_reversed": (
        "Check the convention of the archive: quaternions turn J2000 into the body's frame, scalar last."
    ),
    "too_many_glitches": (
        "Treat the experiment as failed: repeat it, or pair it with a noise run of the same noise."
    ),
    "wrong_sign": "Check sign and unit of the channel in the archive, or of the map that reads it.",
    "torque_alone": (
        "Archive the wavefront angles (o_phi_1, o_eta_1 and their differences) along with the torques."
    ),
}
