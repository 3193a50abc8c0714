"""Archives of LISA: a drafted map has its channels, and converts them."""

import numpy as np
import pytest

import fit
from fit.telemetry import map_draft
from fit.telemetry.contract import LISA_REQUIRED
from tests.oracles import lisa_loop

PICO = 1e-12


@pytest.fixture
def archives(tmp_path):
    """Runs and their CSV files, with forces in pN, and the text of a map drafted from these files."""
    runs = lisa_loop.campaign(lisa_loop.World(), lisa_loop.sequence(1e-6), duration=3600)
    for run in runs:
        columns = [run.time, *(run.channels[name] / _unit(name) for name in LISA_REQUIRED)]
        header = ",".join(["t", *LISA_REQUIRED])
        np.savetxt(
            tmp_path / f"{run.run}.csv", np.transpose(columns), "%.17g", ",", header=header, comments=""
        )
    text = map_draft.draft("A.toml", [tmp_path / f"{run.run}.csv" for run in runs], tmp_path)
    return runs, text


def _unit(channel):
    return PICO if channel.startswith("F_") else 1.0


def test_drafted_map_converts_archives_of_lisa(archives, tmp_path):
    runs, text = archives
    assert text.count(map_draft.BLANK) == text.count(f't0 = "{map_draft.BLANK}"') + 1  # and in the head
    text = text.replace('unit = "N"', 'unit = "pN"').replace(
        f't0 = "{map_draft.BLANK}"', f"t0 = {runs[0].t0}"
    )
    (tmp_path / "A.toml").write_text(text.replace("[attributes]", '[attributes]\nhalf_opening = "30 deg"'))
    converted = {run.run: run for run in fit.load(tmp_path / "A.toml", folder=tmp_path / "out")}
    for run in runs:
        assert converted[run.run].spacecraft == "LISA"
        assert converted[run.run].attributes["half_opening"] == pytest.approx(np.pi / 6)
        for name in LISA_REQUIRED:
            np.testing.assert_allclose(converted[run.run].channels[name], run.channels[name], rtol=1e-12)


def test_missing_channel_of_lisa_is_named(archives, tmp_path):
    _, text = archives
    lines = [line for line in text.splitlines() if not line.startswith("F_y_2 =")]
    (tmp_path / "A.toml").write_text("\n".join(lines))
    with pytest.raises(fit.InputError, match=r"A\.toml: channels\.F_y_2: missing, expected the column"):
        fit.load(tmp_path / "A.toml", folder=tmp_path / "out")
