"""What a campaign says of the whole spacecraft: cross-talk by period, its compensation and drift, layout."""

import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.models import model_of
from lpfcosim.spacecraft import EIGHT_NOZZLES, Lead
from tests.campaign_text import campaign

EXPERIMENT = 'inertial_period = 1\nnoise_duration = "10 d"\n'
PERIOD = '[spacecraft.period.1]\ndelta_phi = "-0.47 mrad"\ndelta_eta = "-0.066 mrad"\n'
LENGTHS = 'b_1 = "12 um/rad"\nb_2 = "-9 um/rad"\nb_3 = 2.2e-5\n'
D = 0.376


@pytest.fixture
def make(tmp_path):
    def load(spacecraft, period="", head="", more=""):
        path = tmp_path / "c.toml"
        table = f"[spacecraft]\n{spacecraft}\n{PERIOD}{period}\n" if spacecraft is not None else ""
        one = EXPERIMENT if table else EXPERIMENT.replace("inertial_period = 1", "")
        path.write_text(campaign(f"{one}{more}", tables=f"{head}\n{table}"), encoding="utf-8")
        return loading.load(path).runs

    return load


ALONE = (1.2e-5, -0.9e-5, 2.2e-5)
COMPENSATED = LENGTHS + "lever_arm_compensated = true\n"
DRIFT = LENGTHS + 'b_1_drift = "1 um rad^-1 d^-1"\n'
CROSS_TALK = [  # keys of the spacecraft, of the period, of the experiment, and the first of its lengths
    (LENGTHS, "", "", ALONE),
    (LENGTHS, 'b_2 = "3 um/rad"\n', "", (1.2e-5, 3e-6, 2.2e-5)),
    (COMPENSATED, "", "", (1.2e-5 + 0.47e-3 * D, -0.9e-5 - 0.066e-3 * D, 2.2e-5)),
    (COMPENSATED, 'b_2 = "3 um/rad"\n', "", (1.2e-5 + 0.47e-3 * D, 3e-6 - 0.066e-3 * D, 2.2e-5)),
    (DRIFT, "", "", (1.2e-5 + 5e-6, -0.9e-5, 2.2e-5)),  # middle of ten days
    (DRIFT, "", 't0 = "2016-03-11T00:00:00Z"\n', (1.2e-5 + 15e-6, -0.9e-5, 2.2e-5)),
]


@pytest.mark.parametrize(("spacecraft", "period", "more", "expected"), CROSS_TALK)
def test_cross_talk_of_a_period_is_compensated_and_drifts(make, spacecraft, period, more, expected):
    run = make(spacecraft, period, more=more)[0]
    assert run.spacecraft.b[:3] == pytest.approx(expected)
    assert model_of(run).truth(run)["b_1"] == run.spacecraft.b[0]


def test_layout_and_attitude_are_as_asked(make):
    assert make("")[0].spacecraft.layout is None
    head = '[control.attitude]\nunity_gain = "0.05 mHz"\n'
    craft = make('thruster_layout = "eight nozzles"\n', head=head)[0].spacecraft
    assert craft.layout == EIGHT_NOZZLES
    assert craft.attitude == Lead(unity_gain=5e-5, zero=0.021e-3, pole=0.42e-3)


def test_angular_stiffness_follows_the_authority_where_asked(make):
    """By hand, with 2200 pN on test mass 2 and 10.4 pN m on both; electrodes at 11 mm, 14.5 by 36 mm."""
    still, follows = make(""), make('omega2_phi_0 = "-1.2e-6 s^-2"\n')
    assert model_of(still[0]).attributes(still[0])["omega2_phi"] == -1.5e-6
    told = model_of(follows[0]).attributes(follows[0])
    per_x = 1.928 / 6.8e-4 * (11e-3**2 + 14.5e-3**2 / 12 - 23e-3 * 2.9e-10 / 1.58e-7)
    along_x = (-28.2e3 * 10.4e-12, -27.4e3 * 10.4e-12 - 317 * 2200e-12)
    assert told["omega2_phi"] == pytest.approx(-1.2e-6 + per_x * sum(along_x) / 2, rel=1e-4)
    assert told["omega2_eta"] == -1.5e-6
    plant = model_of(follows[0]).parameters(follows[0])["WholePlant"]
    assert plant["domega2_phi_12"] == pytest.approx(per_x * (along_x[1] - along_x[0]), rel=1e-4)
    assert "domega2_eta_12" not in plant


TORQUE = 'noise = { thruster_torque = "1 uN m Hz^-0.5" }\n'


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (
            {"spacecraft": None, "head": '[control.attitude]\nzero = "1 uHz"\n'},
            "control.attitude: the x axis alone has no attitude, it takes [spacecraft]",
        ),
        (
            {"spacecraft": 'thruster_layout = "eight nozzles"', "more": TORQUE},
            "experiments[0].noise.thruster_torque: spacecraft.thruster_layout makes the noise of the torques",
        ),
        ({"spacecraft": 'thruster_layout = "nine"'}, 'spacecraft.thruster_layout: "nine" is not'),
        ({"spacecraft": "lever_arm_compensated = 1"}, "spacecraft.lever_arm_compensated: "),
        ({"spacecraft": 'b_1_drift = "1 um/rad"'}, 'spacecraft.b_1_drift: "1 um/rad" is not a drift of a'),
        ({"spacecraft": "", "period": "b_1 = 3\n"}, "spacecraft.period.1.b_1: 3 has no unit"),
    ],
)
def test_what_does_not_go_together_is_told(make, keys, told):
    with pytest.raises(InputError) as error:
        make(**keys)
    assert told in str(error.value)
