import base64
import hashlib
import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from fit.figures import stiffness
from fit.figures.colours import COLOURS
from fit.findings import Finding
from fit.forecasting.coverage import with_truth
from fit.parameters import FLIGHT, joint_names
from fit.report.page import figure_specs, write_report
from fit.report.parameter_table import parameter_table
from fit.report.stiffness import stiffness_points
from fit.report.verdict import verdict
from fit.results import Fit, Results
from fit.results.estimates import Estimate
from fit.results.provenance import Provenance
from fit.tables import prose
from fit.telemetry.reader import read
from tests.oracles.contract_file import write_contract_file

SAMPLES = 3600
DOI = "https://doi.org/10.1103/PhysRevD.97.122002"
ORDER = (
    "Parameters, fitted jointly",
    "Each experiment fitted on its own",
    "Experiment A1",
    "λ₂ of 2 experiments",
    "Stiffness of test mass 2, ±1 σ",
    "Warnings, and what to do",
    "Runs, with force authority",
)
EVIL = "<script>alert('x')</script>\"><img src=x onerror=alert(1)> & $\\frac{"
TRUTH = {name: p.value for name, p in FLIGHT.items()}
UNDETERMINED = Finding(
    "indeterminable", "nothing drives test mass 1", parameters=("lambda_1",), combination={"lambda_1": 1.0}
)


def make_fit(values, warnings=(), converged=True):
    """Estimates at `values`, each with its flight sigma or 1 % of itself."""
    sigma = {n: FLIGHT[n].sigma if n in FLIGHT else abs(0.01 * v) for n, v in values.items()}
    return Fit(
        parameters={
            n: Estimate(v, sigma[n], FLIGHT[n].unit if n in FLIGHT else "s-2") for n, v in values.items()
        },
        covariance_matrix=np.diag([s**2 for s in sigma.values()]),
        chi2=710.0,
        dof=700,
        converged=converged,
        warnings=tuple(warnings),
    )


def joint_fit(pulls=(), **options):
    """The twelve joint parameters at their flight values but for `pulls` sigma."""
    names = [n for n in joint_names([1, 2]) if n != "lambda_1"]
    values = {n: FLIGHT[n].value + dict(pulls).get(n, 0.0) * FLIGHT[n].sigma for n in names}
    return make_fit(values, **{"warnings": [UNDETERMINED], **options})


def experiment_fit():
    return make_fit(
        {"lambda_2": 1.0776, "C_2": 0.186, "omega2_2": -1.4e-6, "domega2_12": -7e-7, "delta_ifo": -2.2e-5}
    )


def results(**sections):
    empty = {"joint": None, "experiments": {}, "cross_talk": {}, "inertial": {}, "provenance": Provenance()}
    return Results(**{**empty, **sections})


@pytest.fixture
def campaign(tmp_path):
    """Make a run and, unless told otherwise, its noise run; return them as read."""

    def make(experiment="A1", noise=True, guidance=True, truth=TRUTH, **attributes):
        rng = np.random.default_rng(7)
        t = np.arange(SAMPLES)
        channels = {
            "o_1": (1e-9 * rng.standard_normal(SAMPLES), "m"),
            "o_12": (1e-8 * np.sin(0.02 * t) + 1e-12 * rng.standard_normal(SAMPLES), "m"),
            "f_x_2": (-4e-12 * np.sin(0.02 * t), "m s-2"),
            "f_x_1": (np.zeros(SAMPLES), "m s-2"),
        }
        if guidance:
            channels |= {f"guidance_o_{i}": (1e-8 * np.sin(0.02 * t), "m") for i in (1, 12)}
        runs = []
        for kind in ("sysid", "noise") if noise else ("sysid",):
            stem = f"{len(list(tmp_path.glob('*.h5')))}-{kind}.h5"
            path = write_contract_file(
                tmp_path / stem,
                samples=SAMPLES,
                channels=channels,
                truth=truth,
                **{
                    "fs": 1.0,
                    "kind": kind,
                    "run": f"{experiment}-{kind}",
                    "experiment": experiment,
                    **attributes,
                },
            )
            runs.append(read(path))
        return runs

    return make


class Page(HTMLParser):
    """What a test asks of a page: text, ids, tags, and that every element is closed in order."""

    VOID = frozenset({"meta", "br", "path", "use", "rect"})

    def __init__(self, text):
        super().__init__()
        self.source, self.text, self.ids, self.tags, self.open = text, "", [], [], []
        self.links, self.attributes = [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]
        self.ids += [value for name, value in attrs if name == "id"]
        self.links += [value for name, value in attrs if name in ("href", "xlink:href", "src")]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in ("style", "title"):
            self.text += data


