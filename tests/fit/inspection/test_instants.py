"""What a change gains at every instant is what least squares say that try one instant after the other."""

import numpy as np
import pytest

from fit.inspection.instants import Stretch
from fit.signal import spectra
from fit.weighing import linear


def series(count, n, seed):
    return np.cumsum(np.random.default_rng(seed).standard_normal((count, n)), axis=1)


def by_trial(valid, fs, S, known, series, begins):
    """Return what each begin gains, by spectra and least squares of numpy: of ours is only the window."""
    n = valid.size
    w = spectra.window(valid, fs)
    bins = slice(S.first, S.first + S.f.size)

    def whitened(x):
        X = np.fft.rfft(x * w)[bins] / np.sqrt(S.density)
        return np.concatenate([X.real, X.imag])

    always = [whitened(np.ones(n)), whitened(np.arange(n)), *map(whitened, known)]
    y = whitened(series[0])

    def left(columns):
        A = np.stack(columns, axis=1)
        A /= np.linalg.norm(A, axis=0)
        r = y - A @ np.linalg.lstsq(A, y)[0]
        return r @ r

    scale = 4 / (fs * (w @ w))
    new = [[whitened(x * (np.arange(n) >= i)) for x in series[1:]] for i in begins]
    return np.array([scale * (left(always) - left([*always, *more])) for more in new])


class Density:
    """The PSD of the noise at the bins of some spectra."""

    def __init__(self, terms):
        self.first, self.f = terms.first, terms.f
        self.density = 1e-3 * (1 + (2e-3 / terms.f) ** 2)


@pytest.mark.parametrize("gap", [None, (3000, 3100)], ids=["whole", "gap"])
def test_gains_are_those_of_trial(gap):
    n, fs = 8000, 1.0
    valid = np.ones(n, dtype=bool)
    if gap:
        valid[slice(*gap)] = False
    x, known = series(3, n, 1), series(2, n, 2)
    terms = spectra.transform(np.stack([x[0], *known], axis=1), valid, fs)
    assert terms.window.size == n
    S = Density(terms)
    U = linear.stacked(linear.whiten(terms, S.density)[0])
    Q = np.linalg.qr(U[:, 1:])[0]
    stretch = slice(2900, 3400)
    found = Stretch(terms, S.density, Q, U[:, 0] - Q @ (Q.T @ U[:, 0]), stretch).gains(x[1:])
    begins = [2900, 2950, 3050, 3200, 3399]
    expected = by_trial(valid, fs, S, known, x, begins)
    np.testing.assert_allclose(found[np.array(begins) - stretch.start], expected, rtol=1e-9)
