"""LTPDA's iteratively reweighted least squares, compared with its definition."""

import numpy as np
from scipy.signal import get_window

from fit.fitting import ltpda_flscov
from fit.model import dynamics
from fit.spacecraft import DELTA_G
from fit.whitening import Run
from tests.oracles.synthetic import World, telemetry


def test_flscov_is_weighted_least_squares_on_averaged_residuals():
    """Compare with one periodogram after another; delays and stiffness of test mass 1 are zero."""
    run = Run(telemetry(World()))
    theta = np.array([0.0, 1.0776, 0.0, 0.186, -1e-6, 0.0, -2.2e-5])
    terms = run.columns(dynamics.delays(theta))
    c = dynamics.coefficients(theta, terms.tau)
    block, _ = ltpda_flscov.block(terms, DELTA_G, np.eye(7), c)
    N, fs = len(terms.values), terms.fs
    n = int(N / (1 + 9 * 0.339))
    w = get_window("blackmanharris", n, fftbins=True)
    S, spectra = 0.0, []
    for k in range(10):
        start = min(round(k * round(n * 0.339)), N - n)
        segment = terms.values[start : start + n]
        line = np.fft.rfft(w[:, None] * segment, axis=0) / np.sqrt(fs * np.sum(w**2) / 2)
        f = np.fft.rfftfreq(n, 1 / fs)
        line = line[(np.arange(f.size) >= 4) & (np.arange(f.size) % 4 == 0) & (f <= 0.1)]
        spectra.append(line)
        S = S + np.abs(line @ c) ** 2 / 10
    normal = sum((x.conj().T / S @ x).real for x in spectra) * 2
    size = np.sqrt(np.outer(np.diag(normal), np.diag(normal)))
    size[size == 0] = 1.0  # the force on test mass 1 is zero
    for information in (block.R.T @ block.R, block.M):  # bins and segments count as independent
        assert np.abs((information - normal) / size).max() < 1e-9
