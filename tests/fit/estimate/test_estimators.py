"""The choice of estimator, of what experiments share, and of what may scatter between them."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import get_window

from fit import pipeline
from fit.errors import FitError, InputError
from fit.fitting import flscov
from fit.fitting.joint_fit import fit_experiment
from fit.model import dynamics
from fit.pipeline import calibrate
from fit.settings import read, settings
from fit.whitening import likelihoods
from fit.whitening.run import Run
from tests.oracles.synthetic import World, of_run, pair, telemetry

SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2))


def pulls(fit, truth):
    return {name: (e.value - truth[name]) / e.sigma for name, e in fit.parameters.items()}


def campaign(*worlds, seed=0):
    """Make four experiments, each in a world of its own if there are as many."""
    worlds = worlds * (len(SETS) // len(worlds))
    return [
        run
        for (authority, epoch), world in zip(SETS, worlds, strict=True)
        for run in pair(world, authority, epoch=epoch, seed=seed)
    ]


def minus_log_likelihood(kind, u, f):
    """Return the sums of fit.likelihood's docstring, bands aside written out anew."""
    if kind == "gaussian":
        return np.sum(u) / 2
    if kind == "student_t":
        return (likelihoods.NU + 2) / 2 * np.sum(np.log1p(u / likelihoods.NU))
    return sum(len(u[b]) * np.log(np.sum(u[b])) for b in likelihoods.bands(f))


@pytest.mark.parametrize("kind", ["gaussian", "student_t", "marginalised"])
def test_weights_lead_to_the_maximum_of_the_likelihood(kind):
    rng = np.random.default_rng(7)
    f = np.arange(1, 301) * 1e-4
    x, noise = rng.standard_normal((2, 300, 2)) @ [1, 1j]
    y = 0.7 * x + noise * np.where(rng.random(300) < 0.05, 8.0, 1.0)
    a = 0.0
    for _ in range(200):
        w = likelihoods.weights(kind, f, np.abs(y - a * x) ** 2).fit
        a = np.sum(w * (x.conj() * y).real) / np.sum(w * np.abs(x) ** 2)
    best = minimize(lambda p: minus_log_likelihood(kind, np.abs(y - p[0] * x) ** 2, f), [a + 0.1], tol=1e-12)
    assert a == pytest.approx(best.x[0], abs=1e-6)
    # and the curvature there is that of the weights
    step = 1e-3
    cost = [minus_log_likelihood(kind, np.abs(y - (a + d) * x) ** 2, f) for d in (-step, 0, step)]
    curvature = (cost[0] - 2 * cost[1] + cost[2]) / step**2
    factors = likelihoods.weights(kind, f, np.abs(y - a * x) ** 2).curvature
    assert np.sum(factors * np.abs(x) ** 2) == pytest.approx(curvature, rel=0.1)


def test_bands_hold_every_bin_once_and_enough_of_them():
    f = np.arange(1, 2200) / 21600
    bands = likelihoods.bands(f)
    assert np.concatenate([np.arange(f.size)[b] for b in bands]).tolist() == list(range(f.size))
    assert min(b.stop - b.start for b in bands) >= likelihoods.BAND
    assert likelihoods.bands(f[:10]) == [slice(0, 10)]


@pytest.mark.parametrize("estimator", ["gaussian", "student_t", "marginalised", "flscov"])
def test_every_estimator_recovers_the_truth(estimator):
    results = calibrate(campaign(World(lambda_2=1.05)), settings({"estimator": estimator}))
    wide = 6 if estimator == "flscov" else 4.5  # its sigmas are too small by some 10 %
    assert max(abs(p) for p in pulls(results.joint, vars(World(lambda_2=1.05))).values()) < wide
    assert results.provenance.settings["estimator"] == estimator


def test_student_t_bears_outliers():
    f = np.arange(1, 2001) * 5e-5
    rng = np.random.default_rng(3)
    x = rng.standard_normal((2000, 2)) @ [1, 1j]
    errors = {}
    for kind in ("gaussian", "student_t"):
        found = []
        for _ in range(50):
            y = rng.standard_normal((2000, 2)) @ [1, 1j] * np.where(rng.random(2000) < 0.02, 20.0, 1.0)
            a = 0.0
            for _ in range(30):
                w = likelihoods.weights(kind, f, np.abs(y - a * x) ** 2).fit
                a = np.sum(w * (x.conj() * y).real) / np.sum(w * np.abs(x) ** 2)
            found.append(a)
        errors[kind] = np.std(found)
    assert errors["student_t"] < 0.5 * errors["gaussian"]


