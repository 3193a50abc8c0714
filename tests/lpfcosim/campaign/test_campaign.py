"""Campaign files: what they become."""

from datetime import UTC, datetime

import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.execution.telemetry_file import truth
from lpfcosim.models import one_axis
from lpfcosim.signals import generator
from lpfcosim.spacecraft import Authority, HalfCosine, Sine
from tests.lpfcosim.campaign.conftest import TWO_EXPERIMENTS


def test_everything_arrives_in_si(file):
    c = loading.load(file)
    assert (c.name, c.seed, c.t0) == ("test", 1, datetime(2016, 4, 16, 8, tzinfo=UTC))
    assert c.truth == one_axis.MODEL.stated_truth | {"lambda_1": 1.07}
    assert c.control["DragFreeControl"] == {"f_u": 0.09, "f_z": 0.03, "f_i": 0.006, "f_p": 0.8, "f_r": 2.0}
    _, first, second = c.runs
    assert first.authority == Authority("A", 2.2e-9, 2.2e-9, 1.04e-11, 1.04e-11)
    assert first.noise == {"oms": 35e-15, "tail": 1.5}
    assert second.noise == {"oms": 35e-15, "tail": 1.0, "plateau": 5e-15}
    assert first.injections == (Sine("guidance_o_12", 10e-9, 1e-3, 2, 60.0),)
    assert second.injections == (
        HalfCosine("F_x_1", 1.5e-9, 10.0, 20.0),
        Sine("F_x_1", 0.6e-12, 10e-3, 20, 30.0, phase=second.injections[1].phase),
    )
    assert second.injections[1].phase == pytest.approx(np.pi / 2)


def test_runs_follow_one_another_noise_first(file):
    runs = loading.load(file).runs
    assert [r.name for r in runs] == ["first-noise", "first", "second"]
    assert [r.experiment for r in runs] == ["first", "first", "second"]
    assert [r.kind for r in runs] == ["noise", "sysid", "sysid"]
    assert [r.n_samples for r in runs] == [18_000, 36_000, 72_000]
    assert [r.t0 for r in runs] == ["2016-04-16T08:00:00Z", "2016-04-16T08:30:00Z", "2016-04-16T09:30:00Z"]
    assert [len(r.injections) for r in runs] == [0, 1, 2]
    assert runs[2].dc == -8e-12
    parameters = one_axis.MODEL.parameters(runs[2])
    assert parameters["Actuation"]["f_x_2_start"] == pytest.approx(8e-12 / 1.0776, rel=1e-6, abs=0)
    assert parameters["OpticalMetrology"]["delta_ifo"] == -2.09e-5
    assert runs[0].time[-1] == 1799.9
    assert truth(runs[0])["omega2_1"] == pytest.approx(-3.99e-7 - 345 * 2.2e-9 - 28.2e3 * 10.4e-12)  # Eq. (8)


def test_digest_is_of_the_content_not_of_its_spelling(file):
    digest = loading.load(file).digest
    file.write_text("# a comment\n" + TWO_EXPERIMENTS.replace('"10 nm"', '"1e-8 m"'), encoding="utf-8")
    assert loading.load(file).digest == digest
    file.write_text(TWO_EXPERIMENTS.replace('"10 nm"', '"11 nm"'), encoding="utf-8")
    assert loading.load(file).digest != digest
    file.write_text(TWO_EXPERIMENTS + '\n[fit]\nestimator = "student_t"\n', encoding="utf-8")
    assert (loading.load(file).fit, loading.load(file).digest) == ({"estimator": "student_t"}, digest)


def test_a_campaign_adds_to_the_one_it_extends(file):
    more = file.parent / "more.toml"
    more.write_text(
        'extends = "c.toml"\nname = "more"\n'
        '[truth]\nlambda_1 = 1.08\n[noise]\nplateau = "4 fm s^-2 Hz^-0.5"\n',
        encoding="utf-8",
    )
    base, c = loading.load(file), loading.load(more)
    assert (c.name, c.truth) == ("more", base.truth | {"lambda_1": 1.08})
    assert c.runs[0].noise == base.runs[0].noise | {"plateau": 4e-15}
    assert [r.name for r in c.runs] == [r.name for r in base.runs]


def test_an_experiment_may_start_later_but_not_before_the_one_before_it_ends(file):
    second = 'name = "second"\nt0 = "2016-{}:00:00Z"'
    file.write_text(TWO_EXPERIMENTS.replace('name = "second"', second.format("05-01T00")))
    assert loading.load(file).runs[2].t0 == "2016-05-01T00:00:00Z"
    file.write_text(TWO_EXPERIMENTS.replace('name = "second"', second.format("04-16T09")))
    with pytest.raises(InputError, match=r'"second" begins at .*, before "first" ends'):
        loading.load(file)


def test_gains_scatter_from_experiment_to_experiment_alone(file):
    file.write_text(TWO_EXPERIMENTS.replace("[truth]", "[truth]\nlambda_scatter = 0.005"), encoding="utf-8")
    noise, first, second = loading.load(file).runs
    assert noise.truth == first.truth
    assert first.truth["lambda_2"] != second.truth["lambda_2"]
    # commands are as late as ever
    assert truth(first)["tau_2"] == pytest.approx(truth(second)["tau_2"], rel=1e-12)
    assert first.about == second.about == loading.load(file).truth
    assert truth(first)["lambda_2_mean"] == first.about["lambda_2"] != truth(first)["lambda_2"]
    drawn = [one_axis.scattered(first.truth, generator(1, f"e{i}"))["lambda_2"] for i in range(2000)]
    gains = np.array(drawn) / first.truth["lambda_2"]
    assert np.std(gains) == pytest.approx(0.005, rel=0.1)  # six sigma
