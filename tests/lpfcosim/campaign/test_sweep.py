"""Sweeps and defaults: the experiments they make, and the sentence for all that can be wrong with them."""

from dataclasses import replace

import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from tests import ROOT

QUICKSTART = ROOT / "campaigns" / "quickstart.toml"


@pytest.fixture
def swept(extended):
    """Write a campaign with a sweep."""
    return lambda text, more="": extended(f"{more}\n[sweep]\n{text}", "sweep")


def test_every_value_makes_the_first_experiment_again():
    plan = loading.load(ROOT / "campaigns" / "sweep.toml")
    first = loading.load(QUICKSTART).experiments[0]
    limits = [50, 200, 400, 800, 1100, 1600, 2200, 3000]
    assert [e.name for e in plan.experiments] == [f"F_max_2-{F}pN" for F in limits]
    assert [r.name for r in plan.runs[:2]] == ["F_max_2-50pN-noise", "F_max_2-50pN"]
    for made, F in zip(plan.experiments, limits, strict=True):
        authority = replace(first.authority, name=made.name, F_max_2=pytest.approx(1e-12 * F))
        assert made == replace(first, name=made.name, authority=authority)
    assert len({run.t0 for run in plan.runs}) == 16


def test_lists_go_together_entry_by_entry(swept):
    lists = 'F_max_2 = ["50 pN", "1100 pN"]\nN_max_2 = ["1.0 pN m", "10.4 pN m"]'
    one, two = loading.load(swept(lists)).experiments
    assert (one.name, two.name) == ("F_max_2-50pN_N_max_2-1pNm", "F_max_2-1100pN_N_max_2-10.4pNm")
    assert (one.authority.F_max_2, one.authority.N_max_2) == pytest.approx((50e-12, 1e-12))
    assert (two.authority.F_max_2, two.authority.N_max_2) == pytest.approx((1.1e-9, 10.4e-12))
    assert one.authority.N_max_1 == pytest.approx(10.4e-12)


def test_names_are_files_and_each_is_used_once(swept):
    result = loading.load(swept('F_max_2 = ["50 pN", "10 nN", "50 pN"]')).experiments
    assert [e.name for e in result] == ["F_max_2-50pN", "F_max_2-10000pN", "F_max_2-50pN-2"]


BAD = [  # the table, and what the sentence then says
    ("", 'sweep: is empty, write a list, such as F_max_2 = ["50 pN", "2200 pN"]'),
    ('F_max_2 = ["50 pN"]', "sweep.F_max_2: is of length 1, expected at least 2"),
    ('F_max_2 = ["50 pN", "1 nm"]', 'sweep.F_max_2[1]: "1 nm" is not a force'),
    (
        'F_max_2 = ["50 pN", "1 nN"]\nN_max_2 = ["1 pN m", "2 pN m", "3 pN m"]',
        "sweep.N_max_2: has 3 values and sweep.F_max_2 has 2, expected as many",
    ),
    ('F_max_2 = ["1 nN", "1000 pN"]', "sweep.F_max_2: all its values are the same, expected two that differ"),
    (
        'F_max_2 = ["50 pN", "10 pN"]',
        "sweep.F_max_2[1]: experiments[0].dc: compensating it takes 14.31 pN of the 10 pN that authority set",
    ),
    (
        'F_max_2 = ["16 pN", "50 pN"]',
        'sweep.F_max_2[0]: the injections of "F_max_2-16pN" take f_x_2 to 106 % of its authority',
    ),
    ('duration = ["6 h", "3 h"]', "sweep.duration: unknown key"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "sentence"), BAD)
def test_bad_sweeps_are_one_sentence_with_their_place(swept, refusal, text, sentence):
    assert refusal(swept(text)).startswith(sentence)


EXPERIMENT = '[[experiments]]\nname = "one"\nauthority = "A"\nduration = "6 h"\nnoise_duration = "6 h"\n'


def test_sweeps_that_would_tell_nothing_are_refused(swept):
    nothing = 'F_max_2 = ["50 pN", "1 nN"]'
    with pytest.raises(
        InputError, match=r"sweep: nothing is injected into experiments\[0\], so that the sweep"
    ):
        loading.load(swept(nothing, EXPERIMENT))
    quiet = EXPERIMENT.replace('duration = "6 h"\n', "", 1)
    assert [r.kind for r in loading.load(swept(nothing, quiet)).runs] == ["noise", "noise"]
    tone = 'shape = "sine", frequency = "1 mHz", amplitude = "1 nm", cycles = 4, start = "0 s"'
    still = f'{EXPERIMENT}injections = [{{ into = "guidance_o_12", {tone} }}]\n'
    with pytest.raises(InputError, match=r"sweep.F_max_1: changes the stiffness of test mass 1 alone, which"):
        loading.load(swept(nothing.replace("2 =", "1 ="), still))
    assert len(loading.load(swept(nothing, still)).runs) == 4


def test_defaults_say_once_what_experiments_have_in_common(tmp_path):
    text = QUICKSTART.read_text(encoding="utf-8")
    keys = 'duration = "6 h"\nnoise_duration = "6 h"\n'
    common = (
        text.replace(keys, "")
        .replace('sequences = ["standard"]\n', "")
        .replace("[noise]", f'[defaults]\n{keys}sequences = ["standard"]\nalignment_epoch = 1\n\n[noise]', 1)
    )
    path = tmp_path / "defaults.toml"
    path.write_text(common, encoding="utf-8")
    assert loading.load(path) == loading.load(QUICKSTART)
    assert loading.load(path).digest == loading.load(QUICKSTART).digest


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ("", "every experiment says"),
        ('[sweep]\nF_max_2 = ["50 pN", "200 pN"]', "experiments[0], of which the sweep is made, says"),
    ],
)
def test_defaults_that_change_nothing_are_refused(extended, refusal, more, sentence):
    path = extended(f'[defaults]\nduration = "9 h"\n{more}', "longer")
    assert refusal(path).startswith(f"defaults.duration: changes nothing, {sentence}")
    above = path.with_name("last.toml")  # what a file beneath says in vain hurts nobody
    above.write_text('schema = "lpf-campaign/1"\nextends = "longer.toml"\nname = "last"\n', encoding="utf-8")
    assert loading.load(above).runs
