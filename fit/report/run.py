"""What was run: in short for the top of the report, whole for its end."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from fit.results import Results
from fit.telemetry import Telemetry

DIGITS = 12  # of a digest, in short
_SPREAD = ("settings", "versions")  # tables with a line for each entry


def title(directory: Path, results: Results, telemetries: Sequence[Telemetry]) -> str:
    """Return the name of the campaign or, without one, that of the folder."""
    return _text(_said("campaign", results, telemetries)) or directory.resolve().name


def summary(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return what was run in a few words each; what is not known has no entry."""
    facts = {
        "Telemetry": _extent(results, telemetries),
        "Software": _software(results, telemetries),
        "Campaign digest": _text(_said("campaign_digest", results, telemetries))[:DIGITS],
        "Seed": _text(_said("seed", results, telemetries)),
        "Fit": _settings(results),
    }
    return {name: text for name, text in facts.items() if text}


def provenance(results: Results, telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return all that is recorded of the origin, every fact once."""
    found: dict[str, str] = {}
    for name, value in results.provenance.items():
        entries = value if isinstance(value, dict) and name in _SPREAD else {"": value}
        found |= {f"{name}.{key}" if key else name: _text(item) or "–" for key, item in entries.items()}
    common = {name: value for name, value in _common(telemetries).items() if found.get(name) != value}
    return found | {f"telemetry: {name}": value for name, value in common.items()}


def _said(name: str, results: Results, telemetries: Sequence[Telemetry]) -> object:
    return results.provenance.get(name, _common(telemetries).get(name))


def _common(telemetries: Sequence[Telemetry]) -> dict[str, str]:
    """Return the attributes beyond the contract's that all runs share: versions, digests, seed."""
    texts = [{name: str(value) for name, value in t.attributes.items()} for t in telemetries]
    first = texts[0] if texts else {}
    return {name: value for name, value in first.items() if all(t.get(name) == value for t in texts)}


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_text(item)}" for key, item in value.items())
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return value if isinstance(value, str) else json.dumps(value)


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'s' * (n != 1)}"


def _extent(results: Results, telemetries: Sequence[Telemetry]) -> str:
    if not telemetries:
        return f"{_count(len(results.experiments), 'experiment')}, whose telemetry is not here"
    hours = sum(t.duration for t in telemetries) / 3600
    noise = sum(t.kind == "noise" for t in telemetries)
    rates = " and ".join(f"{fs:g}" for fs in sorted({t.fs for t in telemetries}))
    days = sorted({t.t0[:10] for t in telemetries})
    when = days[0] if len(days) == 1 else f"starting {days[0]} to {days[-1]}"
    return (
        f"{_count(len(results.experiments), 'experiment')}, {_count(noise, 'noise run')}; "
        f"{hours:.4g} h at {rates} Hz, {when}"
    )


def _software(results: Results, telemetries: Sequence[Telemetry]) -> str:
    versions = results.provenance.get("versions")
    if isinstance(versions, Mapping):
        return ", ".join(f"{name} {_text(version)}" for name, version in versions.items())
    found = _common(telemetries) | {name: _text(value) for name, value in results.provenance.items()}
    named = [(name.removesuffix("_version"), v) for name, v in found.items() if name.endswith("_version")]
    return ", ".join(f"{name} {version}" for name, version in named)


def _settings(results: Results) -> str:
    chosen = results.provenance.get("settings")
    estimator = _text(chosen.get("estimator")) if isinstance(chosen, dict) else ""
    end = results.provenance.get("f_max")
    band = f"up to {end:g} Hz" if isinstance(end, float | int) else ""
    return ", ".join(text for text in (f"estimator {estimator}" if estimator else "", band) if text)
