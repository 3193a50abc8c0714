"""The sigmas of tilt-to-length coefficients that a campaign is expected to give."""

from dataclasses import replace

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.workflows.ttl_forecast import expected_ttl_sigmas
from tests import ROOT


def with_amplitudes(campaign, factor, into=""):
    """Return the campaign with the amplitudes of some injections, or of all, times a factor."""
    experiments = []
    for e in campaign.experiments:
        factors = [factor if into in i.into else 1.0 for i in e.injections]
        scaled = (replace(i, amplitude=f * i.amplitude) for i, f in zip(e.injections, factors, strict=True))
        experiments.append(replace(e, injections=tuple(scaled)))
    return replace(campaign, experiments=tuple(experiments))


def test_sigmas_are_those_of_simulated_calibrations_and_fall_with_the_motion():
    manoeuvre = loading.load(ROOT / "campaigns" / "lisa-ttl.toml")
    sigmas = expected_ttl_sigmas(manoeuvre)
    assert len(sigmas) == 24
    assert np.mean(list(sigmas.values())) == pytest.approx(11.3e-6, rel=0.1)  # docs/lisa-ttl.md
    halved = expected_ttl_sigmas(with_amplitudes(manoeuvre, 2.0))
    assert halved == pytest.approx({name: sigma / 2 for name, sigma in sigmas.items()}, rel=1e-6)
    rigid = expected_ttl_sigmas(with_amplitudes(manoeuvre, 0.0, "guidance_opening"))
    assert {name for name, sigma in rigid.items() if np.isinf(sigma)} == {n for n in rigid if "_phi_" in n}


def test_one_spacecraft_has_none():
    assert expected_ttl_sigmas(loading.load(ROOT / "campaigns" / "lisa.toml")) == {}
