"""Sweeps and defaults: the experiments they make, and what is refused."""

from dataclasses import replace

import pytest

from lpfcosim.campaign import loading
from tests import ROOT

QUICKSTART = ROOT / "campaigns" / "quickstart.toml"


@pytest.fixture
def swept(extended):
    """Write a campaign with a sweep."""
    return lambda text, more="": extended(f"{more}\n[sweep]\n{text}", "sweep")


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


def test_lists_go_together_entry_by_entry(swept):
    lists = 'F_max_2 = ["50 pN", "1100 pN"]\nN_max_2 = ["1.0 pN m", "10.4 pN m"]'
    plan = loading.load(swept(lists))
    assert [e.name for e in plan.experiments] == [
        "F_max_2-50pN_N_max_2-1.0pNm",
        "F_max_2-1100pN_N_max_2-10.4pNm",
    ]
    one, two = (plan.authority[e.authority] for e in plan.experiments)
    assert (one.F_max_2, one.N_max_2, one.N_max_1) == pytest.approx((50e-12, 1e-12, 10.4e-12))
    assert (two.F_max_2, two.N_max_2) == pytest.approx((1.1e-9, 10.4e-12))
    assert "sweep" not in plan.tables


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
