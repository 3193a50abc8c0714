"""Amplitudes of glitches from the few samples that they reach, against those of whole columns."""

import numpy as np
import pytest

from fit.quality.whitened_templates import WhitenedTemplates
from fit.whitening.glitch_templates import Glitch, Shape

N, FS, SEED = 6000, 1.0, 3


@pytest.fixture(scope="module")
def view():
    rng = np.random.default_rng(SEED)
    f = np.arange(1, N // 10 + 1) * FS / N
    window = np.sin(np.pi * (np.arange(N) + 0.5) / N) ** 2
    window[2500:2520] = 0.0
    Q = np.linalg.qr(rng.standard_normal((2 * f.size, 3)))[0]
    residual = rng.standard_normal(2 * f.size)
    S = 1 + (3e-3 / f) ** 2 + (f / 0.03) ** 4
    time = 20.0 + np.arange(N) / FS
    return WhitenedTemplates(
        time, FS, f, S, window, residual - Q @ (Q.T @ residual), Q, is_own_psd=False, known=()
    )


def plainly(view, glitch):
    """Return the column of a glitch, by a transform that is written out and far longer than the run."""
    shape, M = glitch.shape, 16 * N
    f = np.arange(M // 2 + 1) * FS / M
    s = 2j * np.pi * f * shape.tau
    main = {"double_exponential": 1 / (1 + s), "bipolar": s / (1 + s), "reversed": 1 / (1 - s)}[shape.kind]
    spectrum = main / (1 + shape.ratio * s) * np.exp(-((f / 0.2) ** 4))
    series = np.fft.irfft(spectrum * np.exp(-2j * np.pi * f * (glitch.begin - view.time[0])), M)[:N]
    bins = np.fft.rfft(series * view.window)[1 : view.f.size + 1] / np.sqrt(view.S)
    column = np.stack([bins.real, bins.imag], axis=1).ravel()
    column -= view.Q @ (view.Q.T @ column)
    return column / np.linalg.norm(column)


def test_amplitudes_are_those_of_whole_columns(view):
    # short ones, two of them beside the mask, and long ones
    glitches = [
        Glitch(Shape("double_exponential", 30.0, 0.0), 2000.3),
        Glitch(Shape("double_exponential", 33.0, 0.4), 2010.0),
        Glitch(Shape("double_exponential", 30.0, -0.5), 2001.0),
        Glitch(Shape("bipolar", 40.0, 1.0), 2480.0),
        Glitch(Shape("reversed", 35.0, 0.2), 2540.7),
        Glitch(Shape("double_exponential", 300.0, 1.0), 2000.0),
        Glitch(Shape("bipolar", 60.0, 0.1), 2100.0),
    ]
    columns = np.array([plainly(view, glitch) for glitch in glitches])
    np.testing.assert_allclose(view.amplitudes(glitches), columns @ view.residual, atol=1e-9)


def test_a_glitch_that_is_projected_out_has_no_amplitude(view):
    glitch, second = (Glitch(Shape("double_exponential", tau), 2000.0) for tau in (30.0, 60.0))
    column = view.column(glitch)
    assert column is not None
    assert np.isnan(view.project_out(column).amplitudes([glitch, second])).tolist() == [True, False]