def written(folder, results, telemetries):
    path = write_report(folder, with_truth(results, telemetries), telemetries)
    assert path == folder / "report.html"
    page = Page(path.read_text(encoding="utf-8"))
    page.results = results
    return page


def test_the_whole_report(tmp_path, campaign):
    runs = campaign() + campaign("B2", F_max_2=1100e-12, alignment_epoch=2)
    page = written(
        tmp_path,
        results(
            joint=joint_fit({"C_2": 1.7}),
            experiments={"A1": experiment_fit(), "B2": experiment_fit()},
            provenance=Provenance(
                extra={"campaign": "quickstart", "fit_version": "0.1.0", "files": ["a", "b"]}
            ),
        ),
        runs,
    )
    assert "quickstart" in page.text
    assert "All 11 joint parameters lie within 4 σ of the true values; largest |pull| 1.7 (C2)" in page.text
    assert "Not determined by these data: λ1." in page.text
    assert "Nothing drives test mass 1. (joint fit)" in page.text
    assert "To do: Add a run that injects" in page.text
    assert "Experiments: 2, noise runs: 2; 4 h at 1 Hz, 2016-04-16" in page.text
    assert "0 and 1100 pN" in page.text
    assert "fit_version" in page.text
    assert page.tags.count("figure") == 12
    stems = [
        "residual-over-noise",
        "gain",
        "stiffness-1",
        "stiffness-2",
    ]
    for experiment in ("1{}-A1", "2{}-B2"):
        for letter, name in {"r": "responses", "s": "spectra", "b": "breakdown", "t": "residual"}.items():
            stems.append(f"e{experiment.format(letter)}-{name}")
    assert {d.name for d in figure_specs(page.results, runs)} == set(stems)
    assert all(f"<code>{stem}</code></figcaption>" in page.source for stem in stems)
    headings = [page.text.index(text) for text in ORDER]
    assert headings == sorted(headings)


