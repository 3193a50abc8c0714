"""The chain as ArviZ has it."""

import importlib
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import fit
from fit.crosstalk import refit
from fit.sampling import emcee_sampling


def test_without_arviz_one_sentence_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(fit.InputError, match=r"inference_data needs ArviZ, of the extra lpfcosim\[mcmc\]"):
        fit.inference_data(tmp_path)


def test_walkers_are_chains(monkeypatch, tmp_path):
    theta = np.random.default_rng(1).normal(size=(5, 4, 3))  # draws, walkers, parameters
    outcome = SimpleNamespace(
        parameters=[SimpleNamespace(name=name) for name in ("lambda_2", "C_2", "b_1")],
        shared=3,
        undetermined=[False, True, False],
        exact=[False, False, True],
    )
    chain = SimpleNamespace(theta=theta)
    arviz = SimpleNamespace(from_dict=lambda groups: groups)
    monkeypatch.setitem(sys.modules, "arviz", arviz)
    monkeypatch.setattr(refit, "load", lambda folder: (SimpleNamespace(joint=None), []))
    monkeypatch.setattr(refit, "refit", lambda *_: outcome)
    module = importlib.import_module("fit.sampling.inference_data")
    monkeypatch.setattr(module, "Posterior", lambda _: None)
    monkeypatch.setattr(emcee_sampling, "digest", lambda _: "")
    monkeypatch.setattr(emcee_sampling, "read", lambda *_: chain)
    monkeypatch.setattr(emcee_sampling, "apply_iv_correction", lambda chain, outcome, _: (chain, outcome))
    monkeypatch.setattr(module.attenuation, "iv_parameters", lambda _: ())
    groups = module.inference_data(tmp_path)
    assert list(groups["posterior"]) == ["lambda_2"]
    np.testing.assert_array_equal(groups["posterior"]["lambda_2"], theta[:, :, 0].T)
