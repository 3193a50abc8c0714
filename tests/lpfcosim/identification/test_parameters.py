"""Which parameter of which FMU is meant, and what a trial sets."""

from dataclasses import replace

import pytest

from lpfcosim.campaign import IdentifyTable
from lpfcosim.cosim import read_interfaces
from lpfcosim.identification import targets
from lpfcosim.identification.parameters import settings
from lpfcosim.spacecraft import Replacement
from tests import third_party
from tests.lpfcosim.cosim.archives import renamed

pytestmark = pytest.mark.fmu


@pytest.fixture
def resolved(make_run, plan, fmus):
    def made(sought, *replacements):
        run = make_run(replacements=replacements)
        archives = {**fmus, **{r.model: r.path for r in replacements}}
        return targets(replace(plan, identify=sought), run, read_interfaces(run, archives))

    return made


def test_a_delay_coefficient_is_a_gain_times_a_delay(resolved):
    both = resolved({"C_2": IdentifyTable(), "lambda_2": IdentifyTable()})
    theta = {"C_2": 0.2, "lambda_2": 1.25}
    half_sample = 0.05  # of hold, which the coefficient includes and the FMU's transport delay does not
    values = settings(both, theta, {})
    assert values["Actuation"] == {"lambda_2": 1.25}
    assert values["Plant"]["tau_2"] == pytest.approx(0.16 - half_sample, rel=1e-14)
    alone = resolved({"C_2": IdentifyTable()})
    values = settings(alone, {"C_2": 0.2}, {"lambda_2": 1.25, "lambda_1": 1.0})
    assert values["Plant"]["tau_2"] == pytest.approx(0.16 - half_sample, rel=1e-14)


@pytest.mark.parametrize("key", ["SuspensionControl.f_u", "SuspensionControl.bandwidth"])
def test_a_parameter_of_another_fmu_is_meant_by_its_name_or_by_ours(resolved, fmus, tmp_path, key):
    archive = renamed(fmus["SuspensionControl"], tmp_path / "mine.fmu", {"f_u": "bandwidth"})
    mine = Replacement("SuspensionControl", archive, {"f_u": "bandwidth"})
    (target,) = resolved({key: IdentifyTable(start=1.1e-3)}, mine)
    assert (target.name, target.variable) == ("SuspensionControl.f_u", "bandwidth")
    assert (target.default_value, target.unit) == (1e-3, "Hz")
    assert settings([target], {target.name: 2e-3}, {}) == {"SuspensionControl": {"bandwidth": 2e-3}}


@pytest.mark.parametrize(("values", "given"), [({}, 1.0), ({"single": 0.75}, 0.75)])
def test_a_parameter_of_another_fmu_has_its_start_value_or_that_of_the_campaign(
    resolved, tmp_path, values, given
):
    archive = third_party.built(tmp_path, fmi="3.0")
    mine = Replacement("SuspensionControl", archive, third_party.VARIABLES, third_party.UNUSED, values=values)
    (target,) = resolved({"SuspensionControl.single": IdentifyTable(width=0.1)}, mine)
    assert target.default_value == given
