"""Arguments that cannot be right: each is refused with an `InputError` of one sentence, before any work."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import fit
import lpfcosim
from fit.results import Estimate, Fit, Provenance, Results

FIT = Fit({"C_2": Estimate(0.2, 0.1, "s")}, np.array([[0.01]]), 1.0, 1, True, ())
RESULTS = Results(FIT, {"A": FIT}, {}, {}, Provenance())


@pytest.mark.parametrize(
    ("act", "expected"),
    [
        (lambda: fit.load("missing.h5"), "missing.h5: no such file"),
        (lambda: fit.calibrate([]), "no telemetry: no run of kind 'sysid'"),
        (lambda: fit.calibrate([], estimator="magic"), 'calibrate.estimator: "magic"'),
        (lambda: fit.load("a\0b"), "expected a path, which has no NUL"),
        (lambda: fit.calibrate("telemetry"), "calibrate: runs: 'telemetry', expected a list of Telemetry"),
        (lambda: fit.save_report(None, [], "folder"), "save_report: results: None, expected Results"),
        (lambda: fit.delta_chi2(1, 2), "delta_chi2: 1, expected an lmfit MinimizerResult"),
        (lambda: RESULTS.experiments["A"]["Z"], "Z is no parameter of this fit"),
        (lambda: RESULTS.save(None), "save: path: None, expected a file in a folder that exists"),
        (lambda: fit.save_report(RESULTS, [], __file__), "is a file, expected a folder"),
        (lambda: fit.plot.spectra(None, [], "A"), "plot: results: None, expected Results"),
        (lambda: fit.plot.stiffness(RESULTS, []), "no experiment determines omega2_2 alone"),
    ],
)
def test_wrong_arguments_are_refused_in_one_sentence(act, expected):
    with pytest.raises(fit.InputError, match=re.escape(expected)) as raised:
        act()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"truth": {"C_2": math.nan}}, "truth.C_2"),
        ({"truth": {"C_2": "x"}}, "truth.C_2"),
        ({"seed": "x"}, "seed"),
        ({"experiments": ()}, "experiments"),
        ({"fit": 3}, "fit"),
    ],
)
def test_a_campaign_with_wrong_values_is_refused(quickstart, change, message):
    with pytest.raises(fit.InputError, match=re.escape(f"Campaign: {message}: ")):
        replace(lpfcosim.load_campaign(quickstart), **change)
