"""The joint fit: estimators, parameters that experiments share, and parameters that scatter between them."""

import numpy as np
import pytest

from fit.pipeline import calibrate
from fit.settings import settings
from tests.oracles.synthetic import World, pair

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2))


def pulls(fit, truth):
    return {name: (e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()}


def campaign(*worlds, seed=0, **options):
    """Make four experiments, each in a world of its own if there are as many."""
    worlds = worlds * (len(SETS) // len(worlds))
    return [
        run
        for (authority, epoch), world in zip(SETS, worlds, strict=True)
        for run in pair(world, authority, epoch=epoch, seed=seed, **options)
    ]


@pytest.mark.parametrize("estimator", ["gaussian", "student_t", "marginalised", "flscov"])
def test_every_estimator_recovers_the_truth(estimator):
    results = calibrate(campaign(World(lambda_2=1.05)), settings({"estimator": estimator}))
    limit = 6 if estimator == "flscov" else 4.5  # its sigmas are too small by some 10 %
    assert max(abs(p) for p in pulls(results.joint, vars(World(lambda_2=1.05))).values()) < limit
    assert results.provenance.settings["estimator"] == estimator


def test_a_parameter_may_have_a_value_for_each_experiment():
    worlds = [World(lambda_2=1.05 + 0.01 * i) for i in range(4)]
    joint = calibrate(campaign(*worlds), settings({"shared": {"lambda_2": "experiment"}})).joint
    names = [f"lambda_2_{authority}" for authority, _ in SETS]
    assert [n for n in joint.parameters if n.startswith("lambda_2")] == names
    truth = vars(World()) | {n: w.lambda_2 for n, w in zip(names, worlds, strict=True)}
    assert max(abs(p) for p in pulls(joint, truth).values()) < 4.5


def test_sigma_includes_the_scatter_of_the_gain():
    sets = [("A", 1), ("B", 1), ("C", 2), ("D", 2)] * 2
    rng = np.random.default_rng(11)
    gains = 1.0776 * (1 + 0.005 * rng.standard_normal(len(sets)))
    runs = [
        run
        for i, ((authority, epoch), gain) in enumerate(zip(sets, gains, strict=True))
        for run in pair(
            World(lambda_2=gain, C_2=0.186 * gain / 1.0776),  # the delay stays
            authority,
            epoch=epoch,
            experiment=f"{authority}{i}",
            seed=i,
        )
    ]
    results = calibrate(runs, settings({"scatter": ["lambda_2"]}))
    # noise is 50 times smaller than the scatter: the gains themselves determine its width
    w = np.linspace(1e-4, 0.03, 3000)
    relative = gains / 1.0776
    density = w ** -(len(sets) - 1.0) * np.exp(-np.sum((relative - relative.mean()) ** 2) / (2 * w**2))
    density /= (1 + (w / 0.005) ** 2) * np.sum(density / (1 + (w / 0.005) ** 2))
    mean, square = np.sum(density * w), np.sum(density * w**2)
    width = results.provenance.scatter["lambda_2"]
    assert width["value"] == pytest.approx(1.0776 * mean, rel=0.01)
    assert width["sigma"] == pytest.approx(1.0776 * np.sqrt(square - mean**2), rel=0.03)
    estimate = results.joint.parameters["lambda_2"]
    assert estimate.value == pytest.approx(np.mean(gains), abs=1e-4)
    assert estimate.sigma == pytest.approx(1.0776 * np.sqrt(square / len(sets)), rel=0.02)
    pulls_of_others = {n: p for n, p in pulls(results.joint, vars(World())).items() if n != "lambda_2"}
    assert max(abs(p) for p in pulls_of_others.values()) < 4.5
    (message,) = (w.message for w in results.joint.warnings if w.code == "random_effects")
    assert message.startswith("lambda_2 scatters between the experiments by ")
    assert results.joint.chi2 / results.joint.dof == pytest.approx(1, abs=0.1)


def test_both_gains_share_a_width_and_obey_bounds():
    gains = 1 + 0.003 * np.array([1.0, -0.7, 0.4, -1.1])
    worlds = [World(lambda_2=1.0776 * gain) for gain in gains]
    runs = campaign(*worlds, drive_1=1e-12)
    table = {"scatter": ["lambda_1", "lambda_2"]}
    joint = calibrate(runs, settings(table))
    widths = joint.provenance.scatter
    assert widths["lambda_1"]["value"] / widths["lambda_2"]["value"] == pytest.approx(1.0748 / 1.0776)
    free = joint.joint.parameters["lambda_2"]
    bound = free.value + 0.5 * free.sigma
    bounded = calibrate(runs, settings({**table, "parameters": {"lambda_2": {"min": bound}}})).joint
    assert bounded.values["lambda_2"] == pytest.approx(bound, abs=1e-3 * free.sigma)
    assert "at_bound" in {w.code for w in bounded.warnings}
