"""Campaign files: the sentence for everything that can be wrong with them."""

import pytest

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from tests.lpfcosim.campaign.conftest import TWO_EXPERIMENTS

TONE = 'frequency = "1 mHz"'
BAD = [  # what to replace, by what, and what the sentence then begins with
    ("seed = 1", "seed = 1\nsede = 2", 'sede: unknown key, did you mean "seed"? (known: actuation,'),
    (TONE + ", ", "", 'sequences.tone[0].frequency: missing, write frequency = "0.833 mHz"'),
    ("[[experiments]]", "[[experiment]]", 'experiment: unknown key, did you mean "experiments"?'),
    ("seed = 1", "seed = 1.5", "seed: 1.5 is not a whole number"),
    ("08:00:00Z", "08:00:00+02:00", 't0: "2016-04-16T08:00:00+02:00" is not a time in UTC'),
    ('"test"', '"a/b"', 'name: "a/b" cannot name a file'),
    ('"first"', '"nul"', 'experiments[0].name: "nul" cannot name a file on every system'),
    (TONE, "frequency = 0.001", "sequences.tone[0].frequency: 0.001 has no unit, write a string with"),
    (TONE, 'frequency = "0.1"', 'sequences.tone[0].frequency: "0.1" is not a number and a unit'),
    (TONE, 'frequency = "1 mHerz"', 'sequences.tone[0].frequency: "1 mHerz" has no known unit, write'),
    (TONE, 'frequency = "1 nm"', 'sequences.tone[0].frequency: "1 nm" is not a frequency, write'),
    (TONE, 'frequency = "1e999 Hz"', 'sequences.tone[0].frequency: "1e999 Hz" is not a finite number'),
    (TONE, 'frequency = "-1 mHz"', 'sequences.tone[0].frequency: "-1 mHz" must be above zero'),
    (TONE, 'frequency = "5 Hz"', "sequences.tone[0].frequency: 5 Hz is not below the Nyquist"),
    ("cycles = 2", "cycles = 2.5", "sequences.tone[0].cycles: 2.5 is not a whole number"),
    ('"10 nm"', '"10 nN"', 'sequences.tone[0].amplitude: "10 nN" is not a length'),
    ('"10 nm"', '"10 mm"', 'sequences.tone[0].amplitude: "10 mm" is beyond the reach'),
    ('"guidance_o_12"', '"guidance_012"', 'sequences.tone[0].into: "guidance_012" is not known, did you'),
    ('shape = "sine", ', "", 'sequences.tone[0].shape: missing, write shape = "sine" or'),
    ('into = "F_x_1"', 'into = "g_1"', 'experiments[1].injections[0].into: "g_1" is not known'),
    ('end = "20 s"', 'end = "5 s"', "experiments[1].injections[0].end: 5 s is not after the start"),
    ("cycles = 2,", "cycles = 4,", 'sequences.tone[0]: ends at 4060 s, past the end of experiment "first"'),
    ("[truth]", '[actuation]\nelectrode = "2e-6 Hz"\n[truth]', 'actuation.electrode: "2e-6 Hz" is not a rel'),
    ('"2200 pN"', '"80 nN"', "authority.A: F_max_1 and N_max_1 together ask 4.047e+04 pN of an elec"),
    ('["tone"]', '["tome"]', 'experiments[0].sequences[0]: no sequence "tome", did you mean "tone"?'),
    ('"second"', '"first"', 'experiments[1].name: there would be two runs named "first"'),
    ("epoch = 3", "epoch = 5", "experiments[1].alignment_epoch: there is no truth.delta_ifo_5"),
    ('authority = "A"\n', "", 'experiments[0].authority: missing, write authority = "A"'),
    ('"7200 s"', '"1 ns"', "experiments[1].duration: 1e-09 s is less than a sample"),
    ("lambda_1 = 1.07", 'C_1 = "9 s"\nlambda_1 = 0.8', "truth.C_1: C_1/lambda_1 = 11.25 s is above 10 s"),
    ('"7200 s"', '"7200.05 s"', "experiments[1].duration: 7200.05 s is not a whole number of"),
    ('F_max_1 = "2200 pN"', 'F_max_1 = "-1 pN"', 'authority.A.F_max_1: "-1 pN" must be zero or'),
    ('"35 fm Hz', '"-35 fm Hz', 'noise.oms: "-35 fm Hz^-0.5" must be zero or above'),
    ("lambda_1 = 1.07", "lambda_1 = 0.0", "truth.lambda_1: 0.0 is too small, expected more than 0.7"),
    ("lambda_1 = 1.07", "lambda_1 = nan", "truth.lambda_1: NaN is not a finite number"),
    ("lambda_1 = 1.07", 'C_1 = "0.04 s"', "truth.C_1: C_1/lambda_1 = 0.03722 s is below 0.05 s"),
    ("lambda_1 = 1.07", 'omega2_1_0 = "4e-7 s^-2"', 'truth.omega2_1_0: "4e-7 s^-2" must be zero or below;'),
    ('unity_gain = "90 mHz"', 'poles = ["1 Hz", "1 Hz"]', "control.drag_free.poles: the two poles must"),
    ('"0.6 pN"', '"2.3 nN"', "experiments[1].injections[1].amplitude: the force on test mass 1 reaches"),
    ('"-8e-12 m s^-2"', '"2e-9 m s^-2"', "experiments[1].dc: compensating it takes 3578 pN of the 2200 pN"),
    ("seed = 1", 'seed = 1\n"a\\nb" = 2', '"a\\nb": unknown key'),
    ("seed = 1", "seed = " + "1" * 5000, "holds a number of too many digits"),
    ("seed = 1", "seed" + ".a" * 20_000 + " = 1", "is nested too deeply"),
    ("lambda_1 = 1.07", 'omega2_1_0 = "-1e30 s^-2"', 'truth.omega2_1_0: "-1e30 s^-2" is above 1 s^-2, which'),
    ("lambda_1 = 1.07", "delta_ifo_5 = 1e300", "truth.delta_ifo_5: 1e+300 is too large, expected 1 or less"),
    ('F_max_1 = "2200 pN"', 'F_max_1 = "1e300 N"', 'authority.A.F_max_1: "1e300 N" is above 1 N, which'),
    ('"35 fm Hz', '"1e300 m Hz', 'noise.oms: "1e300 m Hz^-0.5" is above 1e-06 m Hz^-0.5, which'),
    ('"90 mHz"', '"1e300 Hz"', 'control.drag_free.unity_gain: "1e300 Hz" is above 1000 Hz, which'),
    ('"90 mHz"', '"5 Hz"', "control.drag_free.unity_gain: 5 Hz is not below the Nyquist"),
    ('"90 deg"', '"1e300 deg"', 'experiments[1].injections[1].phase: "1e300 deg" is above'),
    ("seed = 1", "seed = 1\nseed = 2", "Cannot overwrite a value (at line 5, column 9)"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "sentence"), BAD)
def test_bad_input_is_one_sentence_with_its_place(file, refusal, old, new, sentence):
    assert old in TWO_EXPERIMENTS
    file.write_text(TWO_EXPERIMENTS.replace(old, new, 1), encoding="utf-8")
    assert refusal(file).startswith(sentence)


def test_what_is_no_file_at_all(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "open.toml").write_text("x = [", encoding="utf-8")
    (tmp_path / "commas.toml").write_text("x = [1 2]", encoding="utf-8")
    (tmp_path / "deep.toml").write_text("x = " + "[" * 100_000, encoding="utf-8")
    for name, words in {
        "absent.toml": "no such file",
        "open.toml": r"Invalid value \(at end of document\)",
        "commas.toml": "Unclosed array",
        ".": "is a folder",
        "binary.toml": "is not UTF-8",
        "deep.toml": "is nested too deeply",
    }.items():
        with pytest.raises(InputError, match=words):
            loading.load(tmp_path / name)
