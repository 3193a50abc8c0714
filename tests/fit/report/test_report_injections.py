"""The table of injections."""

from dataclasses import replace

import numpy as np
import pytest

from fit.report.injections import injections, table
from tests.oracles import synthetic


@pytest.mark.parametrize(
    ("frequency", "cycles"), [(0.833e-3, 1), (0.833e-3, 2), (3.333e-3, 5), (53.33e-3, 24)]
)
def test_frequency_of_a_sine_is_exact_in_print(frequency, cycles):
    fs, start = 10.0, 300.0
    time = np.arange(round((2 * start + cycles / frequency) * fs)) / fs - start
    is_on = (time >= 0) & (time < cycles / frequency)
    (injection,) = injections(np.where(is_on, 1e-8 * np.sin(2 * np.pi * frequency * time), 0.0), fs)
    assert injection.begin == pytest.approx(start, abs=1.0)
    assert injection.frequencies == pytest.approx((frequency,), rel=2e-3)


def test_tones_of_one_injection_are_separated():
    time = np.arange(60000) / 10.0
    tones = (2e-3, 3e-3, 10e-3)
    (injection,) = injections(sum(np.sin(2 * np.pi * f * time + f) for f in tones), 10.0)
    assert injection.frequencies == pytest.approx(tones, rel=2e-3)


def test_response_of_a_controller_to_noise_is_not_an_injection():
    run, noise_run = synthetic.pair(synthetic.World(), "A", drive_1=1e-12)
    response = 1e-15 * np.random.default_rng(1).standard_normal(run.size)
    noise_run, quiet = (
        replace(r, channels={**r.channels, "f_x_1": response[: r.size]}) for r in (noise_run, run)
    )
    assert "f_x_1" not in [row[0] for row in table(quiet, noise_run).rows]
    assert "f_x_1" in [row[0] for row in table(run, noise_run).rows]
