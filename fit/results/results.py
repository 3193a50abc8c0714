"""The results of one calibration, and their file, schema ``lpf-results/1``."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from pydantic import TypeAdapter, model_validator

from fit.errors import InputError, shown
from fit.files import atomic, documents
from fit.findings import Finding
from fit.results.estimates import CONFIG
from fit.results.fit_record import Fit, estimates
from fit.results.provenance import Provenance
from fit.tables import Table, latex_symbol, latex_text, latex_unit, latex_value
from fit.telemetry import Telemetry

if TYPE_CHECKING:
    import pandas

SCHEMA = "lpf-results/1"
#: Sections of fits by key, and what the keys name.
SECTIONS = {"experiments": "experiment", "cross_talk": "alignment epoch", "inertial": "inertial period"}
SINGLE_FITS = ("joint", "ttl")
INDEX = ["section", "key", "parameter", "unit"]
COLUMNS = ["value", "sigma", "sound", "constraint", "truth", "pull"]


@dataclass(frozen=True, repr=False)
class Results:
    """Results of one calibration.

    Attributes
    ----------
    joint : Fit or None
        The joint fit over all experiments.
    experiments : dict of str to Fit
        Each experiment on its own, by experiment name.
    cross_talk, inertial : dict of str to Fit
        By alignment epoch and by inertial period.
    provenance : Provenance
        Software, telemetry, settings and runs that the results are of.
    ttl : Fit or None
        Tilt-to-length coupling of LISA.
    """

    __pydantic_config__ = CONFIG

    joint: Fit | None
    experiments: dict[str, Fit]
    cross_talk: dict[str, Fit]
    inertial: dict[str, Fit]
    provenance: Provenance
    ttl: Fit | None = None

    @model_validator(mode="before")
    @classmethod
    def _add_sections(cls, document: Any) -> Any:
        """Return a document with the sections that it lacks, empty."""
        empty: dict[str, Any] = {"joint": None, **{section: {} for section in (*SECTIONS, "provenance")}}
        return empty | document if isinstance(document, dict) else document

    @property
    def unsound(self) -> list[tuple[str, Finding]]:
        """Fits without valid uncertainties, and why: joint (without it, the experiments) and inertial."""
        single = {f"experiments.{name}": fit for name, fit in self.experiments.items()}
        headline = {"joint": self.joint} if self.joint else single
        fits = headline | {f"inertial.{k}": f for k, f in self.inertial.items()}
        fits |= {"ttl": self.ttl} if self.ttl else {}
        return [(place, warning) for place, fit in fits.items() for warning in fit.unsound]

    @property
    def depends_on_frame(self) -> bool:
        """Whether there are cross-talk or misalignments, whose signs depend on the direction of x."""
        return bool(self.cross_talk or self.inertial)

    def fits(self) -> Iterator[tuple[str, str, Fit]]:
        """Yield all fits with their section and their key in it, which is empty for a section of one fit."""
        for section in SINGLE_FITS:
            if (single := getattr(self, section)) is not None:
                yield section, "", single
        for section in SECTIONS:
            for key, fit in getattr(self, section).items():
                yield section, key, fit

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return all estimates: a row for each parameter with value, sigma, sound, constraint, truth, pull.

        The index is section, key (of an experiment, epoch or period), parameter and unit. Where `sound` is
        false, `sigma` is not valid; `constraint` is empty where the user states none.
        """
        import pandas as pd  # slow to import

        rows = {
            (section, key, name, e.unit): tuple(getattr(e, column) for column in COLUMNS)
            for section, key, fit in self.fits()
            for name, e in fit.parameters.items()
        }
        index = pd.MultiIndex.from_tuples([*rows] or [("",) * len(INDEX)], names=INDEX)
        frame = pd.DataFrame([*rows.values()], index=index[: len(rows)], columns=COLUMNS)
        return frame.astype({"truth": float, "pull": float})

    def to_latex(self) -> str:
        r"""Return the joint fit and the inertial forces as a ``tabular`` of LaTeX, with rules of booktabs.

        Without a joint fit it holds those of the experiments. A sigma that is not valid is ``?``; what the
        user states of parameters has a column.
        """
        import pandas as pd  # slow to import

        shown = ("joint", "inertial", "ttl") if self.joint else ("experiments", "inertial", "ttl")
        rows = [
            {
                "fit": latex_text(f"{SECTIONS[section]} {key}") if key else "",
                "parameter": f"${latex_symbol(name)}$",
                "estimate": f"${latex_value(e.value, e.sigma, sound=e.sound)}$",
                "unit": latex_unit(e.unit),
                "constraint": latex_text(e.constraint),
            }
            for section, key, fit in self.fits()
            if section in shown
            for name, e in fit.parameters.items()
        ]
        table = pd.DataFrame(rows)
        return str(table[[c for c in table if table[c].any()]].to_latex(index=False, escape=False))

    def _summary(self) -> dict[str, str]:
        sections = {"joint": self.joint.state if self.joint else "none"}
        for name in SECTIONS:
            sections[name] = ", ".join(f"{key!r}" for key in getattr(self, name))
        return {name: line for name, line in sections.items() if line}

    def __repr__(self) -> str:
        main = self.joint or self.ttl
        lines = estimates({"": main}).aligned() if main else []
        lines += [f"{name}: {line}" for name, line in self._summary().items()]
        return "\n".join([*lines, *(f"warning: {message}" for message in (main.messages() if main else ()))])

    def _repr_html_(self) -> str:
        """Return what Jupyter shows."""
        main = self.joint or self.ttl
        summary = Table(("", ""), tuple(self._summary().items())).html()
        return str(Markup("<div>{}{}</div>").format(Markup(main._repr_html_() if main else ""), summary))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the results as JSON, schema ``lpf-results/1``; see `write`.

        Raises
        ------
        InputError
            If it is no path of a file, or of a folder that does not exist.
        """
        file = Path(path) if isinstance(path, str | os.PathLike) else Path()
        if not file.name or not file.parent.is_dir() or file.is_dir():
            raise InputError(f"save: path: {shown(path)}, expected a file in a folder that exists")
        write(self, file)


def check_results(results: object, function: str) -> None:
    """Refuse what is no result of a calibration, as an argument of a function."""
    if not isinstance(results, Results):
        raise InputError(f"{function}: results: {shown(results)}, expected Results (fit.calibrate)")


def sound_joint(results: Results, place: str = "the results") -> Fit:
    """Return the joint fit of a calibration, for whatever is built on it; `place` names it in messages.

    Raises
    ------
    InputError
        If there is none, or its uncertainties are not valid.
    """
    joint = results.joint
    if joint is None:
        raise InputError(f"{place}: joint: missing, expected the joint fit of a calibration")
    if joint.unsound:
        reasons = "; ".join(dict.fromkeys(w.message for w in joint.unsound))
        raise InputError(
            f"{place}: joint: is not sound ({reasons}); expected a calibration with valid uncertainties"
        )
    return joint


def check_frame(results: Results, run: Telemetry) -> None:
    """Check that a run is in the frame of the cross-talk and misalignments of a calibration.

    Raises
    ------
    InputError
        If the signs of its cross-talk or misalignments would be others there.
    """
    frame = results.provenance.frame
    if results.depends_on_frame and run.x_axis != frame:
        raise InputError(
            f"{run.path}: attribute x_axis: {run.x_axis!r}, expected {frame!r} as in the calibration, whose "
            "cross-talk and misalignments would have other signs"
        )


def load(path: Path) -> Results:
    """Read results.

    Raises
    ------
    InputError
        If the file is missing, is no JSON, has another schema or breaks it.
    """
    return documents.from_json(path, "a file of results", SCHEMA, Results)


def write(results: Results, path: Path) -> str:
    """Write `results` as JSON, which is returned; the file appears whole or not at all.

    Raises
    ------
    FitError
        If a number is not finite: such a result must not look like one.
    """
    document = TypeAdapter(Results).dump_python(results, by_alias=True, exclude_defaults=True)
    return atomic.write_json(path, {"schema": SCHEMA, **document})
