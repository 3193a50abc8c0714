"""The part of the report on the control loops, from the ``transfer_functions.json`` of ``run``."""

from collections.abc import Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from fit.errors import InputError
from fit.figures import bode
from fit.files import documents
from fit.report.section import FigureSpec, Section

NAME, SCHEMA = "transfer_functions.json", "lpf-transfer-functions/1"
_CAPTION = (
    "Response of the read-outs to their guidance. Lines: the loops of the first experiment; points: "
    "estimates from telemetry at the injected frequencies, with the noise of the noise runs. Below: "
    "differences of magnitude and phase from the loops of each experiment; grey, ±2 σ."
)
_COMPLEX = ("modelled", "measured", "expected")


class _Document(BaseModel):
    campaign_digest: str = ""
    loops: list[dict[str, Any]]


def document(loops: Sequence[bode.LoopResponse], campaign_digest: str) -> dict[str, object]:
    """Return the control loops of a campaign for JSON: fields of `LoopResponse`, complex numbers as pairs."""
    entries = []
    for loop in loops:
        values = {field.name: getattr(loop, field.name) for field in fields(loop)}
        values |= {name: np.stack([values[name].real, values[name].imag], axis=1) for name in _COMPLEX}
        entries.append({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in values.items()})
    return {"schema": SCHEMA, "campaign_digest": campaign_digest, "loops": entries}


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
    try:
        return [_loop(**loop) for loop in content.loops]
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: loops: {error}, expected those that run wrote") from error


def _loop(read_out: str, names: Sequence[str], **columns: Any) -> bode.LoopResponse:
    arrays: dict[str, Any] = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    arrays |= {name: arrays[name] @ [1, 1j] for name in arrays.keys() & {*_COMPLEX}}
    loop = bode.LoopResponse(read_out=read_out, names=tuple(names), **arrays)
    if loop.frequency.shape != loop.modelled.shape or len({len(loop.names), *map(len, loop.at_tones)}) > 1:
        raise ValueError("columns of different lengths")
    return loop


def sections(directory: Path, campaign_digest: object) -> list[Section]:
    """Return a section with the Bode diagram, if `directory` holds the document of the campaign.

    Raises
    ------
    InputError
        If it breaks its schema.
    """
    description = "Magnitude and phase of the control loops against frequency, measured and modelled"
    loops = load(directory, campaign_digest)
    specs = (FigureSpec("bode", description, _CAPTION, partial(bode.bode, loops)),)
    return [Section("loops", "Control loops", figures=specs)] if loops else []
