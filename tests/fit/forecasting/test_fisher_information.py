"""What an experiment tells frequency by frequency is what the forecast of its tones says."""

from dataclasses import replace

import numpy as np
import pytest

from fit.forecasting import fisher_information
from fit.forecasting.expected_fit import expected_fit
from fit.settings import settings
from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop
from lpfcosim.planned_experiments import planned_experiments
from lpfcosim.spacecraft import Sine
from tests import ROOT

TONES = (
    Sine("guidance_o_12", 5e-9, 18 / 21000, 18, 300.0, 0.3, 1000.0),
    Sine("guidance_o_1", 6e-9, 63 / 21000, 63, 300.0, 1.0, 1000.0),
    Sine("F_x_2", 1e-12, 840 / 21000, 840, 300.0, 2.0, 1000.0),
)


@pytest.fixture(scope="module")
def plan():
    campaign = loading.load(ROOT / "campaigns" / "quickstart.toml")
    return replace(
        campaign, experiments=tuple(replace(e, injections=TONES) for e in campaign.experiments[::3])
    )


def test_information_of_tones_is_that_of_the_forecast(plan):
    expected = expected_fit(planned_experiments(plan))
    bare = replace(plan, experiments=tuple(replace(e, injections=()) for e in plan.experiments))
    campaign = fisher_information.fisher_information(planned_experiments(bare), settings())
    undetermined = np.array([name not in expected.parameters for name in campaign.names])
    information = np.diag(np.where(undetermined, campaign.widths**-2.0, 0.0))
    t = np.linspace(0, 21600, 5000)
    window = np.clip(np.minimum(t - 300, 21300 - t) / 1000, 0, 1)
    power = (0.5 - 0.5 * np.cos(np.pi * window)) ** 2
    for experiment, run in zip(
        campaign.experiments, (r for r in plan.runs if r.kind == "sysid"), strict=True
    ):
        s = ClosedLoop(run).linearize()
        information += experiment.information
        for tone in TONES:
            f = np.array([tone.frequency])
            H = s.frequency_response(f)[0, :, s.inputs.index(tone.into)]
            signal = H[[s.outputs.index(name) for name in experiment.channels]] * tone.amplitude
            d = experiment.sensitivity(f)[0] @ signal
            information += experiment.equivalent_duration(power) * np.outer(d.conj(), d).real
    sigma = dict(zip(campaign.names, np.sqrt(np.diag(np.linalg.inv(information))), strict=True))
    for name, estimate in expected.parameters.items():
        assert sigma[name] == pytest.approx(estimate.sigma, rel=0.01), name


def test_a_tone_clear_of_the_window_is_worth_its_time(plan):
    (experiment, _) = fisher_information.fisher_information(planned_experiments(plan), settings()).experiments
    power = np.zeros(20000)
    power[4000:12000] = 1.0
    assert experiment.equivalent_duration(power) == pytest.approx(0.4 * experiment.duration, rel=1e-3)
    falling = power * np.linspace(1, 0, power.size)  # as much as its energy
    expected = np.mean(falling) * experiment.duration
    assert experiment.equivalent_duration(falling) == pytest.approx(expected, rel=1e-3)
    assert experiment.equivalent_duration(np.ones(20000)) < 0.96 * experiment.duration
