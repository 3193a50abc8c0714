"""Noise that is not that of the noise run: seen by band, marginalised where it is noise."""

from dataclasses import replace

import numpy as np
import pytest

from fit.fitting.experiment_and_joint_fit import fit_experiment
from fit.pipeline import calibrate
from fit.settings import settings
from fit.statistics import variance
from fit.whitening import pair as paired
from tests.oracles.synthetic import World, pair, telemetry

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2))


def campaign(loud=(), **changes):
    """Make four experiments; the sysid runs of `loud` are made in another world."""
    found = []
    for authority, epoch in SETS:
        _, noise = pair(World(), authority, epoch=epoch)
        world = World(**changes) if authority in loud else World()
        found += [telemetry(world, authority, epoch=epoch), noise]
    return found


def largest_pull(fit):
    truth = vars(World())
    return max(abs(e.value - truth[name]) / e.sigma for name, e in fit.parameters.items())


def codes(fit):
    return {w.code for w in fit.warnings}


def test_on_clean_data_the_noise_run_tells_the_level():
    results = calibrate(campaign())
    plain = calibrate(campaign(), settings({"levels": [], "scatter": []}))
    assert results.provenance.levels == []
    assert "marginalised_noise" not in codes(results.joint)
    for name, estimate in plain.joint.parameters.items():
        assert results.joint.parameters[name] == estimate


@pytest.mark.parametrize("changes", [{"plateau": 8e-15, "tail": 3e-14}, {"plateau": 1e-15}])
def test_noise_of_another_level_is_marginalised(changes):
    results = calibrate(campaign("AC", **changes))
    assert results.provenance.levels == ["A", "C"]
    assert not results.joint.unsound
    assert "marginalised_noise" in codes(results.experiments["A"])
    assert largest_pull(results.joint) < 4.5
    assert results.joint.chi2 / results.joint.dof == pytest.approx(1, abs=0.05)


def test_a_signal_that_the_equation_lacks_is_no_noise():
    runs = campaign()
    t = runs[0].time
    line = 3e-11 * np.sin(2 * np.pi * 5e-3 * t)  # m, some 3 10^-14 m s^-2
    runs[0] = replace(runs[0], channels={**runs[0].channels, "o_12": runs[0].channels["o_12"] + line})
    results = calibrate(runs)
    assert results.provenance.levels == []
    assert "noise_mismatch" in codes(results.experiments["A"])
    assert "A-sysid" not in results.provenance.joint_runs or results.joint.unsound


def test_bins_below_the_noise_run_have_no_level():
    # 65 h beside a noise run of 8 h: below its lowest frequency the PSD is a straight line, right or not
    (e,) = paired(pair(World(), "A"))
    outcome = fit_experiment(e)
    residual = variance.whitened_residual(e, outcome)
    f = np.append(1e-6 * np.arange(1, 9), residual.f)
    more = {"z": np.full(8, 14.0), "retained": np.ones(8)}
    slower = {name: np.append(values, getattr(residual, name)) for name, values in more.items()}
    table = variance.variance_table(replace(residual, f=f, **slower))
    assert table.log_ratio == pytest.approx(variance.variance_table(residual).log_ratio, abs=1e-12)