def test_the_page_needs_nothing_but_itself(tmp_path, campaign):
    page = written(tmp_path, results(joint=joint_fit(), experiments={"A1": experiment_fit()}), campaign())
    anchors = {link[1:] for link in page.links if link.startswith("#")}
    files = {link for link in page.links if not link.startswith("#")}
    assert anchors <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))
    assert files == {"results.json", DOI}  # offered, but not needed
    assert not {"link", "iframe", "img", "object"} & set(page.tags)
    markup = (
        re.sub(r"<script[^>]*>.*?</script>", "", page.source, flags=re.DOTALL)
        .replace("http-equiv", "")
        .replace(DOI, "")
    )
    for remote in ("http", "@import", "url(h", "//"):
        assert remote not in markup
    scripts = re.findall(r"<script>(.*?)</script>", page.source, flags=re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    (policy,) = [value for _, name, value in page.attributes if name == "content" and "-src" in value]
    assert "default-src 'none'" in policy
    assert re.findall(r"'sha256-([^']*)'", policy) == digests
    described = [value for tag, name, value in page.attributes if tag == "div" and name == "aria-label"]
    assert len(described) == page.source.count('<script type="application/json">') > 0
    assert page.tags.count("figcaption") == page.tags.count("figure")
    for colour in COLOURS.values():
        assert page.source.count(colour) == 1  # its definition; the figures follow the scheme


def test_every_foreign_text_is_escaped(tmp_path, campaign):
    runs = campaign(EVIL, truth=None, version=EVIL, campaign=EVIL)
    warning = Finding(EVIL, EVIL, parameters=(EVIL,), combination={EVIL: 1.0, "C_2": -0.2})
    fit = replace(experiment_fit(), warnings=(warning, replace(warning, code="indeterminable")))
    fit.parameters[EVIL] = Estimate(1.0, 0.1, EVIL)
    foreign_fit = replace(make_fit({"lambda_2": 1.0, "C_2": 0.2}), warnings=fit.warnings)
    foreign_fit.parameters[EVIL] = foreign_fit.parameters.pop("C_2")
    page = written(
        tmp_path,
        results(
            joint=foreign_fit,
            experiments={EVIL: fit},
            provenance=Provenance(extra={EVIL: {EVIL: [EVIL]}}),
        ),
        runs,
    )
    documents = [tag for tag, name, value in page.attributes if (name, value) == ("type", "application/json")]
    assert page.tags.count("script") == page.source.count("sha256-") + len(documents)
    assert "img" not in page.tags
    assert not [name for _, name, _ in page.attributes if name.startswith("on")]
    assert EVIL.partition(" & ")[0] in page.text
    assert all(re.fullmatch(r"[\w.-]+", d.name) for d in figure_specs(page.results, runs))


def test_a_truth_that_differs_between_runs_has_no_pull(tmp_path, campaign):
    runs = campaign(truth={**TRUTH, "lambda_2": 1.07}) + campaign("B2", truth={**TRUTH, "lambda_2": 1.08})
    page = written(tmp_path, results(joint=joint_fit()), runs)
    assert "All 10 joint parameters with a true value lie within 4 σ of the true values" in page.text


def test_rows_share_an_exponent_and_show_two_digits_of_sigma():
    fit = make_fit({"omega2_2_0": -4.174e-7, "alpha_phi_2": -25.9e3, "lambda_2": 1.0775948})
    fit.parameters["omega2_2_0"] = Estimate(-4.1744e-7, 3.75e-9, "s-2", truth=-4.19e-7, pull=0.42)
    fit.parameters["lambda_2"] = Estimate(1.0775948, 3.24e-5, "1")
    omega2, alpha, gain = parameter_table(fit, [FLIGHT[n] for n in fit.parameters]).rows
    assert (omega2.unit, omega2.truth) == ("10⁻⁷ s⁻²", "−4.190")
    assert (omega2.estimate, omega2.sigma, omega2.flight) == ("−4.174(37)", "0.037", "−4.19(4)")
    assert (alpha.unit, alpha.flight) == ("10³ kg⁻¹ m⁻²", "−27.4(8)")
    assert alpha.estimate.startswith("−25.9")
    assert (gain.unit, gain.estimate, gain.flight) == ("", "1.077595(32)", "1.0776(1)")


def test_value_and_sigma_of_an_estimate_near_zero_share_an_exponent():
    fit = make_fit({"opening": 1.0})
    fit.parameters["opening"] = Estimate(-4e-7, 7.1e-4, "rad", truth=0.0, pull=0.0)
    (row,) = parameter_table(fit).rows
    assert (row.estimate, row.sigma, row.unit) == ("−0.0(7.1)", "7.1", "10⁻⁴ rad")


def test_messages_have_symbols_of_parameters_and_channels():
    text = prose("opening and F_x_1 at F_max_1 bias lambda_2 in test_1", ["opening"])
    assert text.replace("<sub></sub>", "").startswith(
        "ε and F<sub>x,1</sub> at F<sub>max,1</sub> bias λ<sub>2</sub> in test_1"
    )


def test_the_reconstructed_stiffness_carries_the_covariance():
    joint = make_fit({"alpha_phi_2": -27.4e3, "C_2": 0.186, "omega2_2_0": -4.19e-7, "alpha_x_2": -317.0})
    joint.covariance_matrix[0, 2] = joint.covariance_matrix[2, 0] = -0.5 * 800 * 4e-9
    value, sigma = stiffness.reconstruction(joint, 2, 2200e-12, 10.4e-12)
    assert value == pytest.approx(-1.40136e-6, rel=1e-12, abs=0)
    background, force, torque = 4e-9, 6 * 2200e-12, 800 * 10.4e-12
    assert sigma == pytest.approx(
        math.sqrt(background**2 + force**2 + torque**2 - background * torque), rel=1e-6, abs=0
    )
    assert stiffness.reconstruction(make_fit({"C_2": 0.186}), 2, 0.0, 0.0) is None
    assert stiffness.reconstruction(None, 2, 0.0, 0.0) is None


def test_the_stiffness_of_test_mass_1_is_the_difference(campaign):
    runs = campaign()
    point = stiffness_points(results(experiments={"A1": experiment_fit()}), runs, 1)["A1"]
    assert (point.F_max, point.N_max) == (runs[0].F_max_1, runs[0].N_max_1)
    assert point.omega2.value == pytest.approx(-7e-7)
    assert point.omega2.sigma == pytest.approx(math.hypot(1.4e-8, 7e-9))  # 1 % of both, no correlation


def test_an_identification_that_the_data_contradict_spoils_the_verdict():
    fit = Fit({"C_2": Estimate(0.2, 0.1, "s")}, np.array([[0.01]]), 1.0, 1, True, ())
    results = Results(fit, {}, {}, {}, Provenance())
    contradicted = replace(fit, warnings=(Finding("constraint_contradicted", "why", parameters=("C_2",)),))
    assert verdict(results, [], results).state == "open"
    spoilt = verdict(results, [], replace(results, joint=contradicted))
    assert spoilt.state == "bad" and "identification" in spoilt.text
