"""The report on one LISA spacecraft: D, its terms, and its residual, and commands that have no part in it."""

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import fit
from fit.figures import analysis
from fit.report import experiments
from fit.spectra import Estimator
from fit.telemetry import GUIDANCE
from tests.oracles import lisa_loop

WORLD = lisa_loop.World()


@lru_cache(maxsize=1)
def campaign():
    return lisa_loop.campaign(WORLD, lisa_loop.sequence(1e-6), seed=0)


@lru_cache(maxsize=1)
def calibrated():
    return fit.calibrate(campaign())


@pytest.mark.parametrize("index", [0, 1])
def test_terms_of_a_run_without_noise_cancel(index):
    run = lisa_loop.run(WORLD, lisa_loop.sequence(1e-6))
    parts = analysis.split(run, WORLD.truth)[index]
    rotation = ["ddphi"] if parts.equation.name == "D_x" else []  # the baseline is along y
    assert list(parts.terms) == ["dds", "K_1 s_1", "K_2 s_2", "f_1", "f_2", *rotation]
    np.testing.assert_allclose(np.sum(list(parts.terms.values()), axis=0), parts.total, atol=1e-25)
    # the starts of tones have frequencies beyond the band, where delays are not expanded well
    assert parts.total.std() < 1e-3 * parts.terms["dds"].std()


def test_residual_lies_on_the_noise():
    (experiment,) = experiments.analysed(calibrated(), campaign()).values()
    for run, noise in experiment.pairs:
        f = np.geomspace(1e-3, 5e-2, 50)
        signal, residual, level = (np.interp(f, x.f, x.asd) for x in (run.terms["dds"], run.asd, noise.asd))
        assert np.median(residual / level) == pytest.approx(1, abs=0.15)
        assert (signal / residual).max() > 10


@pytest.mark.parametrize("n", [2000, 20000])
def test_rising_noise_does_not_leak_to_low_frequencies(n):
    blue = np.diff(np.random.default_rng(1).standard_normal(n + 2), 2)  # as f^2
    level = Estimator(np.ones(n, bool), 1.0, 0.5, rising_noise=True).asd(blue)
    slow = (level.f > 3 / n) & (level.f < 60 / n)
    expected = np.sqrt(2) * (2 * np.pi * level.f[slow]) ** 2
    assert np.median(level.asd[slow] / expected) == pytest.approx(1, abs=0.3)


def test_set_points_are_those_of_the_controllers():
    folder = Path(__file__).parents[3] / "fmus" / "LISA"
    models = "".join((folder / f"{name}Control.mo").read_text() for name in ("DragFree", "Suspension"))
    stated = dict(re.findall(r'(guidance_\w+) "Set point of (\w+)"', models))
    assert {GUIDANCE[read_out]: read_out for read_out in stated.values()} == stated
