"""A design as a campaign file: the campaign with other tones, and the reason for each."""

from collections.abc import Mapping, MutableMapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import Array, InlineTable

from fit import units
from lpfcosim.campaign import Campaign, Experiment
from lpfcosim.experiment_design.search import Design
from lpfcosim.experiment_design.tones import Tone
from lpfcosim.spacecraft import FS, TaperedSine

TONES = ("sine", "tapered_sine")  # shapes
MARK = ", redesigned by lpfcosim design."  # end of a line at the top of every design


def campaign_text(design: Design, name: str, source: str, text: str = "") -> str:
    """Return the campaign file.

    Parameters
    ----------
    design : Design
        The design.
    name : str
        Of the new campaign.
    source : str
        Name of the file it was made from.
    text : str
        Content of that file, whose comments are kept. A file that extends another one, or sweeps, is
        written anew with all its tables.
    """
    document = tomlkit.parse(text)
    if not document or document.keys() & {"extends", "sweep"}:
        document = tomlkit.parse(tomlkit.dumps(_tables(design.problem.plan)))
    document["name"] = name
    document.pop("design", None)
    _add_authority(document, design.campaign)
    experiments = {experiment.name: experiment for experiment in design.campaign.experiments}
    tables = document["experiments"]
    for k in reversed(range(len(tables))):
        experiment = experiments.get(tables[k]["name"])
        if experiment is None:
            del tables[k]
        else:
            _change_experiment(document, tables[k], experiment, design.tones.get(experiment.name))
    head, written = _head(design, source), tomlkit.dumps(document)
    first_line, newline, rest = written.partition("\n")
    if first_line.startswith("#:schema"):  # which editors expect first
        return f"{first_line}{newline}{head}\n{rest}"
    return f"{head}\n{written}"


def is_design(path: Path) -> bool:
    """Return whether a file is an earlier design."""
    with path.open(encoding="utf-8", errors="replace") as file:
        return any(line.rstrip("\n").endswith(MARK) for line in (file.readline(1000), file.readline(1000)))


def _written_injections(
    document: Mapping[str, Any], experiment: Mapping[str, Any]
) -> list[Mapping[str, Any]]:
    """Return the injections of an experiment as a campaign has them, those of its sequences first."""
    complete = {**document.get("defaults", {}), **experiment}
    of_sequences = [i for name in complete.get("sequences", ()) for i in document["sequences"][name]]
    return [*of_sequences, *complete.get("injections", ())]


def _tables(plan: Campaign) -> dict[str, Any]:
    """Return the tables of a campaign, with the experiments of a sweep in its place."""
    tables = {key: value for key, value in plan.tables.items() if key != "sweep"}
    if "sweep" in plan.tables:
        tables["experiments"] = [_swept(tables["experiments"][0], e) for e in plan.experiments]
    return tables


def _head(design: Design, source: str) -> str:
    objective = design.problem.objective
    goal = "largest ratio" if objective.minimax else "geometric mean"
    lines = [
        f"{source}{MARK}",
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


def _add_authority(document: MutableMapping[str, Any], campaign: Campaign) -> None:
    """Add the authority sets that a sweep or the design made."""
    for experiment in campaign.experiments:
        a = experiment.authority
        document.setdefault("authority", tomlkit.table(is_super_table=True)).setdefault(
            a.name,
            {
                "F_max_1": _si(a.F_max_1, "N"),
                "F_max_2": _si(a.F_max_2, "N"),
                "N_max_1": _si(a.N_max_1, "N m"),
                "N_max_2": _si(a.N_max_2, "N m"),
            },
        )


def _change_experiment(
    document: Mapping[str, Any],
    table: MutableMapping[str, Any],
    experiment: Experiment,
    tones: Sequence[Tone] | None,
) -> None:
    """Change authority, durations and tones in the table of an experiment; without `tones` they stay."""
    defaults = document.get("defaults", {})
    complete = {**defaults, **table}
    if complete.get("authority") != experiment.authority.name:
        table["authority"] = experiment.authority.name
    for key, n_samples in (
        ("duration", experiment.n_samples),
        ("noise_duration", experiment.n_noise_samples),
    ):
        if round(units.to_si(complete.get(key, "0 s"), "s") * FS) != n_samples:
            table[key] = f"{n_samples / FS / 60:.12g} min"
    if tones is None:
        return
    injections = _written_injections(document, table)
    for key in ("sequences", "injections"):
        table.pop(key, None)
    if "sequences" in defaults:
        table["sequences"] = []
    table["injections"] = _array([i for i in injections if i["shape"] not in TONES], tones)


def _array(injections: Sequence[Mapping[str, Any]], tones: Sequence[Tone]) -> Array:
    """Return injections as an array with a line for each, the tones with their reasons."""
    array = tomlkit.array()
    for injection in injections:
        array.add_line(_inline(injection), indent="  ")
    for tone in tones:
        array.add_line(_inline(_tone_table(tone.injection)), indent="  ", comment=tone.reason)
    array.add_line(indent="")
    return array


def _inline(table: Mapping[str, Any]) -> InlineTable:
    inline = tomlkit.inline_table()
    inline.update(table)
    return inline


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
