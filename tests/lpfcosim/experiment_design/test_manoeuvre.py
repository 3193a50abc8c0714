"""The manoeuvre for tilt-to-length coupling: its tones, its limits, and what is refused."""

import numpy as np
import pytest

from lpfcosim import design_manoeuvre
from lpfcosim.campaign import loading
from lpfcosim.constellation import ASSEMBLIES, assembly_angles, spacecraft_motion
from lpfcosim.errors import InputError
from lpfcosim.experiment_design import manoeuvre
from tests import ROOT

CAMPAIGN = ROOT / "campaigns" / "lisa-ttl.toml"


@pytest.mark.slow
def test_the_manoeuvre_reaches_its_sigma_in_less_time(lpfcosim_json, tmp_path):
    out = tmp_path / "d.toml"
    document = lpfcosim_json("design", CAMPAIGN, "--ttl", "10 um/rad", "--out", out)
    assert document["schema"] == "lpf-manoeuvre/1"
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


THREE = "".join(_experiment(f"SC{i}", f"sc{i}") for i in (1, 2, 3))
STEP = '{ into = "guidance_phi", shape = "half_cosine", amplitude = "1 nrad", start = "9 s", end = "99 s" }'
TONE = (
    'injections = [{ into = "guidance_phi", shape = "sine", frequency = "41 mHz", amplitude = "30 nrad", '
    'cycles = 50, start = "300 s" }]'
)
BAD = {  # experiments by the sentence that refuses them
    "2 with injections, expected three, of spacecraft 1, 2 and 3": THREE[: THREE.rindex("[[")],
    "SC1: a sine into guidance_o_1, expected guidance_theta, guidance_eta, ": "".join(
        _experiment(f"SC{i}", "calibration").replace("30 min", "6 h") for i in (1, 2, 3)
    ),
    "SC1: no sine into guidance_theta, expected one, whose amplitude limits the motion": "".join(
        _experiment(f"SC{i}", "sc1").replace('sequences = ["sc1"]', TONE) for i in (1, 2, 3)
    ),
    "SC2: an injection into guidance_phi that is no sine, expected sines only": THREE.replace(
        '["sc2"]', f'["sc2"]\ninjections = [{STEP}]'
    ),
    "SC2: 1800 s, expected the same duration in all three experiments, 48 h or less": THREE.replace(
        "30 min", "40 min", 1
    ),
    "sweep: not available for a manoeuvre, write its three experiments instead": (
        f'{THREE}[sweep]\nduration = ["30 min", "31 min", "32 min"]\n'
    ),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_no_manoeuvre_of_three_spacecraft_is_refused(lpfcosim, tmp_path, message):
    out = tmp_path / "d.toml"
    plan = _campaign(tmp_path, BAD[message])
    assert message in lpfcosim("design", plan, "--ttl", "10 um/rad", "--out", out, status=2)[2]
    assert not out.exists()


@pytest.mark.parametrize(
    ("sigma", "message"),
    [
        ("10 um", 'sigma: "10 um" is not a length per angle, write it like "10 um/rad"'),
        ("-1 um/rad", "sigma: .* must be above zero"),
        (0.0, "sigma: 0.0, expected a positive number in m/rad such as 1e-5, or one with its unit"),
        (None, "sigma: .*, expected a positive number"),
        (1e-300, "sigma: 1e-300 m/rad, expected 1e-12 to 1"),
        ("20 nm/rad", "sigma: 2e-08 m/rad takes .* h with these amplitudes, expected 48 h or less; raise"),
    ],
)
def test_a_sigma_that_is_none_or_takes_too_long_is_refused(tmp_path, sigma, message):
    with pytest.raises(InputError, match=message):
        design_manoeuvre(CAMPAIGN, tmp_path / "d.toml", sigma=sigma)
    assert not (tmp_path / "d.toml").exists()


def test_options_that_a_manoeuvre_does_not_use_are_refused(lpfcosim):
    message = lpfcosim("design", CAMPAIGN, "--ttl", "10 um/rad", "--jobs", "2", status=2)[2]
    assert "--jobs: not available with --ttl" in message
    message = lpfcosim("design", ROOT / "campaigns" / "quickstart.toml", "--ttl", "10 um/rad", status=2)[2]
    assert "a manoeuvre for tilt-to-length coupling is not available for runs along x" in message


def test_the_opening_of_each_spacecraft_turns_theta_into_eta_of_its_assemblies(tmp_path):
    wide = _campaign(
        tmp_path, '[truth]\nhalf_opening = "40 deg"\n' + _experiment("SC1", "sc1").replace("SC1", "SC0")
    )
    (run,) = [run for run in loading.load(wide).runs if run.kind == "sysid"]
    openings = manoeuvre.half_openings([run] * 3)
    assert openings == pytest.approx(dict.fromkeys(ASSEMBLIES, np.radians(40.0)))
    at_rest = dict.fromkeys(
        ("jitter_theta", "jitter_eta", "jitter_phi", "jitter_x_1", "jitter_x_2"), np.zeros(1)
    )
    at_rest |= {"mosa_1": np.zeros(1), "mosa_2": np.zeros(1)}
    series = spacecraft_motion(at_rest, "1", openings["1"])
    series |= spacecraft_motion(at_rest | {"jitter_theta": np.ones(1)}, "2", openings["2"])
    angles = assembly_angles(series | spacecraft_motion(at_rest, "3", openings["3"]))
    assert angles["eta_23"] == pytest.approx(-np.sin(np.radians(40.0)))
    assert angles["eta_21"] == pytest.approx(np.sin(np.radians(40.0)))
    assert angles["eta_12"] == 0
