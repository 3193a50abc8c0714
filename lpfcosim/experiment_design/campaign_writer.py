"""A design as a campaign file: the original tables with other tones, and the reason for each."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import tomli_w

from fit import units
from lpfcosim.campaign import Campaign, Experiment
from lpfcosim.experiment_design.search import Design
from lpfcosim.experiment_design.tones import Tone
from lpfcosim.spacecraft import FS, TaperedSine

_REPLACED = ("extends", "name", "design", "defaults", "sweep", "sequences", "experiments", "authority")
_TONES = ("sine", "tapered_sine")
_INJECTION_KEYS = ("sequences", "injections")


def campaign_text(design: Design, name: str, source: str) -> str:
    """Return the campaign file.

    Parameters
    ----------
    design : Design
        What was found.
    name : str
        Of the new campaign.
    source : str
        Name of the file it was made from.
    """
    tables = design.campaign.tables
    header = {"schema": tables["schema"], "name": name}
    rest = {key: value for key, value in tables.items() if key not in (*_REPLACED, "schema")}
    plain = {key: value for key, value in rest.items() if not isinstance(value, dict)}
    deep = {key: value for key, value in rest.items() if isinstance(value, dict)}
    authority = {"authority": _authority(design.campaign)}
    sections = [
        _head(design, source),
        tomli_w.dumps(header | plain),
        tomli_w.dumps(authority),
        tomli_w.dumps(deep),
    ]
    sections += [
        _experiment(raw | _changed_keys(raw, experiment), design.tones.get(experiment.name))
        for raw, experiment in _tables_of(design)
    ]
    return "\n".join(part for part in sections if part)


def _tables_of(design: Design) -> list[tuple[dict[str, Any], Experiment]]:
    """Return what the old file says of each experiment that is left, and the experiment."""
    experiments = {experiment.name: experiment for experiment in design.campaign.experiments}
    raw = zip(_raw(design.problem.plan), design.problem.plan.experiments, strict=True)
    return [
        (tables, experiments[experiment.name]) for tables, experiment in raw if experiment.name in experiments
    ]


def _head(design: Design, source: str) -> str:
    objective = design.problem.objective
    goal = "largest ratio" if objective.minimax else "geometric mean"
    lines = [
        f"{source}, redesigned by lpfcosim design.",
        "",
        f"Of the sigmas, relative to what was wanted, the {goal} is {design.value:.4g}; no tones within the",
        f"same limits on rms go below {design.optimum.bound:.4g}.",
        "",
        *(
            f"  {name:12}  {design.problem.sigmas_before[name]:.3g} -> {design.sigmas_after[name]:.3g}"
            for name in design.problem.parameters
            if name in design.sigmas_after
        ),
        *_inertial_lines(design),
        "",
        "Tones are for what is written behind them: how many times as large a sigma would be without.",
    ]
    return "\n".join(f"# {line}".rstrip() for line in lines) + "\n"


def _inertial_lines(design: Design) -> list[str]:
    """Return the lines on angles of the inertial calibration, if they have target sigmas."""
    if design.angles is None:
        return []
    return [
        f"  {name:12}  {design.angles.sigmas_before[name]:.3g} -> {design.angles.sigmas_after[name]:.3g}"
        for name in design.angles.target_sigmas
    ]


def _authority(campaign: Campaign) -> dict[str, dict[str, str]]:
    """Return the authority sets, those of the file as it writes them and those that a sweep made."""
    sets: dict[str, Any] = dict(campaign.tables.get("authority", {}))
    for experiment in campaign.experiments:
        a = experiment.authority
        table = {
            "F_max_1": _si(a.F_max_1, "N"),
            "F_max_2": _si(a.F_max_2, "N"),
            "N_max_1": _si(a.N_max_1, "N m"),
            "N_max_2": _si(a.N_max_2, "N m"),
        }
        sets.setdefault(a.name, table)
    return sets


def _raw(campaign: Campaign) -> list[dict[str, Any]]:
    """Return what the file says of each experiment, defaults and sweep applied."""
    tables = campaign.tables
    defaults = tables.get("defaults", {})
    if "sweep" not in tables:
        names = {experiment.name for experiment in campaign.experiments}
        raws = [raw for raw in tables["experiments"] if raw["name"] in names]
        return [_with_sequences({**defaults, **raw}, tables) for raw in raws]
    base = _with_sequences({**defaults, **tables["experiments"][0]}, tables)
    return [_swept(base, experiment) for experiment in campaign.experiments]


def _changed_keys(raw: Mapping[str, Any], experiment: Experiment) -> dict[str, Any]:
    """Return the settings and the durations of an experiment where they are not what the file says."""
    changes: dict[str, Any] = {}
    if raw.get("authority") != experiment.authority.name:
        changes["authority"] = experiment.authority.name
    if round(units.to_si(raw.get("duration", "0 s"), "s") * FS) != experiment.n_samples:
        changes["duration"] = f"{experiment.n_samples / FS / 60:.12g} min"
    if round(units.to_si(raw.get("noise_duration", "0 s"), "s") * FS) != experiment.n_noise_samples:
        changes["noise_duration"] = f"{experiment.n_noise_samples / FS / 60:.12g} min"
    return changes


def _with_sequences(raw: Mapping[str, Any], tables: Mapping[str, Any]) -> dict[str, Any]:
    """Return an experiment with the injections of its sequences among its own."""
    injections = [one for name in raw.get("sequences", ()) for one in tables["sequences"][name]]
    table = {key: value for key, value in raw.items() if key not in _INJECTION_KEYS}
    return table | {"injections": [*injections, *raw.get("injections", ())]}


def _swept(base: Mapping[str, Any], experiment: Experiment) -> dict[str, Any]:
    table = {key: value for key, value in base.items() if key not in ("t0", "inertial_period")}
    table |= {
        "name": experiment.name,
        "authority": experiment.authority.name,
        "alignment_epoch": experiment.alignment_epoch,
        "duration": _si(experiment.n_samples / FS, "s"),
        "noise_duration": _si(experiment.n_noise_samples / FS, "s"),
        "dc": _si(experiment.dc, "m s^-2"),
    }
    optional = {"inertial_period": experiment.inertial_period, "t0": experiment.t0}
    return table | {key: value for key, value in optional.items() if value}


def _experiment(raw: Mapping[str, Any], tones: Sequence[Tone] | None) -> str:
    lines = ["[[experiments]]"]
    lines += [f"{key} = {_inline(value)}" for key, value in raw.items() if key != "injections"]
    replaced = _TONES if tones is not None else ()
    injections = [injection for injection in raw["injections"] if injection.get("shape") not in replaced]
    if not injections and not tones:
        return "\n".join([*lines, ""])
    lines.append("injections = [")
    lines += [f"  {_inline(injection)}," for injection in injections]
    lines += [f"  {_inline(_tone_table(tone.injection))},  # {tone.reason}" for tone in tones or ()]
    return "\n".join([*lines, "]", ""])


def _tone_table(tone: TaperedSine) -> dict[str, object]:
    length = not tone.into.startswith("F_")
    return {
        "into": tone.into,
        "shape": "tapered_sine",
        "frequency": f"{tone.frequency * 1e3:.12g} mHz",
        "amplitude": f"{tone.amplitude * 1e9:.6g} nm" if length else f"{tone.amplitude * 1e12:.6g} pN",
        "cycles": tone.cycles,
        "start": f"{tone.start:.12g} s",
        "phase": f"{tone.phase:.6g} rad",
        "ramp": f"{tone.ramp:.12g} s",
    }


def _si(value: float, unit: str) -> str:
    return f"{value:.12g} {unit}"


def _inline(value: object) -> str:
    """Return a value as TOML has it on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_inline(part)}" for key, part in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return tomli_w.dumps({"x": value}).removeprefix("x = ").strip()
