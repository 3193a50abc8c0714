"""The part of the report on the control loops, from the ``transfer_functions.json`` of ``run``."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, BaseModel, Field

from fit.figures import bode
from fit.files import documents, problem
from fit.report.section import FigureSpec, Section

NAME, SCHEMA = "transfer_functions.json", "lpf-transfer-functions/1"
_CAPTION = (
    "Response of the read-outs to their guidance. Lines: the loops of the first "
    "experiment; points: estimates from telemetry at the injected frequencies, with the noise of the noise "
    "runs. Below: differences of magnitude and phase from the loops of each experiment; grey, ±2 σ."
)


_Positive = Annotated[float, Field(gt=0)]


class _Content(BaseModel, allow_inf_nan=False):
    pass


class _Curve(_Content):
    frequency: Annotated[list[_Positive], Field(min_length=2)]
    magnitude: list[_Positive]
    phase: list[float]


def _equally_long(curve: _Curve) -> _Curve:
    n = len(curve.frequency)
    if not n == len(curve.magnitude) == len(curve.phase):
        raise problem(f"magnitude and phase must have as many values as frequency, which has {n}")
    if any(np.diff(curve.frequency) <= 0):
        raise problem("frequency must increase")
    return curve


class _Tone(_Content):
    experiment: str
    frequency: _Positive
    magnitude: _Positive
    phase: float
    sigma: _Positive
    expected_magnitude: _Positive
    expected_phase: float


class _Loop(_Content):
    modelled: Annotated[_Curve, AfterValidator(_equally_long)]
    measured: Annotated[list[_Tone], Field(min_length=1)]


class _Document(_Content):
    campaign_digest: str = ""
    loops: Annotated[dict[str, _Loop], Field(min_length=1)]


def document(loops: Sequence[bode.LoopResponse], campaign_digest: str) -> dict[str, object]:
    """Return the control loops of a campaign as `transfer_functions.json` has them; phases in rad."""
    entries = {loop.read_out: _entry(loop) for loop in loops}
    return {"schema": SCHEMA, "campaign_digest": campaign_digest, "loops": entries}


def _entry(loop: bode.LoopResponse) -> Mapping[str, object]:
    columns = {
        "frequency": loop.tones,
        **_polar(loop.measured),
        "sigma": loop.sigma,
        **{f"expected_{name}": values for name, values in _polar(loop.expected).items()},
    }
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    modelled = {"frequency": loop.frequency, **_polar(loop.modelled)}
    return {
        "modelled": {name: values.tolist() for name, values in modelled.items()},
        "measured": [
            {"experiment": name, **dict(zip(columns, row, strict=True))}
            for name, row in zip(loop.names, rows, strict=True)
        ],
    }


def _polar(response: bode.Complex) -> dict[str, bode.Array]:
    return {"magnitude": np.abs(response), "phase": np.angle(response)}


def load(directory: Path, campaign_digest: object) -> list[bode.LoopResponse]:
    """Return the control loops of a campaign, of which a folder has the document.

    Parameters
    ----------
    directory : Path
        The folder.
    campaign_digest : object
        Of the campaign, if there is one.

    Returns
    -------
    list of LoopResponse
        None without the document, or if it is that of another campaign.

    Raises
    ------
    InputError
        If it breaks its schema.
    """
    path = directory / NAME
    if not path.exists():
        return []
    content = documents.from_json(path, "transfer functions", SCHEMA, _Document)
    if content.campaign_digest != campaign_digest:
        return []
    return [_loop(name, loop) for name, loop in content.loops.items()]


def _loop(name: str, loop: _Loop) -> bode.LoopResponse:
    curve, tones = loop.modelled, loop.measured
    return bode.LoopResponse(
        name,
        np.array(curve.frequency),
        _response(curve.magnitude, curve.phase),
        np.array([tone.frequency for tone in tones]),
        tuple(tone.experiment for tone in tones),
        _response([tone.magnitude for tone in tones], [tone.phase for tone in tones]),
        _response([tone.expected_magnitude for tone in tones], [tone.expected_phase for tone in tones]),
        np.array([tone.sigma for tone in tones]),
    )


def _response(magnitude: Sequence[float], phase: Sequence[float]) -> bode.Complex:
    return np.asarray(np.array(magnitude) * np.exp(1j * np.array(phase)))


def sections(directory: Path, campaign_digest: object) -> list[Section]:
    """Return a section with the Bode diagram, if `directory` holds the document of the campaign.

    Raises
    ------
    InputError
        If it breaks its schema.
    """
    loops = load(directory, campaign_digest)
    if not loops:
        return []
    spec = FigureSpec(
        "bode",
        "Magnitude and phase of the control loops against frequency, measured and modelled",
        _CAPTION,
        partial(bode.bode, loops),
    )
    return [Section("loops", "Control loops", figures=(spec,))]