def test_flscov_is_weighted_least_squares_on_averaged_residuals():
    """The same by hand: periodograms one by one, normal equations, delays and stiffness of run 1 held."""
    run = Run(telemetry(World()))
    theta = np.array([0.0, 1.0776, 0.0, 0.186, -1e-6, 0.0, -2.2e-5])
    terms = run.columns(dynamics.delays(theta))
    c = dynamics.coefficients(theta, terms.tau)
    block, _ = flscov.block(terms, np.eye(7), c)
    N, fs = len(terms.values), terms.fs
    n = int(N / (1 + 9 * 0.339))
    w = get_window("blackmanharris", n, fftbins=True)
    S, spectra = 0.0, []
    for k in range(10):
        first = min(round(k * round(n * 0.339)), N - n)
        stretch = terms.values[first : first + n]
        line = np.fft.rfft(w[:, None] * stretch, axis=0) / np.sqrt(fs * np.sum(w**2) / 2)
        f = np.fft.rfftfreq(n, 1 / fs)
        line = line[(np.arange(f.size) >= 4) & (np.arange(f.size) % 4 == 0) & (f <= 0.1)]
        spectra.append(line)
        S = S + np.abs(line @ c) ** 2 / 10
    normal = sum((x.conj().T / S @ x).real for x in spectra) * 2
    size = np.sqrt(np.outer(np.diag(normal), np.diag(normal)))
    size[size == 0] = 1.0  # the force on test mass 1 is zero
    for found in (block.R.T @ block.R, block.M):  # bins and stretches count as independent
        assert np.abs((found - normal) / size).max() < 1e-9


def test_a_parameter_may_have_a_value_for_each_experiment():
    worlds = [World(lambda_2=1.05 + 0.01 * i) for i in range(4)]
    joint = calibrate(campaign(*worlds), settings({"shared": {"lambda_2": "experiment"}})).joint
    names = [f"lambda_2_{authority}" for authority, _ in SETS]
    assert [n for n in joint.parameters if n.startswith("lambda_2")] == names
    truth = vars(World()) | {n: w.lambda_2 for n, w in zip(names, worlds, strict=True)}
    assert max(abs(p) for p in pulls(joint, truth).values()) < 4.5


def test_delta_ifo_may_be_common():
    common = World(delta_ifo_2=World().delta_ifo_1)
    joint = calibrate(campaign(common), settings({"shared": {"delta_ifo": "campaign"}})).joint
    assert [n for n in joint.parameters if "ifo" in n] == ["delta_ifo"]
    assert max(abs(p) for p in pulls(joint, vars(common) | {"delta_ifo": -2.2e-5}).values()) < 4.5


def test_scatter_of_the_gain_is_found_and_counts():
    sets = [("A", 1), ("B", 1), ("C", 2), ("D", 2)] * 3
    rng = np.random.default_rng(11)
    gains = 1.0776 * (1 + 0.005 * rng.standard_normal(len(sets)))
    runs = [
        run
        for i, ((authority, epoch), gain) in enumerate(zip(sets, gains, strict=True))
        for run in pair(
            World(lambda_2=gain, C_2=0.186 * gain / 1.0776),  # as late as ever
            authority,
            epoch=epoch,
            experiment=f"{authority}{i}",
            seed=i,
        )
    ]
    results = calibrate(runs, settings({"scatter": ["lambda_2"]}))
    # noise is 50 times smaller than the scatter: what is known of its width are the gains themselves
    w = np.linspace(1e-4, 0.03, 3000)
    relative = gains / 1.0776
    density = w ** -(len(sets) - 1.0) * np.exp(-np.sum((relative - relative.mean()) ** 2) / (2 * w**2))
    density /= (1 + (w / 0.005) ** 2) * np.sum(density / (1 + (w / 0.005) ** 2))
    mean, square = np.sum(density * w), np.sum(density * w**2)
    width = results.provenance.scatter["lambda_2"]
    assert width["value"] == pytest.approx(1.0776 * mean, rel=0.01)
    assert width["sigma"] == pytest.approx(1.0776 * np.sqrt(square - mean**2), rel=0.03)
    found = results.joint.parameters["lambda_2"]
    assert found.value == pytest.approx(np.mean(gains), abs=1e-4)
    assert found.sigma == pytest.approx(1.0776 * np.sqrt(square / len(sets)), rel=0.02)
    others = {n: p for n, p in pulls(results.joint, vars(World())).items() if n != "lambda_2"}
    assert max(abs(p) for p in others.values()) < 4.5
    (said,) = (w.message for w in results.joint.warnings if w.code == "random_effects")
    assert said.startswith("lambda_2 scatters between the experiments by 0.0")
    assert results.joint.chi2 / results.joint.dof == pytest.approx(1, abs=0.1)


