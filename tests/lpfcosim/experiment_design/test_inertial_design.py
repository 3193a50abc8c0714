"""Hours of the inertial calibration, where sigmas are known by a formula of their own."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import inertial_design
from tests import ROOT

DAY = 86400.0
FLOOR = 1e-6


@pytest.fixture(scope="module")
def plan():
    return loading.load(ROOT / "campaigns" / "inertial.toml")


def seconds(plan, period):
    noisy = [e for e in plan.experiments if not e.n_samples and e.inertial_period == period]
    return [e.n_noise_samples / 10 for e in noisy]


def sigma(time):
    return float(np.sqrt(FLOOR**2 + (1e-5) ** 2 * DAY / time))


def formula(plan):
    return {f"delta_phi_{k}": sigma(sum(seconds(plan, k))) for k in (1, 2, 3)}


MODEL = SimpleNamespace(sigmas=formula)


@pytest.mark.parametrize("expected", [3e-6, 4.5e-6, 9e-6])
def test_the_hours_are_those_of_the_formula(plan, expected):
    result, angles = inertial_design.shorten_noise_runs(plan, {"delta_phi_2": expected}, MODEL)
    least = (1e-5) ** 2 * DAY / (expected**2 - FLOOR**2)
    assert angles.sigmas_after["delta_phi_2"] <= expected
    assert sum(seconds(result, 2)) == pytest.approx(least, rel=0.02)
    assert angles.durations == (6 * DAY, sum(seconds(result, 2)))
    assert seconds(result, 1) == seconds(plan, 1)
    assert [e for e in result.experiments if e.n_samples] == [e for e in plan.experiments if e.n_samples]


def test_runs_that_would_be_too_short_are_left_out(plan):
    result, _ = inertial_design.shorten_noise_runs(plan, {"delta_phi_3": sigma(DAY)}, MODEL)
    assert seconds(result, 3) == [pytest.approx(DAY / 2, rel=0.02)] * 2
    result, _ = inertial_design.shorten_noise_runs(plan, {"delta_phi_3": 1.0}, MODEL)
    assert seconds(result, 3) == [43200.0]


def test_what_no_hours_reach_is_told(plan):
    with pytest.raises(InputError, match=r"design.sigmas: delta_phi_1: beyond reach, with 1440 h of noise"):
        inertial_design.shorten_noise_runs(plan, {"delta_phi_1": 0.9 * FLOOR}, MODEL)
    tones_alone = replace(plan, experiments=tuple(e for e in plan.experiments if e.n_samples))
    still = SimpleNamespace(sigmas=lambda of: {"delta_phi_1": 1e-5})
    with pytest.raises(InputError, match="delta_phi_1: no noise run determines them"):
        inertial_design.shorten_noise_runs(tones_alone, {"delta_phi_1": 1e-5}, still)
