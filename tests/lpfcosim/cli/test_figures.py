"""The command ``figures``: figures for a journal when they are asked for."""

import shutil

import pytest

import fit
from tests.oracles import synthetic
from tests.synthetic_files import write_run


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The folder of a fit of one experiment."""
    folder = tmp_path_factory.mktemp("fitted")
    (folder / "telemetry").mkdir()
    for run in synthetic.pair(synthetic.World(), "D"):
        write_run(run, folder / "telemetry" / f"{run.kind}.h5")
    runs = fit.load(folder / "telemetry")
    fit.save_report(fit.calibrate(runs, include_short=True), runs, folder)
    return folder


def stems(folder):
    return {path.stem for path in (folder / "figures").iterdir()}


def test_figures_are_drawn_when_asked_for(lpfcosim, fitted):
    assert not (fitted / "figures").exists()
    out = lpfcosim("figures", fitted, "breakdown", "over", "--jobs", "1", status=0)[1]
    assert stems(fitted) == {"residual-over-noise", "e1b-D-breakdown"}
    assert len([*(fitted / "figures").iterdir()]) == 6
    assert f"2 figures: {fitted / 'figures'}" in out
    shutil.rmtree(fitted / "figures")
