"""Campaign files that are wrong: one sentence with the place, never a wrong number."""

import math
import tomllib

import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lpfcosim.campaign import loading
from lpfcosim.errors import InputError
from tests.lpfcosim.campaign.conftest import TWO_EXPERIMENTS

BAD = [  # what to replace, by what, and what the sentence then begins with
    ("seed = 1", "seed = 1\nsede = 2", 'sede: unknown key, did you mean "seed"?'),
    ("campaign/2", "campaign/1", "is of the format before lpf-campaign/2: write schema = "),
    ('"1 mHz"', '"1 nm"', 'sequences.tone[0].frequency: "1 nm" has another unit, write a frequency'),
    ("cycles = 2,", "cycles = 4,", "experiments[0].injections: one into guidance_o_12 ends at 4060 s, past"),
    ("lambda_1 = 1.07", "b_3 = 1e-5", 'truth.b_3: unknown key of this spacecraft; spacecraft = "lpf" has it'),
]
OUT_OF_RANGE = [  # what to replace, by what, and the place of the refusal
    ("08:00:00Z", "08:00:00+02:00", "t0"),
    ('"1 mHz"', "0.001", "sequences.tone[0].frequency"),
    ('"1 mHz"', '"5 Hz"', "sequences.tone[0].frequency"),
    ('"10 nm"', '"10 mm"', "sequences.tone[0].amplitude"),
    ("epoch = 3", "epoch = 5", "second: alignment_epoch"),
    ('"7200 s"', '"7200.05 s"', "experiments[1].duration"),
    ('"35 fm Hz', '"-35 fm Hz', "noise.oms"),
    ("lambda_1 = 1.07", "lambda_1 = 2.0", "truth.lambda_1: 2, expected 0.7 to 1.5"),
    ("lambda_1 = 1.07", 'C_1 = "0.04 s"', "truth.C_1"),
    ("lambda_1 = 1.07", 'omega2_1_0 = "4e-7 s^-2"', "truth.omega2_1_0"),
    ("[noise]", "[events]\ngaps_per_day = 20.0\n[noise]", "events.gaps_per_day"),
    ("[noise]", '[sweep]\nF_max_2 = ["50 pN"]\n[noise]', "sweep"),
    ('["tone"]', '["tome"]', "experiments[0].sequences"),
    ('"second"', '"first"', "experiments[1].name"),
    ("seed = 1", 'extends = "c.toml"', "extends"),
]


@pytest.mark.parametrize(("old", "new", "sentence"), [*BAD, *OUT_OF_RANGE])
def test_bad_input_is_one_sentence_with_its_place(file, refusal, old, new, sentence):
    assert old in TWO_EXPERIMENTS
    file.write_text(TWO_EXPERIMENTS.replace(old, new, 1), encoding="utf-8")
    assert refusal(file).startswith(sentence)


VALUES = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=12), st.just([]), st.just({}), st.just([1]),
    st.builds("{} {}".format, st.floats(), st.sampled_from(("Hz", "nm", "s", "pN", "N m", "m s^-2", "kg"))),
)  # fmt: skip


def _places(table, path=()):
    """Return the paths of all values of a document."""
    items = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    return [path, *(p for key, value in items for p in _places(value, (*path, key)))]


@st.composite
def _replaced(draw):
    """Draw the file with another value somewhere."""
    document = table = tomllib.loads(TWO_EXPERIMENTS)
    *parents, last = draw(st.sampled_from([path for path in _places(document) if path]))
    for key in parents:
        table = table[key]
    table[last] = draw(VALUES)
    return tomlkit.dumps(document)


@st.composite
def _cut(draw):
    """Draw the file without a part of it."""
    begin = draw(st.integers(0, len(TWO_EXPERIMENTS)))
    return TWO_EXPERIMENTS[:begin] + TWO_EXPERIMENTS[begin + draw(st.integers(1, 80)) :]


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.data())
def test_a_value_that_is_another_is_refused_or_arrives_finite_in_the_runs(file, data):
    """Whatever one value of a file becomes, there is one sentence, or a campaign without nonsense."""
    file.write_text(data.draw(st.one_of(_replaced(), _cut())), encoding="utf-8")
    try:
        campaign = loading.load(file)
    except InputError as error:
        assert str(error).startswith(f"{file}: ") and "\n" not in str(error)
        return
    for run in campaign.runs:
        numbers = [*run.truth.values(), *run.noise.values(), run.dc, *(i.end for i in run.injections)]
        numbers += [x for values in campaign.model.parameters(run).values() for x in values.values()]
        assert all(map(math.isfinite, numbers))
        assert all(level >= 0 for level in run.noise.values())
        assert all(injection.end <= run.n_samples / run.fs + 1e-6 for injection in run.injections)
