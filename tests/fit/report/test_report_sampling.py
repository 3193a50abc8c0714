"""The report's sections on a sampled posterior and on a Monte Carlo."""

import json
from dataclasses import replace

from fit.forecasting import coverage
from fit.report.page import write_report
from fit.report.sampling import sections
from fit.sampling import SCHEMA
from tests.fit.report.test_report import joint_fit, results


def chain(fit, **changes):
    """What `lpfcosim mcmc` leaves of a chain whose means lie 0.02 sigma off least squares."""
    document = {
        name: {
            "unit": e.unit,
            "estimate": e.value,
            "mean": e.value + 0.02 * e.sigma,
            "sigma": 1.03 * e.sigma,
            "tau": 61.4,
            "ess": 5000.4,
            "shift_in_sigma": 0.02,
            "shift_error": 0.01,
            "sigma_ratio": 1.03,
            "sigma_ratio_error": 0.01,
        }
        for name, e in fit.parameters.items()
    }
    document = {
        "schema": SCHEMA,
        "parameters": document,
        "steps": 9000,
        "burn_in": 900,
        "walkers": 40,
    }
    return document | {"acceptance": 0.314} | changes


def sections_of(folder, name, document):
    (folder / name).write_text(json.dumps(document))
    return sections(results(joint=joint_fit()), folder)


def test_a_chain(tmp_path):
    (part,) = sections_of(tmp_path, "mcmc.json", chain(joint_fit()))
    assert part.text == "9000 steps of 40 walkers, the first 900 left out; 31 % of the proposals accepted."
    (grid,) = part.tables
    assert len(grid.rows) == len(joint_fit().parameters)
    _, mean, shift, ratio, *of_chain = grid.rows[0]
    assert (mean, shift, ratio, of_chain) == ("1.07760(10)", "0.02(1)", "1.03(1)", ["61", "5000"])
    assert part.figures == ()


def test_a_monte_carlo(tmp_path):
    true = coverage.Pulls(200, 0.05, 0.07, 1.01, 0.05, 0.68, 0.033, 3e-5)
    pulls = {"lambda_2": true, "C_2": replace(true, pull_mean=0.5, coverage_1sigma=0.40)}
    coverage.write(pulls, 200, {7: "no"}, {"campaign": "<b>", "redraw": True}, tmp_path / "montecarlo.json")
    (part,) = sections(results(), tmp_path)
    assert part.text == "200 calibrations of <b> with new noise and new truths; 1 failed."
    good, bad = (row[1:] for row in part.tables[0].rows)
    assert good == ("200", "0.05(7)", "1.01(5)", "68.0(3.3)")
    assert bad[1] == '<span class="off">0.50(7)</span>'
    assert bad[2] == "1.01(5)"
    assert bad[3] == '<span class="off">40.0(3.3)</span>'
    page = write_report(tmp_path, results(), []).read_text()
    assert "of &lt;b&gt; with" in page
