"""Campaigns with FMUs of other tools: what runs log, what is trusted, and what makes another campaign."""

import h5py
import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import runner, validation
from lpfcosim.export import ssp
from tests import campaign_text, third_party

pytestmark = pytest.mark.fmu
MODEL = "SuspensionControl"


@pytest.fixture
def load(tmp_path):
    def campaign(more="", duration="300 s"):
        file = tmp_path / "own.toml"
        tables = third_party.TABLE + more
        file.write_text(campaign_text.campaign(f'duration = "{duration}"', seed=3, tables=tables))
        return loading.load(file)

    return campaign


def simulate(plan, fmus, folder):
    """Simulate as the command does: through copies that are gone afterwards."""
    mine = {**fmus, MODEL: plan.replacements[0].archive}
    folder.mkdir(exist_ok=True)
    with archives.snapshot(plan, mine, folder, trusted=True) as copies:
        return runner.simulate(plan, folder / "telemetry", copies, runner.RunOptions(jobs=1))


def f_x_2(folder):
    with h5py.File(folder / "telemetry" / "one.h5") as file:
        return file["f_x_2"][:]


def test_typed_values_reach_the_workers(load, fmus, tmp_path):
    third_party.built(tmp_path)
    assert not simulate(load(), fmus, tmp_path / "plain").failures
    assert not simulate(load("values = { label = 'half', mode = 2 }"), fmus, tmp_path / "half").failures
    assert not np.array_equal(f_x_2(tmp_path / "plain"), f_x_2(tmp_path / "half"))


def test_values_make_a_campaign_and_the_switch_of_validation_does_not(load, tmp_path):
    third_party.built(tmp_path)
    digests = [
        load(f"values = {{ mode = {mode} }}\n{more}").digest
        for mode, more in (
            ("2", ""),
            ("2.0", ""),
            ("2", "validate = false"),
            ("3", ""),
            ("true", ""),
            ('"2"', ""),
        )
    ]
    assert digests[0] == digests[1] == digests[2]
    assert len(set(digests)) == 4


def test_what_an_fmu_says_is_logged(load, fmus, tmp_path):
    third_party.built(tmp_path, "TRACEBACK")
    failures = simulate(load(), fmus, tmp_path / "out").failures
    assert str(failures["one"]).endswith("FMU reports 'fatal' at 5.0 s (ValueError: an empty table)")
    assert 'File "slave.py", line 3' in (tmp_path / "out" / "logs" / "one.log").read_text()


@pytest.mark.parametrize("macro", ["QUIET_FAILURE", "RESOURCE"])
def test_errors_name_the_file_of_the_user(load, fmus, tmp_path, macro):
    archive = third_party.built(tmp_path, macro)
    with pytest.raises(InputError) as refused:
        simulate(load(), fmus, tmp_path / "out")
    assert str(refused.value).startswith(f"{archive}: cannot be ")
    assert ".lpfcosim-" not in str(refused.value)


#: Experiments that differ in the force to be held, and so in a start value, and in their authority.
TWO_FORCES = """duration = "30 min"
dc = "0 m s^-2"

[authority.B]
F_max_1 = "0 pN"
F_max_2 = "2000 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"

[[experiments]]
name = "two"
authority = "B"
alignment_epoch = 1
duration = "30 min"
dc = "8e-12 m s^-2"
"""


@pytest.fixture
def two_forces(tmp_path):
    def campaign(of, attribute):
        """Write it with an FMU that states a range of a parameter."""
        stated = (rf'(name="{of}"[^>]*>\s*<Real unit="[^"]*" start="[^"]*")[^/]*', rf"\1 {attribute}")
        third_party.built(tmp_path, changes=[stated])
        text = campaign_text.campaign(TWO_FORCES, seed=3, tables=third_party.TABLE)
        (tmp_path / "own.toml").write_text(text)
        return loading.load(tmp_path / "own.toml")

    return campaign


RANGES = [
    ("hold", 'min="-1e-12"', "run two: fmus.SuspensionControl: FILE: variable 'hold': -7"),
    ("hold", 'max="-1e-12"', "run one: fmus.SuspensionControl: FILE: variable 'hold': "),
    ("hold", 'min="1"', "runs one, two: fmus.SuspensionControl: FILE: variable 'hold': "),
    (
        "bandwidth",
        'max="1e-4"',
        "fmus.SuspensionControl: FILE: variable 'bandwidth': 0.001, expected at most",
    ),
]


@pytest.mark.parametrize(("of", "attribute", "said"), RANGES)
def test_parameters_of_every_run_are_checked_before_any_is_simulated_or_exported(
    two_forces, tmp_path, of, attribute, said
):
    plan = two_forces(of, attribute)
    with pytest.raises(InputError) as refused:
        validation.validate(plan)
    assert str(refused.value).replace(str(plan.replacements[0].archive), "FILE").startswith(said)
    with pytest.raises(InputError) as refused:
        ssp.export(plan, {MODEL: plan.replacements[0].archive}, tmp_path / "loop.ssp")
    assert str(refused.value).replace(str(plan.replacements[0].archive), "FILE").startswith(said)