def test_without_scatter_its_width_is_that_of_nothing():
    results = calibrate(campaign(World()), settings({"scatter": ["lambda_2"]}))
    width = results.provenance.scatter["lambda_2"]
    assert width["value"] < 3 * width["sigma"] < 1e-3
    (said,) = (w.message for w in results.joint.warnings if w.code == "random_effects")
    assert said.startswith("lambda_2 may scatter between the experiments by ")
    assert max(abs(p) for p in pulls(results.joint, vars(World())).values()) < 4.5


def test_an_experiment_may_be_left_out():
    results = calibrate(campaign(World()), settings({"exclude": ["B"]}))
    assert results.provenance.joint_runs == ["A-sysid", "C-sysid", "D-sysid"]
    assert pulls(results.experiments["B"], of_run(World(), "B"))
    assert "excluded" in {w.code for w in results.experiments["B"].warnings}


@pytest.mark.parametrize(
    ("chosen", "told"),
    [
        ({"estimator": "best"}, 'estimator: "best"'),
        ({"speed": 3}, "speed"),
        ({"shared": {"lambda_3": "campaign"}}, "shared.lambda_3: unknown key"),
        ({"shared": {"lambda_2": "week"}}, 'shared.lambda_2: "week"'),
        ({"shared": "all"}, "expected a table"),
        ({"scatter": ["omega2_1_0"]}, "scatter[0]"),
        (
            {"scatter": ["lambda_2"], "shared": {"lambda_2": "experiment"}},
            "a value for each experiment already",
        ),
        ({"scatter": ["lambda_2", "lambda_2"]}, "expected each parameter once"),
        ({"scatter": ["auto", "lambda_2"]}, 'expected "auto" alone'),
        ({"exclude": "A"}, "exclude"),
    ],
)
def test_what_the_settings_do_not_know_is_told(chosen, told):
    with pytest.raises(InputError) as error:
        settings(chosen, "c.toml: fit")
    assert str(error.value).startswith("c.toml: fit")
    assert told in str(error.value)


def test_settings_are_read_from_a_file(tmp_path):
    path = tmp_path / "fit.toml"
    path.write_text('[fit]\nestimator = "student_t"\n', encoding="utf-8")
    assert read(path).estimator == "student_t"
    for text, told in (("x = 1\n", "no table"), ("[fit\n", "line 1"), ("[fit]\nx = 1\n", "fit.x")):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"fit\.toml") as error:
            read(path)
        assert told in str(error.value)
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "nothing.toml")


def test_excluding_what_is_not_there_is_told():
    with pytest.raises(InputError, match="no experiment 'Z', there are A, B, C, D"):
        calibrate(campaign(World()), settings({"exclude": ["Z"]}))


def test_what_one_experiment_cannot_yield_does_not_cost_the_joint_fit(monkeypatch):
    def fails(experiment, *_):
        if experiment.name == "B":
            raise FitError("B: it does not settle")
        return fit_experiment(experiment, *_)

    monkeypatch.setattr(pipeline, "fit_experiment", fails)
    results = calibrate(campaign(World()))
    assert list(results.experiments) == ["A", "C", "D"]
    (warning,) = (w for w in results.joint.warnings if w.code == "no_single_fit")
    assert warning.message == "B: it does not settle"
    with pytest.raises(FitError):
        calibrate(campaign(World())[2:4], settings({"exclude": ["B"]}))


def test_one_experiment_alone_cannot_scatter():
    with pytest.raises(InputError, match="A is alone, expected two experiments or more"):
        calibrate(pair(World()), settings({"scatter": ["lambda_2"]}))
