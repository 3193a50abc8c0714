"""What bell curves find at fewer instants than a run has, and at all of them."""

import numpy as np

from fit.quality.matched_filter import WIDTHS, MatchedFilter
from fit.spectra import windowing


def test_what_passes_for_quiet_is_quiet():
    rng, n = np.random.default_rng(1), 5400
    terms = windowing.transform(np.zeros((n, 1)), np.ones(n, dtype=bool), 1.0)
    f, quiet, loud = terms.f, 0, 0
    threshold = MatchedFilter(terms, np.zeros(f.size, complex), np.ones(f.size), 0.0).threshold
    for least in (0.0, 1.0):
        for _ in range(100):  # a glitch about as high as the threshold, anywhere between two samples
            width, begin = rng.choice(WIDTHS), rng.uniform(0.1 * n, 0.9 * n)
            shape = np.exp(-2 * (np.pi * width * f) ** 2) * np.exp(-2j * np.pi * f * begin)
            noise = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
            height = rng.uniform(0.3, 1.1) * threshold * np.sqrt(2) / np.linalg.norm(shape)
            matched = MatchedFilter(terms, noise + height * shape, np.ones(f.size), least)
            stands_out = matched.envelope.max() > threshold
            assert not (matched.below_threshold and stands_out)
            quiet, loud = quiet + matched.below_threshold, loud + stands_out
    assert min(quiet, loud) > 50
