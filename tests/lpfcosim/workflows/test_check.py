"""What cannot be simulated as it is meant is refused by every workflow alike, and nothing is simulated."""

from dataclasses import replace

import pytest

import lpfcosim
from lpfcosim.campaign import loading
from lpfcosim.errors import InputError, UnavailableError
from lpfcosim.execution import validation
from lpfcosim.modelica import build
from tests import campaign_text, third_party


@pytest.fixture
def foreign(quickstart, tmp_path, monkeypatch):
    """Write the quick start with a third-party controller; no FMU of ours is needed to refuse it."""
    monkeypatch.setattr(build, "build", None)
    third_party.built(tmp_path)

    def write(text=""):
        path = tmp_path / "mine.toml"
        path.write_text(f'extends = "{quickstart.as_posix()}"\n{third_party.TABLE}{text}\n')
        return path

    return write


def test_what_rests_on_our_loop_is_not_available_with_another_one(foreign):
    path = foreign()
    checked = lpfcosim.check(path)
    assert checked.valid
    assert (checked.margins, checked.forecast, checked.peaks) == (None, None, {})
    reason = f"the dynamics of {path.with_name('ThirdParty.fmu')} are not known beforehand"
    assert reason in checked.unavailable
    assert "expected --trust" in checked.warnings[-1]
    for workflow in (lpfcosim.design, lpfcosim.montecarlo, lpfcosim.forecast, lpfcosim.margins):
        with pytest.raises(UnavailableError, match=reason):
            workflow(path)


def test_every_workflow_that_simulates_refuses_alike_and_writes_nothing(foreign, tmp_path):
    path = foreign("values = { gain = 2.0 }")
    before, out = sorted(tmp_path.rglob("*")), tmp_path / "out"
    sentences = set()
    for refused in (
        lambda: lpfcosim.run(path, out, trusted=True),
        lambda: lpfcosim.montecarlo(path, 2, out, fmus=True, trusted=True),
        lambda: lpfcosim.identify(path, out=out, trusted=True),
        lambda: lpfcosim.simulate(path, out, trusted=True),
        lambda: lpfcosim.check(path),
    ):
        with pytest.raises(InputError, match=r'fmus.SuspensionControl.*values names "gain"') as error:
            refused()
        sentences.add(str(error.value))
    assert len(sentences) == 1
    assert sorted(tmp_path.rglob("*")) == before


# Commands at their limits -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("amplitude", "cycles", "step", "sentence"),
    [
        ("1 um", 13, "", "f_x_2 reaches 3.25e-10 N at 1126 s.* is 5e-11 N, beyond .* for 66 % of the run"),
        ("10 nm", 2, "90 um", "o_12 reaches .* the range of the interferometers"),
    ],
)
def test_what_leaves_its_limits_for_long_is_refused(tmp_path, amplitude, cycles, step, sentence):
    sine = ("guidance_o_12", "5 mHz", amplitude, cycles, "900 s")
    text = campaign_text.campaign('duration = "1 h"', sine).replace("2200 pN", "50 pN")
    if step:
        keys = 'into = "guidance_o_12"\nshape = "half_cosine"\nstart = "1000 s"\nend = "1001 s"'
        text += f'[[experiments.injections]]\n{keys}\namplitude = "{step}"\n'
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(InputError, match=sentence):
        lpfcosim.check(tmp_path / "mine.toml")


@pytest.mark.parametrize("name", ["quickstart", "mission-x", "spacecraft", "operations", "sweep", "designed"])
def test_shipped_campaigns_are_valid(quickstart, name):
    valid = validation.validate(loading.load(quickstart.with_name(f"{name}.toml")))
    assert (valid.doubts, valid.interfaces) == ((), ())


# Runs that a fit takes nothing from -------------------------------------------------------------------------


def test_injections_that_a_fit_takes_nothing_from_are_doubtful(quickstart, tmp_path):
    text = quickstart.read_text(encoding="utf-8")
    fast = text.replace("0.833 mHz", "0.833 Hz")
    late = fast.replace('0.7 nm", cycles = 32, start = "20941 s"', '0.7 nm", cycles = 16, start = "21280 s"')
    assert text != fast != late
    (tmp_path / "mine.toml").write_text(late, encoding="utf-8")
    checked = lpfcosim.check(tmp_path / "mine.toml")
    assert not checked.valid
    expected = {
        "runs A, B, C, D: the sine of 833 mHz into guidance_o_12 from 900 s is above the fitted band, which "
        "ends at 100 mHz: no estimate takes anything from it",
        "runs A, B, C, D: the sine of 53.3 mHz into guidance_o_1 from 21280 s is at an end of the run, where "
        "the window of the fit fades: 0.9 % of its power counts",
    }
    assert expected <= {*checked.warnings}


def test_short_runs_may_be_simulated_but_not_fitted(quickstart):
    plan = loading.load(quickstart)
    short = replace(plan.experiments[0], duration=600.0, noise_duration=600.0, injections=())
    short = replace(plan, experiments=(short,))
    assert validation.validate(short, fitted=False).doubts == ()
    with pytest.raises(InputError, match="runs A-noise, A: lasts 600 s, expected 1800 s or more"):
        validation.validate(short)


def test_constraints_of_fit_and_identification_are_stated(quickstart, tmp_path):
    parameters = (
        "[fit.parameters]\nC_2 = { vary = false }\nlambda_2 = { prior = [1.0776, 1e-5] }\n"
        "SuspensionControl.f_p = { vary = false, value = 5.5e-3 }\n"
    )
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{quickstart.as_posix()}"\n{parameters}', encoding="utf-8")
    stated = ["C_2 fixed", "lambda_2 prior 1.0776 ± 1e-05", "SuspensionControl.f_p fixed at 0.0055"]
    checked = lpfcosim.check(path)
    assert [*checked.constraints] == stated
    assert [*checked.forecast.constraints] == stated[:2]
    assert checked.forecast["C_2"].sigma == 0


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("[fit.parameters.lambda_q]\nvary = false", "lambda_q: no parameter of this fit"),
        ('[fit]\nexclude = ["Q"]', "exclude"),
    ],
)
def test_unknown_names_of_the_fit_are_refused_before_anything_is_simulated(
    quickstart, tmp_path, table, sentence
):
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "{quickstart.as_posix()}"\n{table}\n')
    for workflow in (lpfcosim.check, lambda path: lpfcosim.run(path, tmp_path / "out")):
        with pytest.raises(InputError, match=sentence):
            workflow(path)
    assert not (tmp_path / "out").exists()
