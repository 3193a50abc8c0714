"""The joint fit of stored results, repeated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit.crosstalk import refit
from fit.pipeline import calibrate
from tests.oracles.synthetic import World, pair


def test_gains_that_the_data_let_scatter_scatter_again():
    rng, runs = np.random.default_rng(3), []
    for k in range(5):
        world = replace(World(), lambda_2=World().lambda_2 * (1 + 0.006 * rng.standard_normal()))
        runs += [
            replace(run, run=f"{run.run}{k}", experiment=f"E{k}", path=Path(f"{run.run}{k}.h5"))
            for run in pair(world, "A", seed=k)
        ]
    results = calibrate(runs)
    assert "lambda_2" in results.provenance.scatter
    outcome = refit.least_squares(*refit.experiments(results, runs, Path("results.json")), results)
    assert outcome.data_driven
    width, sigma = outcome.scatter["lambda_2"]
    assert width == pytest.approx(results.provenance.scatter["lambda_2"]["value"], rel=0.01)
    assert sigma == pytest.approx(results.provenance.scatter["lambda_2"]["sigma"], rel=0.01)
