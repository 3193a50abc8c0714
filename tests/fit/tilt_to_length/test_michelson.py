"""The response of Michelson variables against the oracle's photons, in time and in frequency."""

from itertools import pairwise

import numpy as np
import pytest

from fit.tilt_to_length import NAMES, michelson, response, subtraction_spectra
from tests.fit.tilt_to_length.records import coefficients, measurements
from tests.oracles import constellation


def test_every_column_is_what_one_coefficient_makes_of_the_motion():
    quiet = {"oms": 1e-20, "dws": 0.0}
    for k, name in enumerate(NAMES):
        c = dict.fromkeys(NAMES, 0.0) | {name: 1e-3}
        run = measurements(np.random.default_rng(1), 600.0, c, **quiet)
        spectra = response.response_spectra(run)
        scale = np.abs(spectra.data).max()
        assert np.abs(spectra.data - 1e-3 * spectra.columns[..., k]).max() < 1e-6 * scale


def test_the_subtraction_leaves_nothing_of_the_coupling():
    rng = np.random.default_rng(2)
    c = coefficients(rng)
    run = measurements(rng, 600.0, c, oms=1e-20, dws=0.0)
    spectra = subtraction_spectra(run, np.array([c[name] for name in NAMES]))
    assert np.max(np.divide(spectra["after"], spectra["before"])) < 1e-4


def test_a_coefficient_outside_a_variable_does_not_enter_it():
    delays = dict.fromkeys(constellation.LINKS, 8.25)
    terms = dict(zip(NAMES, michelson.coefficient_terms("X2", delays), strict=True))
    assert not terms["c_23_phi_rx"]
    assert not terms["c_32_eta_tx"]
    assert sum(map(bool, terms.values())) == 16


@pytest.mark.parametrize("f", [12e-3, 43e-3, 0.11])
def test_time_and_frequency_domain_agree_with_unequal_arms(f):
    delays = dict(zip(constellation.LINKS, (8.1, 8.37, 8.2, 8.21, 8.36, 8.11), strict=True))
    fs, lead = 4.0, 400
    t = np.arange(2000) / fs
    for variable in michelson.VARIABLES:
        for terms in filter(None, michelson.coefficient_terms(variable, delays)):
            series = michelson.delayed_sum(np.cos(2 * np.pi * f * t), fs, terms, lead, 50)
            gain = michelson.transfer(np.array([f]), terms)[0]
            expected = (gain * np.exp(2j * np.pi * f * t[lead:-50])).real
            assert np.abs(series - expected).max() < 1e-9


@pytest.mark.parametrize("variable", michelson.VARIABLES)
def test_photons_pass_unequal_arms_in_the_order_of_their_paths(variable):
    delays = dict(zip(constellation.LINKS, (8.1, 8.37, 8.2, 8.21, 8.36, 8.11), strict=True))
    expected, f = dict.fromkeys(constellation.LINKS, 0.0), 0.05
    for sign, path in zip((1, -1), constellation.PATHS[variable], strict=True):
        seconds = 0.0
        for i, j in pairwise(path):
            expected[i + j] += sign * np.exp(-2j * np.pi * f * seconds)
            seconds += delays[i + j]
    terms = michelson.link_terms(variable, delays)
    for link, gain in expected.items():
        assert abs(michelson.transfer(np.array([f]), terms.get(link, ()))[0] - gain) < 1e-12


def test_constant_length_is_invisible():
    for variable in michelson.VARIABLES:
        for terms in michelson.coefficient_terms(variable, dict.fromkeys(constellation.LINKS, 8.3)):
            assert sum(term.sign for term in terms) == 0
