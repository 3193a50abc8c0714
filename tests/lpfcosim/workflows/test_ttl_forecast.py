"""The sigmas of tilt-to-length coefficients that a campaign is expected to give."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas
from tests import ROOT


@pytest.fixture(scope="module")
def manoeuvre():
    return loading.load(ROOT / "campaigns" / "lisa-ttl.toml")


def with_amplitudes(campaign, factor, into):
    """Return the campaign with some amplitudes changed."""
    experiments = [
        replace(
            e,
            injections=tuple(
                replace(i, amplitude=factor * i.amplitude) if i.into in into else i for i in e.injections
            ),
        )
        for e in campaign.experiments
    ]
    return replace(campaign, experiments=tuple(experiments))


def test_sigmas_are_those_of_simulated_calibrations_and_fall_with_the_motion(manoeuvre):
    sigmas = expected_ttl_sigmas(manoeuvre)
    assert len(sigmas) == 24
    assert np.mean(list(sigmas.values())) == pytest.approx(11.3e-6, rel=0.1)  # docs/lisa-ttl.md
    every = {i.into for e in manoeuvre.experiments for i in e.injections}
    halved = expected_ttl_sigmas(with_amplitudes(manoeuvre, 2.0, every))
    assert halved == pytest.approx({name: sigma / 2 for name, sigma in sigmas.items()}, rel=1e-6)


def test_without_motion_of_the_assemblies_nothing_is_determined(manoeuvre):
    rigid = expected_ttl_sigmas(with_amplitudes(manoeuvre, 0.0, {"guidance_opening"}))
    assert not np.isfinite(list(rigid.values())).any()


def test_one_spacecraft_has_none():
    assert expected_ttl_sigmas(loading.load(ROOT / "campaigns" / "lisa.toml")) == {}
