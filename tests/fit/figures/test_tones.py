"""The figure of the tones of a design."""

import numpy as np

from fit.figures import tones


def test_tones_are_drawn_by_what_they_are_for():
    f = np.geomspace(1e-3, 0.1, 5)
    information = {"lambda_2": f, "C_2": 2 * f, "omega2_1_0": 1 / f, "alpha_x_2": 2 / f}
    chosen = [
        ("A: F_x_2", 3e-2, {"C_2": 1.5, "lambda_2": 1.1}),
        ("A: guidance_o_1", 2e-3, {"alpha_x_2": 1.02}),
        ("B: F_x_2", 5e-2, {}),
    ]
    information_panel, growth_panel = tones.tones(f, information, chosen).panels
    assert [mark.name for mark in information_panel.marks] == ["gains", "delays", "stiffness"]
    np.testing.assert_array_equal(information_panel.marks[-1].y, 2 / f)
    places = {mark.name: (mark.x[0], mark.y[0], mark.names[0]) for mark in growth_panel.marks}
    assert places["tones for delays"] == (3e-2, 50.0, "A: F_x_2")
    assert places["tones for waveform"][1] == 0.1
    assert growth_panel.up[0] < 0.1 < 50 < growth_panel.up[1]
