"""Designs as campaign files: read again, they are the designed campaigns, with the comments of the user."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from lpfcosim.campaign import loading
from lpfcosim.experiment_design import campaign_text
from lpfcosim.experiment_design.tones import Tone
from lpfcosim.spacecraft import Sine

TONES = (
    Tone(Sine("guidance_o_12", 2e-8, 5e-3, 30, start=900.0, phase=0.5, ramp=300.0), {"C_2": 1.5}),
    Tone(Sine("F_x_2", 1e-11, 2e-3, 12, start=900.0, ramp=300.0), {}),
)
HEAD = '#:schema ./lpf-campaign.json\n# of mine\nschema = "lpf-campaign/2"\nname = "mine"\nseed = 3\n'
SETS = """
[authority]  # of the flight
A = { F_max_1 = "0 pN", F_max_2 = "2200 pN", N_max_1 = "1 pN m", N_max_2 = "1 pN m" }
"""
STEP = '{ into = "guidance_o_12", shape = "half_cosine", amplitude = "1 nm", start = "1 s", end = "9 s" }'
SINE = STEP.replace("half_cosine", "sine").replace('end = "9 s"', 'frequency = "1 mHz", cycles = 3')
PLAIN = f"""
[defaults]
authority = "A"
duration = "6 h"
sequences = ["both"]

[design]
sines = 2

[[experiments]]
name = "one"  # the first
noise_duration = "6 h"
injections = [
  {STEP},
]

[[experiments]]
name = "two"
sequences = []

[[experiments]]
name = "silent"
duration = "0 s"
noise_duration = "7 h"
sequences = []

[sequences]
both = [
  {STEP},
  {SINE},
]
"""
SWEEP = f"""
[[experiments]]
name = "base"
authority = "A"
duration = "6 h"
injections = [{SINE}]

[sweep]
F_max_2 = ["50 pN", "2200 pN"]
"""


def designed(campaign):
    """A design with tones in all experiments that have a run with injections."""
    experiments, tones = [], {}
    for experiment in campaign.experiments:
        if experiment.duration:
            tones[experiment.name] = TONES
            steps = tuple(i for i in experiment.injections if not hasattr(i, "frequency"))
            injections = (*steps, *(tone.injection for tone in TONES))
            experiment = replace(experiment, injections=injections)
        experiments.append(experiment)
    problem = SimpleNamespace(plan=campaign, parameters=["C_2"], sigmas_before={"C_2": 2.0})
    return SimpleNamespace(
        campaign=replace(campaign, experiments=tuple(experiments)),
        problem=problem,
        tones=tones,
        value=0.5,
        optimum=SimpleNamespace(bound=0.4),
        sigmas_after={"C_2": 1.0},
    )


def assert_same(campaign, expected):
    for experiment, other in zip(campaign.experiments, expected.experiments, strict=True):
        assert replace(experiment, injections=()) == replace(other, injections=())
        for injection, sought in zip(experiment.injections, other.injections, strict=True):
            names = {"into": sought.into, "shape": sought.shape}
            assert vars(injection) | names == vars(injection)
            assert vars(injection) | dict.fromkeys(names, 0) == pytest.approx(
                vars(sought) | dict.fromkeys(names, 0), rel=1e-5, abs=0
            )


@pytest.mark.parametrize("content", [PLAIN, SWEEP], ids=["plain", "sweep"])
@pytest.mark.parametrize("extended", [False, True])
def test_text_is_that_of_the_designed_campaign(content, extended, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + SETS + content, encoding="utf-8")
    if extended:
        path = tmp_path / "upper.toml"
        path.write_text('extends = "mine.toml"\nname = "upper"\n', encoding="utf-8")
    design = designed(loading.load(path))
    text = campaign_text(design, "better", path.name, path.read_text(encoding="utf-8"))
    (tmp_path / "better.toml").write_text(text, encoding="utf-8")
    campaign = loading.load(tmp_path / "better.toml")
    assert campaign.name == "better"
    assert_same(campaign, design.campaign)
    assert "[design]" not in text
    assert text.count("# without it C_2 x1.5") == text.count("# keeps the peaks low") == 2


def test_comments_are_kept_and_the_schema_stays_first(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + SETS + PLAIN, encoding="utf-8")
    text = campaign_text(designed(loading.load(path)), "better", path.name, path.read_text(encoding="utf-8"))
    assert text.startswith("#:schema ./lpf-campaign.json\n# mine.toml, redesigned by lpfcosim design.\n")
    for comment in ("# of mine", "# of the flight", "# the first"):
        assert comment in text
