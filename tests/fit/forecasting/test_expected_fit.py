"""The forecast of the joint fit: against fits of noisy telemetry, other people's numbers, closed forms."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fit.errors import InputError
from fit.forecasting.expected_fit import PlannedExperiment
from fit.forecasting.expected_fit import expected_fit as forecast
from fit.forecasting.expected_run import compress
from fit.parameters import joint_names
from fit.pipeline import calibrate
from fit.settings import settings
from fit.whitening import Experiment, likelihoods, whitened_run
from fit.whitening.run import Run
from lpfcosim.campaign import loading
from lpfcosim.linear import ClosedLoop, response
from lpfcosim.planned_experiments import planned_experiments
from lpfcosim.spacecraft import Authority, HalfCosine, Sine
from tests import ROOT
from tests.fit.recorded import recorded
from tests.oracles.synthetic import World, of_run, pair, telemetry
from tests.reference_run import simulate_reference

CAMPAIGNS = ROOT / "campaigns"
SETS = (("A", 1), ("B", 1), ("C", 2), ("D", 2), ("E", 2))


def cross_spectra(world, authority, epoch):
    """Noise of the synthetic oracle: of o_1, and of o_12, which feels o_1 through stiffness and read-out."""
    truth = of_run(world, authority, epoch)

    def matrix(names, f):
        x_1 = world.jitter**2 / (1 + (f / 0.05) ** 4)
        delta_g = world.plateau**2 + (world.tail * 1e-4 / f) ** 2
        omega2 = (2 * np.pi * f) ** 2
        into_o_12 = truth["delta_ifo"] - truth["domega2_12"] / (truth["omega2_2"] - omega2)
        S = np.zeros((f.size, len(names), len(names)), dtype=complex)
        one, two = names.index("o_1"), names.index("o_12")
        S[:, one, one] = x_1
        S[:, one, two] = S[:, two, one] = into_o_12 * x_1
        S[:, two, two] = into_o_12**2 * x_1 + delta_g / (truth["omega2_2"] - omega2) ** 2 + world.oms**2
        return S

    return matrix


def expected(world, sets=SETS, **options):
    def make(authority, epoch):
        return Experiment(
            Run(telemetry(world, authority, epoch=epoch, noisy=False, **options)),
            Run(telemetry(world, authority, "noise", epoch=epoch, noisy=False, **options)),
        )

    return [PlannedExperiment(partial(make, *case), cross_spectra(world, *case)) for case in sets]


def noisy(world, sets=SETS, **options):
    return [run for authority, epoch in sets for run in pair(world, authority, epoch=epoch, **options)]


def sigmas(fit):
    return {name: estimate.sigma for name, estimate in fit.parameters.items()}


@pytest.mark.slow
def test_sigmas_are_those_of_fits_on_average():
    # sigmas of one fit scatter by some 8 % with its noise PSDs: the mean of six by 3 %
    fitted = [sigmas(calibrate(noisy(World(), seed=seed, drive_1=1e-12)).joint) for seed in range(6)]
    forecasted = forecast(expected(World(), drive_1=1e-12))
    assert list(forecasted.parameters) == list(joint_names([1, 2])) == list(fitted[0])
    for name, sigma in sigmas(forecasted).items():
        assert sigma == pytest.approx(np.mean([one[name] for one in fitted]), rel=0.07), name


@pytest.mark.parametrize(
    ("sets", "options"),
    [
        ((("A", 1), ("B", 1)), {"drive_1": 1e-12}),  # all N_max equal
        (SETS[:4], {}),  # no F_max_1, no drive of test mass 1
    ],
)
def test_degenerate_campaigns_are_named_as_the_fit_names_them(sets, options):
    forecasted, fitted = (
        forecast(expected(World(), sets, **options)),
        calibrate(noisy(World(), sets, **options)).joint,
    )
    assert forecasted.parameters.keys() == fitted.parameters.keys()
    undetermined = [(w.code, w.parameters) for w in fitted.warnings if w.code != "high_leverage"]
    assert [(w.code, w.parameters) for w in forecasted.warnings] == undetermined


def test_a_single_tone_determines_as_little_as_in_the_fit():
    # which of many blind directions is named first is chance
    options = {"tones_12": (3.333e-3,), "tones_1": ()}
    forecasted, fitted = (
        forecast(expected(World(), SETS[3:4], **options)),
        calibrate(noisy(World(), SETS[3:4], **options)),
    )
    assert forecasted.parameters.keys() == fitted.joint.parameters.keys()
    undetermined = {name for w in forecasted.warnings for name in w.parameters}
    assert undetermined == {
        n for w in fitted.joint.warnings if w.code != "high_leverage" for n in w.parameters
    }
    assert {"omega2_2_0", "alpha_x_2"} <= undetermined


@pytest.fixture(scope="module")
def mission():
    return planned_experiments(loading.load(CAMPAIGNS / "mission-x.toml"))


def test_regressors_without_noise_determine_delta_ifo_worse(mission):
    noise = {run.name: run.noise for run in loading.load(CAMPAIGNS / "mission-x.toml").runs}

    def of_residual(levels):
        """As much noise as the residual has, all of it in o_12."""

        def matrix(names, f):
            tail = levels["tail"] * 60e-15 * 20e-6 / f
            S = np.zeros((f.size, len(names), len(names)), dtype=complex)
            i = names.index("o_12")
            S[:, i, i] = (levels["plateau"] ** 2 + tail**2) / (2 * np.pi * f) ** 4 + levels["oms"] ** 2
            return S

        return matrix

    noiseless = [replace(p, cross_spectra=of_residual(noise[p.make().name])) for p in mission]
    noiseless_sigmas, forecasted = sigmas(forecast(noiseless)), sigmas(forecast(mission))
    names = [f"delta_ifo_{k}" for k in (1, 2, 3, 4)]
    # an independent calculation for the campaign, with regressors free of noise
    assert [noiseless_sigmas[name] for name in names] == pytest.approx(
        [9.8e-7, 4.9e-7, 4.1e-7, 3.1e-7], rel=0.1
    )
    # and as fitted
    fitted = {"lambda_1": 1.3e-5, "lambda_2": 1.3e-5, "C_2": 2.9e-4, "omega2_1_0": 2.4e-9}
    fitted |= {"omega2_2_0": 1.7e-9, "alpha_x_1": 0.93, "alpha_x_2": 0.69}
    fitted |= {"alpha_phi_1": 333, "alpha_phi_2": 248}
    assert {name: forecasted[name] for name in fitted} == pytest.approx(fitted, rel=0.1)
    for name in names:
        assert forecasted[name] < 0.6 * noiseless_sigmas[name]


def test_agrees_with_a_fit_of_the_reference_plant(quickstart):
    plan = loading.load(quickstart)
    runs = [recorded(run, simulate_reference(run)) for run in plan.runs]
    fitted, forecasted = calibrate(runs).joint, forecast(planned_experiments(plan))
    assert list(sigmas(forecasted)) == list(sigmas(fitted))
    for name, sigma in sigmas(fitted).items():
        # the noise PSDs at the lowest frequencies make that of a stiffness scatter by 8 % from fit to fit
        tolerance = 0.12 if name.startswith(("omega2", "alpha")) else 0.05
        assert sigmas(forecasted)[name] == pytest.approx(sigma, rel=tolerance), name
    undetermined = [w.parameters for w in fitted.warnings if w.code == "indeterminable"]
    assert [w.parameters for w in forecasted.warnings] == undetermined


@pytest.mark.long
def test_agrees_with_a_fit_of_the_whole_spacecraft():
    plan = loading.load(CAMPAIGNS / "spacecraft.toml")
    fitted = calibrate([recorded(run, ClosedLoop(run).simulate()) for run in plan.runs]).joint
    forecasted = sigmas(forecast(planned_experiments(plan)))
    for name, sigma in sigmas(fitted).items():
        scatters = name.startswith(("omega2", "alpha"))
        # lambda_2 is given beside the instruments, with a sigma that holds how far these move it
        tolerance = 0.2 if scatters else 0.08 if name == "lambda_2" else 0.05
        assert forecasted[name] == pytest.approx(sigma, rel=tolerance), name


DRIVEN = {
    "authority": Authority("any", 2200e-12, 2200e-12, 10.4e-12, 10.4e-12),
    "injections": (
        Sine("guidance_o_12", 10e-9, 0.01, 3, 20.0),
        Sine("guidance_o_1", 5e-9, 0.02, 4, 100.0),
        HalfCosine("F_x_1", 2e-12, 50.0, 300.0),
        HalfCosine("F_x_2", 2e-12, 50.0, 300.0),
    ),
    "dc": 3e-12,
}
CROSS_TALK = dict(
    zip([f"b_{i}" for i in range(1, 7)], (1.2e-5, -0.9e-5, 2.2e-5, -1.8e-5, 1e-7, -1e-7), strict=True)
)
CRAFT = {"spacecraft": "lpf", "truth": {**CROSS_TALK, "leak_phi_1": 0.1}}


def still(run):
    return replace(run, injections=())


@pytest.mark.parametrize("spacecraft", [{}, CRAFT])
def test_response_is_what_a_simulation_without_noise_gives(make_run, spacecraft):
    run = make_run(**DRIVEN, **spacecraft)
    driven, rest = ClosedLoop(run).simulate(), ClosedLoop(still(run)).simulate()
    expected = response.linear_response(run)
    for name in ("o_1", "o_12", "f_x_1", "f_x_2"):
        difference = (driven[name] - rest[name])[::10]
        assert expected[name] == pytest.approx(difference, abs=1e-6 * np.abs(difference).max())


def test_turning_against_the_simulation(make_run):
    # a turn far faster than any flown, so that what is quadratic shows
    rates = {"Omega_theta_start": 0.0, "Omega_eta_start": 2e-5, "Omega_phi_start": -3e-5}
    run = make_run(spacecraft="lpf", truth={**CRAFT["truth"], **rates})
    n = np.arange(run.n_samples)
    steady = {
        f"attitude_{k}": rate * n / run.fs
        for k, rate in zip(("theta", "eta", "phi"), rates.values(), strict=True)
    }
    pulse = np.where(n == 100, 1e-7, 0.0)
    driven, rest = (ClosedLoop(run).simulate({**steady, **extra}) for extra in ({"N_noise_z_sc": pulse}, {}))
    s = ClosedLoop(run).linearize()
    state, states = s.B[:, s.inputs.index("N_noise_z_sc")] * 1e-7, []
    for _ in range(2000):
        states.append((s.C @ state)[s.outputs.index("o_12")])
        state = s.A @ state
    difference = (driven["o_12"] - rest["o_12"])[101:2101]
    assert np.array(states) == pytest.approx(difference, abs=2e-3 * np.abs(difference).max())


def test_it_ends_where_it_would_wherever_it_starts(quickstart):
    text = {"lambda_2": 1.13, "C_2": 0.25, "omega2_2_0": -9e-7, "delta_ifo_1": 3e-5, "delta_ifo_2": -4e-5}
    plan = loading.load(quickstart)
    plan = replace(plan, truth={**plan.truth, **text})
    calls: list[str] = []

    def counted(p):
        def make():
            calls.append("once")
            return p.make()

        return replace(p, make=make)

    from_truth = forecast([counted(p) for p in planned_experiments(plan)])
    assert len(calls) == len(plan.experiments)  # a campaign of hundreds has no time for more
    from_flight = forecast([replace(p, truth={}) for p in planned_experiments(plan)])
    assert sigmas(from_truth) == pytest.approx(sigmas(from_flight), rel=2e-3)
    for name, value in {"lambda_2": 1.13, "delta_ifo_2": -4e-5}.items():
        assert from_truth[name].value == pytest.approx(value, abs=0.2 * from_truth[name].sigma)
    assert [w.message for w in from_truth.warnings] == [w.message for w in from_flight.warnings]


def test_short_and_excluded_runs_stay_out(quickstart):
    plan = planned_experiments(loading.load(quickstart))
    all_but_b = forecast(plan, settings({"exclude": ["B"]}))
    assert sigmas(all_but_b)["delta_ifo_1"] > 1.2 * sigmas(forecast(plan))["delta_ifo_1"]
    short = expected(World(), SETS[:1], duration=7200.0)
    with pytest.raises(InputError, match="no sysid run takes part"):
        forecast(short)
    assert "lambda_2" in forecast(short, settings({"include_short": True})).parameters


def test_without_noise_or_an_estimator_whose_sigmas_are_valid_nothing_is_forecast():
    (planned,) = expected(World(), SETS[:1])
    silence = replace(planned, cross_spectra=lambda names, f: np.zeros((f.size, len(names), len(names))))
    with pytest.raises(InputError, match="without noise there are no sigmas to forecast"):
        forecast([silence])
    with pytest.raises(InputError, match='"flscov" has no forecast'):
        forecast([planned], settings({"estimator": "flscov"}))


@pytest.mark.parametrize("kind", ["student_t", "marginalised"])
def test_expected_weights_are_the_mean_of_those_of_noise(kind):
    f = np.arange(1, 200001) * 1e-6
    u = np.random.default_rng(0).chisquare(2, f.size)
    expected_factors, drawn = likelihoods.expected_weights(kind, f), likelihoods.weights(kind, f, u)
    # marginalised levels of n bins have the mean n / (n - 1): n is 24 at the lowest frequencies
    assert np.mean(expected_factors.fit) == pytest.approx(np.mean(drawn.fit), rel=0.01)
    assert np.mean(expected_factors.curvature) == pytest.approx(np.mean(drawn.curvature), rel=0.01)
    assert np.mean(expected_factors.score) == pytest.approx(np.mean(drawn.score), rel=0.01)


def test_other_estimators_cost_what_they_cost():
    plain = sigmas(forecast(expected(World(), SETS[:4])))
    student = sigmas(forecast(expected(World(), SETS[:4]), settings({"estimator": "student_t"})))
    levels = sigmas(forecast(expected(World(), SETS[:4]), settings({"estimator": "marginalised"})))
    # of a Student-t with 5 degrees of freedom on two Gaussian variables: 4 % by numerical integration
    x = np.linspace(0, 60, 200001)
    density, w = np.exp(-x) * (x[1] - x[0]), 7 / (5 + 2 * x)
    efficiency = np.sum(density * w * 5 / (5 + 2 * x)) ** 2 / np.sum(density * w**2 * x)
    for name, sigma in plain.items():
        assert student[name] == pytest.approx(sigma / efficiency**0.5, rel=1e-3)
        assert sigma < levels[name] < 1.05 * sigma


def test_gains_that_will_scatter_widen_the_forecast():
    sets = [*SETS[:4], *SETS[:4]]
    plain, scattered = (forecast(expected(World(), sets), settings(), w) for w in ({}, {"lambda_2": 0.003}))
    # the mean of 8 gains, whose width is estimated with 7 degrees of freedom
    share = 1.0776 * np.sqrt(7 / 5 / 8)
    assert scattered["lambda_2"].sigma == pytest.approx(0.003 * share, rel=0.02)
    assert plain["lambda_2"].sigma < 1e-4
    insisted = forecast(expected(World(), sets), settings({"scatter": ["lambda_2"]}))
    assert insisted["lambda_2"].sigma == pytest.approx(0.005 * share, rel=0.02)


def test_scores_of_noise_in_the_columns_scatter_by_all_of_the_window():
    # under a Hann window by 35/18, the mean of w^4 over the square of that of w^2
    weights = likelihoods.expected_weights("gaussian", np.arange(1, 11) / 1000)
    columns = np.random.default_rng(8).standard_normal((10, 3)) + 0j
    run = whitened_run.LinearRun((0.0, 0.0), columns, weights, np.hanning(1000), np.eye(2))
    jitter = np.diag([1.0, 2.0, 3.0])
    scatter = compress(run, jitter).M - compress(run).M
    assert scatter == pytest.approx(jitter * 35 / 18, rel=0.01, abs=1e-6)
