"""Two experiments of the quick start, what a fit will know of them, and what is sought."""

from dataclasses import replace

import pytest

from fit.settings import settings
from lpfcosim.campaign import loading
from tests import ROOT

pytest.importorskip("cvxpy")

PAIR = """
[defaults]
duration = "6 h"
noise_duration = "6 h"
sequences = ["standard"]
[[experiments]]
name = "A"
authority = "A"
dc = "8e-12 m s^-2"
[[experiments]]
name = "D"
authority = "D"
alignment_epoch = 2
noise = { plateau = "3.0 fm s^-2 Hz^-0.5", tail = 1.2 }
"""


def with_keys(campaign, **keys):
    """Return a campaign with other keys of the table [design]."""
    return replace(campaign, design=campaign.design.model_copy(update=keys))


@pytest.fixture(scope="session")
def fit_model(pair):
    from lpfcosim.experiment_design import FitModel

    return FitModel(pair, settings())


@pytest.fixture(scope="session")
def pair(tmp_path_factory):
    """Experiments A and D of the quick start, the latter by defaults."""
    path = tmp_path_factory.mktemp("pair") / "pair.toml"
    base = (ROOT / "campaigns" / "quickstart.toml").as_posix()
    path.write_text(f'extends = "{base}"\n{PAIR}', encoding="utf-8")
    return loading.load(path)


@pytest.fixture(scope="session")
def problem(pair, fit_model):
    """What is sought at equal rms."""
    from lpfcosim.experiment_design import design_problem

    return design_problem(with_keys(pair, held="rms", sines=4), fit_model)


@pytest.fixture(scope="session")
def optimum(problem):
    from lpfcosim.experiment_design import convex_bound

    return convex_bound.optimize_power(problem)


@pytest.fixture(scope="session")
def designed(problem, fit_model):
    from lpfcosim.experiment_design import search

    return search(problem, fit_model, lambda value, bound: None, lambda step, value: None)
