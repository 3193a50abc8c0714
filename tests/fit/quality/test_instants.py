"""What a change gains at every instant is what least squares say that try one instant after the other."""

import numpy as np
import pytest

from fit.quality.instants import Stretch
from fit.spectra import windowing
from fit.whitening import whitened_run

N = 8000


def walks(count, seed):
    return np.cumsum(np.random.default_rng(seed).standard_normal((count, N)), axis=1)


class Density:
    """The PSD of the noise at the bins of some spectra."""

    def __init__(self, terms):
        self.first, self.f = terms.first, terms.f
        self.density = 1e-3 * (1 + (2e-3 / terms.f) ** 2)


def by_trial(valid, fs, S, known, columns, begins):
    """Return what each begin gains, by spectra and least squares of numpy: of ours is only the window."""
    w = windowing.window(valid, fs)
    bins = slice(S.first, S.first + S.f.size)

    def whitened(x):
        X = np.fft.rfft(x * w)[bins] / np.sqrt(S.density)
        return np.concatenate([X.real, X.imag])

    always = [whitened(np.ones(N)), whitened(np.arange(N)), *map(whitened, known)]
    y = whitened(columns[0])

    def left(more):
        A = np.stack(more, axis=1)
        A /= np.linalg.norm(A, axis=0)
        r = y - A @ np.linalg.lstsq(A, y)[0]
        return r @ r

    new = [[whitened(x * (np.arange(N) >= i)) for x in columns[1:]] for i in begins]
    return 4 / (fs * (w @ w)) * np.array([left(always) - left([*always, *more]) for more in new])


@pytest.mark.parametrize(
    ("fs", "gap", "stretch"),
    [
        (1.0, None, (2900, 3400)),
        (2.0, (3000, 3100), (2900, 3400)),
        (1.0, None, (7300, N)),
    ],
    ids=["whole", "gap at 2 Hz", "at the end"],
)
def test_gains_are_those_of_trial(fs, gap, stretch):
    valid = np.ones(N, dtype=bool)
    if gap:
        valid[slice(*gap)] = False
    x, known, glitch = walks(3, 1), walks(2, 2), np.exp(-np.clip(np.arange(N) - 5000, 0, None) / 80)
    terms = windowing.transform(np.stack([x[0], *known], axis=1), valid, fs, nuisance=[glitch[:, None]])
    assert terms.window.size == N
    S = Density(terms)
    U = whitened_run.as_real(whitened_run.whiten(terms, S.density)[0])
    Q = np.linalg.qr(U[:, 1:])[0]
    found = Stretch(terms, S.density, Q, U[:, 0] - Q @ (Q.T @ U[:, 0]), slice(*stretch)).gains(x[1:])
    first, last = stretch
    begins = np.array([first, first + 50, first + 150, (first + last) // 2, last - 100])
    expected = by_trial(valid, fs, S, [*known, glitch], x, begins)
    np.testing.assert_allclose(found[begins - first], expected, rtol=1e-8)
