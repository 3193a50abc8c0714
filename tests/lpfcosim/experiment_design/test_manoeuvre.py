"""The manoeuvre for tilt-to-length coupling: its tones, its limits, and what is refused."""

import json

import pytest

from lpfcosim.campaign import loading
from tests import ROOT

CAMPAIGN = ROOT / "campaigns" / "lisa-ttl.toml"


@pytest.mark.slow
def test_the_manoeuvre_reaches_its_sigma_in_less_time(lpfcosim, tmp_path):
    out = tmp_path / "d.toml"
    status, printed, _ = lpfcosim("design", CAMPAIGN, "--ttl", "10 um/rad", "--out", out, "--json")
    assert status == 0
    document = json.loads(printed)
    assert document["schema"] == "lpf-design/1"
    assert len(document["parameters"]) == 24
    for sigma in document["parameters"].values():
        assert 0.99 * sigma["sigma_bound"] < sigma["sigma_after"] <= 10e-6
    assert document["hours_bound"] < document["hours"] < 0.7 * document["hours_before"]
    for limits in document["limits"].values():
        assert all(limit["reached"] < 1.02 * limit["limit"] for limit in limits.values())
    designed = loading.load(out)
    tones = [i for e in designed.experiments for i in e.injections]
    assert len({round(tone.frequency, 6) for tone in tones}) == 12
    assert {e.n_samples / 10 for e in designed.experiments} == {round(3600 * document["hours"], 3)}


def _campaign(tmp_path, experiments):
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{CAMPAIGN}"\nname = "mine"\n{experiments}')
    return path


def _experiment(name, sequence):
    return (
        f'[[experiments]]\nname = "{name}"\nauthority = "A"\nduration = "30 min"\n'
        f'sequences = ["{sequence}"]\n'
    )


def test_what_is_no_manoeuvre_of_three_spacecraft_is_refused(lpfcosim, tmp_path):
    two = _campaign(tmp_path, _experiment("SC1", "sc1") + _experiment("SC2", "sc2"))
    status, _, message = lpfcosim("design", two, "--ttl", "10 um/rad", "--out", tmp_path / "d.toml")
    assert status == 2
    assert "2 with injections, expected three, of spacecraft 1, 2 and 3" in message
    other = "".join(_experiment(f"SC{i}", "calibration") for i in (1, 2, 3)).replace("30 min", "6 h")
    status, _, message = lpfcosim(
        "design", _campaign(tmp_path, other), "--ttl", "10 um/rad", "--out", tmp_path / "d.toml"
    )
    assert status == 2
    assert "SC1: no sine into guidance_theta, expected one, whose amplitude limits the motion" in message
    pathfinder = ROOT / "campaigns" / "quickstart.toml"
    status, _, message = lpfcosim("design", pathfinder, "--ttl", "10 um/rad", "--out", tmp_path / "d.toml")
    assert status == 2
    assert "a manoeuvre for tilt-to-length coupling is not available for runs along x" in message
    assert lpfcosim("design", CAMPAIGN, "--ttl", "10 um", "--out", tmp_path / "d.toml")[0] == 2
