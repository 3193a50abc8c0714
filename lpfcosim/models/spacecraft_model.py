"""What a spacecraft model is: Modelica models joined by name, and what a run gives them."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fit.units import contract_spelling
from lpfcosim.modelica import build, numpy_models
from lpfcosim.network import Component, in_order
from lpfcosim.quantities import Quantity, Sign
from lpfcosim.signals import Source, white
from lpfcosim.spacecraft import Authority, Run

#: Equation of motion of LISA Pathfinder, `fit.model.dynamics`.
DELTA_G = "delta_g"
#: Parameters that are limits of commands.
_LIMIT = re.compile(r"[FN]_max_\w+")
#: Values of parameters by name; None leaves a parameter at its default.
Parameters = Mapping[str, float | None]
#: Values of parameters by name, the defaults of the models included.
Values = Mapping[str, float]


def common_parameters(run: Run, values: Values) -> Parameters:
    """Return sample time and authorities of a run, SI."""
    del values
    names = ("F_max_1", "F_max_2", "N_max_1", "N_max_2")
    return {"h": run.h, **{name: getattr(run.authority, name) for name in names}, **run.authority.others}


def _nothing(*_: object) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class Key:
    """A key of ``[truth]`` that is no parameter of a model: its unit, ``""`` if none, and its default."""

    unit: str
    default: float | None = None
    smallest: float = -np.inf


@dataclass(frozen=True)
class SpacecraftModel:
    """Models of one configuration of the spacecraft, and what a run gives them; SI.

    Wiring, recorded channels, units, defaults and the keys of a campaign follow from the models: an input is
    fed by the output of the same name of another model, or by a signal of that name; outputs that the
    telemetry contract knows are recorded. Keys of ``[truth]`` are the parameters of models without control
    laws that `derived` does not give, keys of ``[control.MODEL]`` the other parameters of those with control
    laws; parameters F_max_… and N_max_… are keys of ``[authority.NAME]``.

    Attributes
    ----------
    key : str
        By which a run chooses its model.
    name : str
        In words that follow "runs".
    models : tuple of str
        Names of FMUs, made from models of Modelica packages, in any order.
    targets : tuple of str
        Signals that injections may go into.
    read_outs : tuple of str
        Read-outs that end at `READ_OUT_RANGE`.
    commands : tuple of str
        Commands whose limits are checked before a run; a fit masks where they are reached.
    noise : mapping of str to (tuple of str, float)
        Levels of noise, each with the signals of this ASD, and the frequency [Hz] below which it rises as
        1/f; 0 if it is white.
    shaped_noise : mapping of str to str
        Further levels of noise, each with a signal whose unit it has, per root hertz; ``""``: a pure number.
    shaped_sources : callable
        From a run to the streams of noise of these levels.
    channels : tuple of str
        Outputs and signals recorded beyond those of the telemetry contract and the guidance; not of a plant,
        whose outputs a co-simulation has after their step.
    keys : mapping of str to Key
        Keys of ``[truth]`` from which `derived` parameters follow.
    drifting : tuple of str
        Parameters that have a key NAME_drift, their rate since the start of the campaign.
    stated : frozenset of str
        Parameters that a campaign always sets, so that the FMU of somebody else has no other default.
    control : mapping of str to mapping of str to float
        By model, values of parameters of control laws where they are not the defaults of the model.
    derived : callable
        From a run and all values to the parameters that follow from them, of all models.
    model_parameters : callable
        From a run to further parameters of single models.
    scattered : callable
        From the truth of a campaign and a random generator to that of an experiment.
    check : callable
        Refuses, with InputError, a run whose truth would give wrong parameters.
    attitude_rates : callable
        Set points that grow steadily, by name, and their rates [rad/s].
    affected_truths : mapping of str to mapping of str to tuple of str
        By model, input or parameter: the names under /truth that hold only of a model that takes it, where it
        is not the name itself.
    attributes : callable
        Root attributes of a telemetry file beyond the x axis.
    equation : str
        Equation of motion that `fit` has for its telemetry; ``""`` if none, so that it can only be simulated.
    truth : callable, optional
        True values under their names in /truth; by default the values of all keys of ``[truth]``.
    """

    key: str
    name: str
    models: tuple[str, ...]
    targets: tuple[str, ...]
    read_outs: tuple[str, ...]
    commands: tuple[str, ...] = ()
    noise: Mapping[str, tuple[tuple[str, ...], float]] = field(default_factory=dict)
    shaped_noise: Mapping[str, str] = field(default_factory=dict)
    shaped_sources: Callable[[Run], tuple[Source, ...]] = lambda _: ()
    channels: tuple[str, ...] = ()
    keys: Mapping[str, Key] = field(default_factory=dict)
    drifting: tuple[str, ...] = ()
    stated: frozenset[str] = frozenset({"m_tm"})
    control: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    derived: Callable[[Run, Values], Parameters] = common_parameters
    model_parameters: Callable[[Run], Mapping[str, Parameters]] = _nothing
    scattered: Callable[[Values, np.random.Generator], dict[str, float]] = lambda truth, _: dict(truth)
    check: Callable[[Run], None] = lambda _: None
    attitude_rates: Callable[[Run], Mapping[str, float]] = _nothing
    affected_truths: Mapping[str, Mapping[str, tuple[str, ...]]] = field(default_factory=dict)
    attributes: Callable[[Run], Mapping[str, str | float]] = _nothing
    equation: str = ""
    truth: Callable[[Run], dict[str, float]] | None = None

    @cached_property
    def reference_run(self) -> Run:
        """A run of this spacecraft with the authority of experiment A."""
        authority = Authority("A", 0.0, 2200e-12, 10.4e-12, 10.4e-12)
        return Run("place", "place", "noise", 1, authority, spacecraft=self.key)

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each input, output and parameter, as Modelica spells it; a name means one thing."""
        units: dict[str, str] = {}
        for module in map(numpy_models.load, self.models):
            described = {name: unit for name, (_, unit) in (module.PARAMETERS | module.INPUTS).items()}
            units |= described | module.OUTPUTS
        return units

    def unit(self, name: str) -> str:
        """Return the unit of an input, output or parameter, as the telemetry contract spells it."""
        return contract_spelling(self.units[name])

    @property
    def equations_digest(self) -> str:
        """SHA-256 of the sources of the models and of their translator."""
        packages = sorted({build.package_of(model) for model in self.models})
        digests = [numpy_models.digest(package) for package in packages]
        return digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()

    @cached_property
    def record(self) -> dict[str, str]:
        """Telemetry channel to its source, named as in `Component.inputs`."""
        from fit.telemetry import CHANNELS

        guidance = {name: name for name in self.targets if name.startswith("guidance_")}
        sources = guidance | self._outputs
        names = dict.fromkeys((*(name for name in CHANNELS if name in sources), *guidance, *self.channels))
        return {name: sources.get(name, name) for name in names}

    @cached_property
    def labels(self) -> dict[str, tuple[str, str]]:
        """Unit and description of each recorded channel, of the telemetry contract or of the models."""
        from fit.telemetry import CHANNELS

        modules = [numpy_models.load(model) for model in self.models]
        text = {name: words for module in modules for name, words in module.DESCRIPTIONS.items()}
        text |= {name: module.DESCRIPTIONS[name] for module in modules for name in module.OUTPUTS}
        return {name: CHANNELS.get(name) or (self.unit(name), text[name]) for name in self.record}

    @cached_property
    def _parameters(self) -> dict[str, dict[str, float]]:
        """Defaults of the parameters of each model, authorities left out."""
        return {
            model: {
                name: value
                for name, (value, _) in numpy_models.load(model).PARAMETERS.items()
                if name.isidentifier() and not _LIMIT.fullmatch(name)
            }
            for model in self.models
        }

    @cached_property
    def defaults(self) -> dict[str, float]:
        """Defaults of all keys of ``[truth]`` that have one, and of derived parameters."""
        plain = (m for m in self.models if not numpy_models.load(m).ERRORS)
        values = {name: value for model in plain for name, value in self._parameters[model].items()}
        values |= {f"{name}_drift": 0.0 for name in self.drifting}
        return values | {name: key.default for name, key in self.keys.items() if key.default is not None}

    @cached_property
    def truth_keys(self) -> dict[str, Quantity]:
        """What the keys of ``[truth]`` take."""
        derived = self.derived(self.reference_run, self.defaults)
        names = (name for name in self.defaults if name in self.units and name not in derived)
        declared = {name: self._quantity(name) for name in names}
        rates = {f"{name}_drift": f"{self.unit(name)} s-1" for name in self.drifting}
        declared |= {name: Quantity(f"a value in {unit}", unit, f"1 {unit}") for name, unit in rates.items()}
        return declared | {
            name: Quantity(
                f"a value in {key.unit}",
                key.unit,
                f"1 {key.unit}",
                "not negative" if key.smallest == 0 else "any",
            )
            for name, key in self.keys.items()
        }

    @cached_property
    def control_keys(self) -> dict[str, dict[str, Quantity]]:
        """What the keys of ``[control.MODEL]`` take, by model with control laws."""
        derived = self.derived(self.reference_run, self.defaults)
        return {
            model: {
                name: self._quantity(name)
                for name in self._parameters[model]
                if name not in derived and name not in self.defaults
            }
            for model in self.models
            if numpy_models.load(model).ERRORS
        }

    @cached_property
    def noise_keys(self) -> dict[str, Quantity]:
        """What the keys of ``[noise]`` take."""
        signals = {level: names[0] for level, (names, _) in self.noise.items()} | dict(self.shaped_noise)
        units = {
            level: f"{self.unit(name)} Hz^-0.5".removeprefix("1 ") if name else ""
            for level, name in signals.items()
        }
        return {
            level: Quantity("a noise level", unit, f"1 {unit}", "not negative")
            for level, unit in units.items()
        }

    @cached_property
    def authority_keys(self) -> dict[str, Quantity]:
        """What the keys of ``[authority.NAME]`` take beyond the forces along x and the torques about z."""
        names = (
            n for model in self.models for n in numpy_models.load(model).PARAMETERS if _LIMIT.fullmatch(n)
        )
        return {
            name: Quantity("a limit", unit := self.unit(name), f"10 p{unit}", "not negative", largest=1)
            for name in dict.fromkeys(names)
            if _LIMIT.fullmatch(name) and name not in Authority.__dataclass_fields__
        }

    @cached_property
    def stated_limits(self) -> dict[str, float]:
        """Defaults of the further keys of ``[authority.NAME]`` that a campaign always sets."""
        tables = [numpy_models.load(model).PARAMETERS for model in self.models]
        return {
            n: table[n][0] for table in tables for n in self.authority_keys if n in table and n in self.stated
        }

    def _quantity(self, name: str) -> Quantity:
        unit = "" if self.units[name] == "1" else self.unit(name)
        limits = {n: limits for m in self.models for n, limits in numpy_models.load(m).LIMITS.items()}
        low, high = limits.get(name, (None, None))
        sign: Sign = "not negative" if low == 0 else "not positive" if high == 0 else "any"
        return Quantity(f"a value in {unit}", unit, f"1 {unit}", sign)

    @cached_property
    def stated_truth(self) -> dict[str, float]:
        """Defaults of the keys of ``[truth]`` that a campaign always sets."""
        return {name: value for name, value in self.defaults.items() if name in self.stated}

    @cached_property
    def stated_control(self) -> dict[str, dict[str, float]]:
        """Values of control laws that a campaign always sets, by model."""
        return {
            model: {n: self._parameters[model][n] for n in keys if n in self.stated}
            | dict(self.control.get(model, {}))
            for model, keys in self.control_keys.items()
        }

    def values(self, run: Run) -> dict[str, float]:
        """Return the values of all keys of ``[truth]`` in a run that have one."""
        return {name: value for name, value in self.defaults.items() if name in self.truth_keys} | dict(
            run.truth
        )

    def true_values(self, run: Run) -> dict[str, float]:
        """Return the true values of a run, under their names in /truth."""
        return self.truth(run) if self.truth else self.values(run)

    def sources(self, run: Run) -> tuple[Source, ...]:
        """Return the streams of noise of a run."""
        streams = (
            white(name, run.level(level), knee)
            for level, (signals, knee) in self.noise.items()
            for name in signals
        )
        return (*streams, *self.shaped_sources(run))

    @cached_property
    def _outputs(self) -> dict[str, str]:
        """Output variable to ``Model.output``."""
        return {name: f"{model}.{name}" for model in self.models for name in numpy_models.load(model).OUTPUTS}

    def stimuli(self, run: Run) -> tuple[str, ...]:
        """Return the signals from outside that drive a run, injections first."""
        noise = (into for source in self.sources(run) for into, _ in source.shares)
        return tuple(dict.fromkeys((*self.targets, *self.attitude_rates(run), *noise)))

    def components(self, run: Run) -> tuple[Component, ...]:
        """Return the models of a run in the order of their steps, without inputs that nothing feeds."""
        stimuli = set(self.stimuli(run))
        ignored = {r.model: r.unused for r in run.replacements}
        inputs = {
            model: {
                name: self._outputs.get(name, name)
                for name in numpy_models.load(model).INPUTS
                if name in self._outputs or name in stimuli
            }
            for model in self.models
        }
        used = {source for sources in inputs.values() for source in sources.values()}
        used |= set(self.record.values())
        components = []
        for model in self.models:
            module = numpy_models.load(model)
            outputs = tuple(name for name in module.OUTPUTS if f"{model}.{name}" in used)
            used_inputs = {name: s for name, s in inputs[model].items() if name not in ignored.get(model, ())}
            moves = bool(module.STATES) and set(outputs) <= set(module.STATE_OUTPUTS)
            components.append(Component(model, used_inputs, outputs, moves))
        return in_order(components)

    def parameters(self, run: Run) -> dict[str, dict[str, float]]:
        """Return the parameters that a run gives each model, by name."""
        derived = self.derived(run, {**self.defaults, **run.truth})
        shared = {**run.truth, **{name: value for name, value in derived.items() if value is not None}}
        of_models = self.model_parameters(run)
        parameters: dict[str, dict[str, float]] = {}
        for model in self.models:
            law = {**self.control.get(model, {}), **run.control.get(model, {})}
            values = {**shared, **law, **of_models.get(model, {})}
            parameters[model] = {
                name: value
                for name in numpy_models.load(model).PARAMETERS
                if (value := values.get(name)) is not None
            }
        return parameters

    def unknown_truths(self, run: Run, ignored: Mapping[str, Iterable[str]]) -> set[str]:
        """Return names under /truth that say nothing if models, by name, ignore inputs or parameters."""
        names = {
            truth
            for model, ignored_names in ignored.items()
            for name in ignored_names
            for truth in self.affected_truths.get(model, {}).get(
                name, (name,) if name in self.truth_keys else ()
            )
        }
        epochs = {name for name in run.truth if name.startswith("delta_ifo_")}
        return names | (epochs if "delta_ifo" in names else set())


MODELS: dict[str, SpacecraftModel] = {}


def registered() -> dict[str, SpacecraftModel]:
    """Return the spacecraft models by key."""
    return dict(MODELS)


def model_of(run: Run) -> SpacecraftModel:
    """Return the spacecraft model of a run."""
    return MODELS[run.spacecraft]


def register(*models: SpacecraftModel) -> None:
    """Add models to those that runs can choose."""
    MODELS.update({model.key: model for model in models})


def fmu_names() -> tuple[str, ...]:
    """Return the names of the FMUs of all spacecraft models."""
    return tuple(dict.fromkeys(name for spacecraft in MODELS.values() for name in spacecraft.models))
