"""Campaigns with FMUs of other tools: what runs log, what is trusted, and what makes another campaign."""

from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest

from lpfcosim.campaign import loading
from lpfcosim.execution import fmus as archives
from lpfcosim.execution import runner
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
    mine = {**fmus, MODEL: plan.replacements[0].path}
    folder.mkdir(exist_ok=True)
    with archives.snapshot(plan, mine, folder, trusted=True) as copies, ThreadPoolExecutor(1) as executor:
        options = runner.RunOptions(executor=executor)
        assert not runner.simulate(plan, folder / "telemetry", copies, options).failures


def f_x_2(folder):
    with h5py.File(folder / "telemetry" / "one.h5") as file:
        return file["f_x_2"][:]


def test_typed_values_reach_the_telemetry(load, fmus, tmp_path):
    third_party.built(tmp_path)
    simulate(load(), fmus, tmp_path / "plain")
    simulate(load("values = { label = 'half', mode = 2 }"), fmus, tmp_path / "half")
    assert not np.array_equal(f_x_2(tmp_path / "plain"), f_x_2(tmp_path / "half"))


def test_values_make_a_campaign_and_the_switch_of_validation_does_not(load, tmp_path):
    third_party.built(tmp_path)
    values = ("2", "2.0", "2 }\nvalidate = false #", "3", "true", '"2"')
    digests = [load(f"values = {{ mode = {mode} }}").digest for mode in values]
    assert digests[0] == digests[1] == digests[2]
    assert len(set(digests)) == 4
