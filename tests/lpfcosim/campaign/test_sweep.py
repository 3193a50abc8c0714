"""Sweeps and defaults: the experiments they make, and what is refused."""

from dataclasses import replace

from lpfcosim.campaign import loading
from tests import ROOT

QUICKSTART = ROOT / "campaigns" / "quickstart.toml"


def test_every_value_makes_the_first_experiment_again():
    plan = loading.load(ROOT / "campaigns" / "sweep.toml")
    base = loading.load(QUICKSTART)
    limits = [50, 200, 400, 800, 1100, 1600, 2200, 3000]
    assert [e.name for e in plan.experiments] == [f"F_max_2-{F}pN" for F in limits]
    assert [r.name for r in plan.runs[:2]] == ["F_max_2-50pN-noise", "F_max_2-50pN"]
    for made, F in zip(plan.experiments, limits, strict=True):
        authority = replace(base.authority["A"], name=made.name, F_max_2=float(f"{F}e-12"))
        assert plan.authority[made.authority] == authority
        assert made == replace(base.experiments[0], name=made.name, authority=made.name)
    assert len({run.t0 for run in plan.runs}) == 16


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
