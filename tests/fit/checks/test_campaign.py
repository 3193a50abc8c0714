"""What follows from findings: who is left out of the joint fit, and what is a finding of all."""

from dataclasses import replace

import pytest

from fit.errors import FitError
from fit.findings import Finding
from fit.whitening import pair
from tests.fit.checks.campaigns import campaign
from tests.oracles import synthetic

NAMES = "ABCDE"
RUNS = [run for name in NAMES for run in synthetic.pair(synthetic.World(), name, duration=7200.0)]
CAMPAIGN = campaign(pair(RUNS))


def found(code, names):
    return [
        Finding(code, f"{name}-noise.h5: it is so, {n} times", f"{name}-noise")
        for n, name in enumerate(names)
    ]


@pytest.mark.parametrize(
    ("code", "names", "left_out"),
    [
        ("glitches", "AB", ""),  # a note
        ("invalid_data", "ABCD", "ABCD"),
        ("interpolated", "AB", "AB"),
        ("interpolated", "ABC", ""),  # common to most
        ("drift", "A", "A"),
        ("drift", "AB", ""),
        ("too_many_glitches", "ABCD", "ABCD"),
        ("too_many_glitches", "ABCDE", ""),
    ],
)
def test_the_kind_says_how_many_are_left_out(code, names, left_out):
    decided = CAMPAIGN.decide(found(code, names))
    assert decided.faulty == set(left_out)
    assert [e.name for e in decided.in_joint_fit] == [name for name in NAMES if name not in left_out]
    for name in names:
        (finding,) = decided.of_run(name)
        assert finding.code == code
    assert {f.run for f in decided.of_joint if f.code == "rejected"} == set(left_out)


def test_a_fit_without_more_than_a_third_of_the_experiments_is_not_sound():
    def codes(names):
        return [
            f.code for f in CAMPAIGN.decide(found("invalid_data", names)).of_joint if f.code != "rejected"
        ]

    assert codes("A") == []
    assert codes("AB") == ["too_many_exclusions"]


def test_what_is_found_in_a_span_is_masked_and_what_adapts_a_fit_has_it_fitted_anew():
    fitted = replace(CAMPAIGN, fits=dict.fromkeys(NAMES, FitError("none")))
    spans = ((600.0, 660.0), (1200.0, 1260.0))
    decided = fitted.decide(
        [Finding("glitches", "two", "B-noise", spans=spans), Finding("marginalised_noise", "", "C")]
    )
    assert decided.experiments["B"].noise.masks == spans
    assert not decided.experiments["B"].sysid.masks
    assert decided.experiments["C"].marginalised
    assert decided.fits.keys() == {"A", "D", "E"}
