"""The part of the report on the control loops, from the ``transfer_functions.json`` of ``run``."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import BaseModel

from fit.figures import bode
from fit.files import documents
from fit.report.section import FigureSpec, Section

NAME, SCHEMA = "transfer_functions.json", "lpf-transfer-functions/1"
_CAPTION = (
    "Response of the read-outs to their guidance. Lines: the loops of the campaign, that of the first "
    "experiment; points: estimates from telemetry at the injected frequencies, with the noise of the noise "
    "runs. Below: differences of magnitude and phase from the loops of each experiment; grey, ±2 σ."
)


class _Curve(BaseModel):
    frequency: list[float]
    magnitude: list[float]
    phase: list[float]


class _Tone(BaseModel):
    experiment: str
    frequency: float
    magnitude: float
    phase: float
    sigma: float
    expected_magnitude: float
    expected_phase: float


class _Loop(BaseModel):
    modelled: _Curve
    measured: list[_Tone]


class _Document(BaseModel):
    loops: dict[str, _Loop]


def document(loops: Sequence[bode.LoopResponse]) -> dict[str, object]:
    """Return control loops as `transfer_functions.json` has them; phases in rad."""
    return {"schema": SCHEMA, "loops": {loop.read_out: _entry(loop) for loop in loops}}


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


def load(directory: Path) -> list[bode.LoopResponse]:
    """Return the control loops of which a folder has the document, none without.

    Raises
    ------
    InputError
        If it breaks its schema.
    """
    path = directory / NAME
    if not path.exists():
        return []
    loops = documents.from_json(path, "transfer functions", SCHEMA, _Document).loops
    return [_loop(name, loop) for name, loop in loops.items()]


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


def sections(directory: Path) -> list[Section]:
    """Return a section with the Bode diagram, if `directory` holds the document.

    Raises
    ------
    InputError
        If it breaks its schema.
    """
    loops = load(directory)
    if not loops:
        return []
    spec = FigureSpec(
        "bode",
        "Magnitude and phase of the control loops against frequency, measured and modelled",
        _CAPTION,
        partial(bode.bode, loops),
    )
    return [Section("loops", "Control loops", figures=(spec,))]
