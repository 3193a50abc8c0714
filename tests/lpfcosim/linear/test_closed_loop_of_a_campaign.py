"""`lpfcosim.closed_loop`."""

import numpy as np

import lpfcosim


def test_loop_of_a_run_has_names_units_and_sample_time(quickstart):
    campaign = lpfcosim.load_campaign(quickstart)
    loop = lpfcosim.closed_loop(campaign, campaign.runs[1].name)
    system = loop.linearize()
    assert system.dt == 0.1
    assert system.A.shape == (len(system.A), len(system.A))
    assert system.B.shape == (len(system.A), len(system.inputs))
    assert system.C.shape == (len(system.outputs), len(system.A))
    assert (system.units["guidance_o_12"], system.units["f_x_2"]) == ("m", "m/s2")
    assert np.abs(system.poles()).max() < 1
