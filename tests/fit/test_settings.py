"""The settings of a fit: what a table says, and what it must not say."""

import pytest

from fit.errors import InputError
from fit.settings import read, settings


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"estimator": "best"}, 'estimator: "best"'),
        ({"shared": {"lambda_3": "campaign"}}, "shared.lambda_3: unknown key"),
        ({"shared": "all"}, "expected a table"),
        ({"scatter": ["omega2_1_0"]}, "scatter[0]"),
        (
            {"scatter": ["lambda_2"], "shared": {"lambda_2": "experiment"}},
            "a value for each experiment already",
        ),
        ({"f_max": 0.001}, "f_max"),
        ({"f_max": 0.05, "estimator": "flscov"}, "f_max: 0.05 with estimator"),
    ],
)
def test_invalid_settings_are_refused(table, message):
    with pytest.raises(InputError) as error:
        settings(table, "c.toml: fit")
    assert str(error.value).startswith("c.toml: fit")
    assert message in str(error.value)


def test_a_fit_of_the_equation_leaves_out_parameters_of_fmus():
    table = {"C_2": {"min": 0.0}, "Controller": {"f_p": {"vary": False}}, "C_1": {"expr": "9 * Plant.tau"}}
    chosen = settings({"parameters": table})
    assert set(chosen.parameters) == {"C_2", "Controller.f_p", "C_1"}
    assert set(chosen.without_fmu_parameters().parameters) == {"C_2"}


def test_settings_are_read_from_a_file(tmp_path):
    path = tmp_path / "fit.toml"
    path.write_text('[fit]\nestimator = "student_t"\n', encoding="utf-8")
    assert read(path).estimator == "student_t"
    for text, message in (("x = 1\n", "no table"), ("[fit\n", "line 1"), ("[fit]\nx = 1\n", "fit.x")):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"fit\.toml") as error:
            read(path)
        assert message in str(error.value)
    with pytest.raises(InputError, match="no such file"):
        read(tmp_path / "nothing.toml")
