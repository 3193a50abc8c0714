"""What a campaign says of the whole spacecraft: cross-talk by period and its drift, stiffness of angles."""

import pytest

from lpfcosim.campaign import loading
from lpfcosim.models import model_of
from tests.campaign_text import campaign

PERIOD = '[inertial_period.1]\ndelta_phi = "-0.47 mrad"\ndelta_eta = "-0.066 mrad"\n'
LENGTHS = 'b_1 = "12 um/rad"\nb_2 = "-9 um/rad"\n'
DRIFT = LENGTHS + 'b_1_drift = "1 um rad^-1 d^-1"\n'


@pytest.fixture
def make(tmp_path):
    def load(truth, period="", more=""):
        path = tmp_path / "c.toml"
        keys = f'inertial_period = 1\nnoise_duration = "10 d"\n{more}'
        tables = f'spacecraft = "lpf"\n[truth]\n{truth}\n{PERIOD}{period}\n'
        path.write_text(campaign(keys, tables=tables), encoding="utf-8")
        return loading.load(path).runs

    return load


CROSS_TALK = [  # keys of the truth, of the period, of the experiment, and b_1, b_2
    (LENGTHS, "", "", (1.2e-5, -0.9e-5)),
    (LENGTHS, 'b_2 = "3 um/rad"\n', "", (1.2e-5, 3e-6)),
    (DRIFT, "", "", (1.2e-5 + 5e-6, -0.9e-5)),  # middle of ten days
    (DRIFT, "", 't0 = "2016-03-11T00:00:00Z"\n', (1.2e-5 + 15e-6, -0.9e-5)),
]


@pytest.mark.parametrize(("truth", "period", "more", "expected"), CROSS_TALK)
def test_cross_talk_is_that_of_a_period_and_drifts(make, truth, period, more, expected):
    run = make(truth, period, more=more)[0]
    values = model_of(run).true_values(run)
    assert (values["b_1"], values["b_2"]) == pytest.approx(expected)
    assert values["delta_phi"] == -0.47e-3
    parameters = model_of(run).parameters(run)
    assert parameters["WholeMetrology"]["b_1"] == values["b_1"]
    assert parameters["WholePlant"]["delta_y"] == pytest.approx(-0.47e-3 * 0.376)


def test_angular_stiffness_follows_the_authority_where_it_has_a_background(make):
    """By hand, with 2200 pN on test mass 2 and 10.4 pN m on both; electrodes at 11 mm, 14.5 by 36 mm."""
    still, follows = make(""), make('omega2_phi_0 = "-1.2e-6 s^-2"\n')
    assert model_of(still[0]).attributes(still[0])["omega2_phi"] == -1.5e-6
    attributes = model_of(follows[0]).attributes(follows[0])
    per_x = 1.928 / 6.8e-4 * (11e-3**2 + 14.5e-3**2 / 12 - 23e-3 * 2.9e-10 / 1.58e-7)
    along_x = (-28.2e3 * 10.4e-12, -27.4e3 * 10.4e-12 - 317 * 2200e-12)
    assert attributes["omega2_phi"] == pytest.approx(-1.2e-6 + per_x * sum(along_x) / 2, rel=1e-4)
    assert attributes["omega2_eta"] == -1.5e-6
    plant = model_of(follows[0]).parameters(follows[0])["WholePlant"]
    assert plant["domega2_phi_12"] == pytest.approx(per_x * (along_x[1] - along_x[0]), rel=1e-4)
    assert "domega2_eta_12" not in plant
