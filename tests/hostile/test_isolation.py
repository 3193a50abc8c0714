"""An FMU that crashes, hangs, ends the process or returns nonsense fails its own run and no other."""

import os
import re
from dataclasses import replace

import fmpy
import pytest

from lpfcosim.errors import InputError
from lpfcosim.execution import runner
from tests.hostile.faulty import FAULTS, SEGFAULT, after, by_value, faulty

pytestmark = [
    pytest.mark.fmu,
    pytest.mark.skipif(os.name != "posix", reason="faults are those of POSIX"),
    pytest.mark.slow,
]

LONG, SHORT = "one", "one-noise"
MODEL = "OpticalMetrology"
WHERE = rf"at 150\.0 s, in the {MODEL} FMU"
TOLD = {  # what is said of a run, and what its log holds
    "segfault": (rf"its process was ended by SIGSEGV {WHERE}", "Fatal Python error"),
    "abort": (rf"its process was ended by SIGABRT {WHERE}", "Fatal Python error"),
    "exit": (rf"its process ended with status 3 {WHERE}", "no licence"),
    "leave": (rf"its process ended with status 0 {WHERE}", ""),
    "killed": (rf"its process was ended by SIGKILL \(out of memory\?\) {WHERE}", ""),
    "hang": (rf"its process was ended at its time limit of 20 s {WHERE}", ""),
    "error": (rf"the {MODEL} FMU reports 'error' at 150\.0 s \(as asked\)", f"{MODEL}: as asked"),
    "nan": (r"diverges: o_1 is not finite at 150\.\d s", ""),
}


def folder_of(path):
    return sorted(p.name for p in path.iterdir())


def test_faults_in_the_midst_of_runs_among_sound_ones(fmus, plan, tmp_path):
    """One FMU does it all: which fault it has is told by its parameter delta_ifo."""
    description = fmpy.read_model_description(fmus[MODEL])
    (reference,) = (v.valueReference for v in description.modelVariables if v.name == "delta_ifo")
    kinds = [*FAULTS, "sound", "sounder"]
    step = after(150.0, by_value(reference, [*FAULTS.values(), ""]))
    mixed = replace(
        plan,
        truth=plan.truth | {f"delta_ifo_{k + 1}": k * 1e-9 for k in range(len(kinds))},
        experiments=tuple(
            replace(plan.experiments[0], name=kind, alignment_epoch=k + 1, noise_duration=0.0)
            for k, kind in enumerate(kinds)
        ),
    )
    bad = {**fmus, MODEL: faulty(fmus[MODEL], tmp_path / "bad.fmu", step=step)}
    out = tmp_path / "out"
    done = runner.simulate(mixed, out / "telemetry", bad, runner.RunOptions(jobs=2, time_limit=20.0))
    assert list(done.files) == ["sound", "sounder"], done.failures
    assert list(done.failures) == list(FAULTS) == list(TOLD)
    assert folder_of(out / "telemetry") == ["sound.h5", "sounder.h5"]
    assert folder_of(out / "logs") == sorted(f"{kind}.log" for kind in FAULTS)
    for kind, (sentence, logged) in TOLD.items():
        message = str(done.failures[kind])
        assert re.fullmatch(rf"run '{kind}':? {sentence}", message)
        log = (out / "logs" / f"{kind}.log").read_text()
        assert logged in log
        assert log.splitlines()[-1] == message


def test_a_fault_while_an_fmu_is_loaded(fmus, plan, tmp_path):
    bad = {**fmus, MODEL: faulty(fmus[MODEL], tmp_path / "bad.fmu", load=SEGFAULT)}
    done = runner.simulate(plan, tmp_path / "telemetry", bad, runner.RunOptions(jobs=2))
    assert not done.files
    for name, error in done.failures.items():
        ending = "was ended by SIGSEGV while the FMUs were loaded"
        assert str(error) == f"run '{name}': its process {ending}, in the {MODEL} FMU"


def test_what_failed_is_made_good_and_no_log_is_left(fmus, plan, tmp_path):
    sound = runner.simulate(plan, tmp_path / "sound" / "telemetry", fmus)
    out = tmp_path / "out" / "telemetry"
    bad = {**fmus, MODEL: faulty(fmus[MODEL], tmp_path / "bad.fmu", step=after(150.0, SEGFAULT))}
    assert list(runner.simulate(plan, out, bad).failures) == [LONG]
    refusal = rf"{SHORT}\.h5: simulated with another {MODEL} FMU; use another folder"
    with pytest.raises(InputError, match=refusal):
        runner.simulate(plan, out, fmus)
    done = runner.simulate(plan, out, fmus, runner.RunOptions(rerun=True))
    assert not done.failures
    assert not (tmp_path / "out" / "logs").exists()
    for name, path in done.files.items():
        assert path.read_bytes() == sound.files[name].read_bytes()
