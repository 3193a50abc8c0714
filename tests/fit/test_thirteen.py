"""The fit on telemetry of a closed loop that shares no code with it, and that loop on Newton's equation."""

import numpy as np
import pytest

from tests.oracles import closed_loop
from tests.oracles.closed_loop import Drive, Noise, Plant

QUIET = Noise(plateau=0.0, tail=0.0, oms=0.0, thruster=0.0, jitter=0.0)
PLANT = Plant(1.07, 1.08, 0.14, 0.17, -1.2e-6, -1.9e-6, 3e-3)


def phasor(values, time, f):
    """The complex amplitude of a sine."""
    basis = np.stack([np.cos(2 * np.pi * f * time), np.sin(2 * np.pi * f * time), np.ones(time.size)], axis=1)
    cosine, sine, _ = np.linalg.lstsq(basis, values, rcond=None)[0]
    return cosine - 1j * sine


@pytest.mark.parametrize("channel", ["guidance_1", "guidance_12", "force_1"])
@pytest.mark.parametrize("f", [2e-3, 0.05])
def test_a_steady_sine_obeys_newton(channel, f):
    amplitude = 1e-12 if channel == "force_1" else 1e-9
    tones = ((0.0, f, amplitude, round(40000 * f)),)
    found = closed_loop.record(PLANT, QUIET, Drive(**{channel: tones}), 40000.0, [0])
    time = np.arange(30000, 40000) / 1.0
    x = {name: phasor(values[30000:], time, f) for name, values in found.items()}
    x_1 = x["o_1"]
    s = 2j * np.pi * f
    delta_x = x["o_12"] - PLANT.delta_ifo * x_1
    # amplitudes of held commands, which act late by transport and half a hold
    act_1 = PLANT.lambda_1 * x["f_x_1"] * np.sinc(0.1 * f) * np.exp(-s * PLANT.delay_1)
    act_2 = PLANT.lambda_2 * x["f_x_2"] * np.sinc(0.1 * f) * np.exp(-s * PLANT.delay_2)
    force = act_2 - act_1 - PLANT.omega2_2 * (delta_x + x_1) + PLANT.omega2_1 * x_1
    # sampling at 10 Hz folds the images of the hold back: 4e-5 of the force at 50 mHz
    assert abs(s**2 * delta_x - force) < 1e-4 * max(abs(act_2), abs(act_1), abs(s**2 * x_1) * 1e-6)
