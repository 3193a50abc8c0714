"""The machinery that counts false alarms; how many there are is for docs/validation.md to tell."""

from dataclasses import replace

import pytest

from fit.pipeline import calibrate
from lpfcosim.campaign import loading
from tests.benchmarks import alarms


@pytest.mark.slow
def test_clean_campaigns_give_no_alarm_and_a_wrong_gain_does(quickstart):
    plan = loading.load(quickstart)
    assert alarms.trial(plan, 0, step=False) == {"number": 0, "alarms": []}
    runs = [alarms.drawn(run, 0) for run in plan.runs]
    assert runs[0].channels.keys() > {"o_12", "f_x_2", "guidance_o_12"}
    B = next(run for run in runs if run.run == "B")
    scaled = replace(B, channels=B.channels | {"f_x_2": 1.01 * B.channels["f_x_2"]})
    said = list(alarms.alarms(calibrate([scaled if run is B else run for run in runs])))
    codes = {(fit, code) for fit, code, _ in said}
    assert codes == {("joint", "rejected"), ("experiments B", "contradiction")}
