"""Two experiments of the quick start, what a fit will know of them, and what is sought."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

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


@pytest.fixture(scope="session")
def fit_model(pair):
    from fit.settings import settings
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
    from lpfcosim.experiment_design.design_problem import design_problem

    return design_problem(replace(pair, design=replace(pair.design, held="rms", sines=4)), fit_model)


@pytest.fixture(scope="session")
def optimum(problem):
    from lpfcosim.experiment_design import convex_bound

    return convex_bound.optimize_power(problem.experiments, problem.prior_information, problem.objective, ())


@pytest.fixture(scope="session")
def designed(problem, fit_model):
    from lpfcosim.experiment_design import SearchProgress
    from lpfcosim.experiment_design.search import search

    said = SimpleNamespace(bounds=[], values=[], shares=[])
    told = SearchProgress(
        lambda value, bound: said.bounds.append((value, bound)),
        lambda _, value: said.values.append(value),
        said.shares.append,
    )
    return search(problem, fit_model, told), said
