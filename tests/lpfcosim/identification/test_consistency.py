"""Telemetry that is not of the campaign beside which it is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit.telemetry.reader import Telemetry
from lpfcosim.errors import InputError
from lpfcosim.execution import telemetry_file
from lpfcosim.identification import check
from lpfcosim.identification.consistency import loop_mismatch
from lpfcosim.linear import ClosedLoop

LOOP = {"Plant": "12ab", "Actuation": "34cd"}
SIMULATED = {"campaign_digest": "ef56", **{f"fmu_{name}": digest for name, digest in LOOP.items()}}


@pytest.fixture
def flown(plan):
    """The telemetry of that campaign, as flown: it does not tell where it is from."""
    result = []
    for run in plan.runs:
        said, channels = telemetry_file.attributes(run), ClosedLoop(run).simulate()
        known = {name: said.pop(name) for name in [*said] if name in Telemetry.__dataclass_fields__}
        more = {"path": Path(f"{run.name}.h5"), "time": run.time, "channels": channels, "units": {}}
        result.append(Telemetry(**known, **more, attributes=said))
    return result


def simulated(flown, **more):
    return [replace(t, attributes={**t.attributes, **SIMULATED, **more}) for t in flown]


def test_telemetry_of_the_campaign_is_taken_whether_flown_or_simulated(plan, flown):
    check(plan, flown)
    check(plan, simulated(flown))
    assert loop_mismatch(plan, flown, LOOP) == ""
    assert loop_mismatch(plan, simulated(flown), LOOP) == ""


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"experiment": "onr"}, r'one\.h5: attribute experiment: "onr", .*sysid run, did you mean "one"\?'),
        ({"F_max_2": 2.1e-9}, r"one\.h5: attribute F_max_2: 2\.1e-09, expected 2\.2e-09, the authority"),
        ({"N_max_1": 0.0}, r"one\.h5: attribute N_max_1: 0, expected 1\.04e-11"),
    ],
)
def test_other_experiments_and_authorities_are_refused_with_file_and_place(plan, flown, change, sentence):
    noise, sysid = flown
    with pytest.raises(InputError, match=sentence):
        check(plan, [noise, replace(sysid, **change)])


def test_a_guidance_that_is_not_the_injected_one_is_refused(plan, flown):
    noise, sysid = flown
    louder = {**sysid.channels, "guidance_o_1": 1.3 * sysid.channels["guidance_o_1"]}
    with pytest.raises(InputError, match=r"one\.h5: channel guidance_o_1: differs from the injections of"):
        check(plan, [noise, replace(sysid, channels=louder)])


def test_a_campaign_may_leave_out_what_a_flown_guidance_records(plan, flown):
    noise, sysid = flown
    more = {**sysid.channels, "guidance_o_12": 1e-9 * np.sin(sysid.time)}
    check(plan, [noise, replace(sysid, channels=more)])
    with pytest.raises(InputError, match="channel guidance_o_12"):
        check(plan, simulated([noise, replace(sysid, channels=more)]))


def test_a_part_of_a_run_or_another_date_is_no_contradiction(plan, flown):
    noise, sysid = flown
    cut = {name: x[300:] for name, x in sysid.channels.items()}
    part = replace(sysid, t0="2016-03-01T00:02:10Z", time=sysid.time[:-300], channels=cut)
    check(plan, simulated([noise, part]))
    check(plan, simulated([noise, replace(sysid, t0="2018-03-01T00:00:00Z")]))
    gaps = {**sysid.channels, "guidance_o_1": sysid.channels["guidance_o_1"].copy()}
    gaps["guidance_o_1"][200:205] = np.nan
    check(plan, [noise, replace(sysid, channels=gaps)])


def test_another_loop_is_told_by_what_the_telemetry_says_of_itself(plan, flown):
    told = loop_mismatch(plan, simulated(flown, fmu_Plant="0", fmu_Mine="1"), LOOP)
    assert told == "with other FMUs in the place of Plant, Mine"
    slow = [replace(t, fs=1.0) for t in simulated(flown)]
    assert loop_mismatch(plan, slow, LOOP) == "samples at 1 Hz, where the campaign has 10 Hz"
    assert loop_mismatch(plan, [replace(t, fs=1.0) for t in flown], LOOP) == ""
