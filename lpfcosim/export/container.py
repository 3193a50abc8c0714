"""Put the FMUs of the closed loop into one FMU that steps them in the order of the network.

The co-simulation inside is that of the FMU manipulation toolbox in its sequential mode. It passes outputs on
once during initialization and steps as `cosim.co_simulation` does: driven with the same signals it gives the
same bits.
"""

from __future__ import annotations

import hashlib
import logging
import tempfile
import uuid
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

from lpfcosim.cosim import Interface, Value, read_interfaces
from lpfcosim.errors import InputError
from lpfcosim.export.ssp import same_units
from lpfcosim.modelica import build, serialize_xml
from lpfcosim.models import model_of
from lpfcosim.network import endpoint
from lpfcosim.spacecraft import Run

IDENTIFIER = "ClosedLoop"


def container(run: Run, fmus: Mapping[str, Path], path: Path) -> Path:
    """Write the closed loop of a run as one FMI 2.0 co-simulation FMU; the same input gives the same bytes.

    Its inputs are the signals that drive the loop, its outputs the recorded channels that are not such
    signals; the parameters are those of the run, fixed. The inputs of the first sample are set in
    initialization mode, those of every sample before its step. It runs where the toolbox
    and the FMUs have binaries: Linux and Windows on x86-64, macOS on arm64.

    Parameters
    ----------
    run : Run
        Gives the parameters.
    fmus : mapping of str to Path
        The FMU of each component, FMI 2.0 or 3.0.
    path : Path
        The ``.fmu`` to write.

    Returns
    -------
    Path
        ``path``.

    Raises
    ------
    InputError
        If an FMU cannot be read or does not fit, or the toolbox is not installed.
    """
    interfaces = read_interfaces(run, fmus)
    same_units(interfaces)
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="lpfcosim-") as folder:
        toolbox_fmu = _make(run, interfaces, Path(folder))
        root = Path(folder) / "content"
        with zipfile.ZipFile(toolbox_fmu) as archive:
            archive.extractall(root)
        settings = (root / "resources" / "container.txt").read_bytes()
        description = root / "modelDescription.xml"
        text = _describe(description.read_text(encoding="utf-8"), settings, run, interfaces)
        description.write_text(text, encoding="utf-8", newline="\n")
        build.write_archive(root, path)
    return path


def _make(run: Run, interfaces: Sequence[Interface], folder: Path) -> Path:
    try:
        from fmu_manipulation_toolbox.container import FMUContainer, FMUContainerError
    except ImportError:
        raise InputError(
            "a container FMU needs 'fmu-manipulation-toolbox', which is not installed; "
            "install the build extra (pip install 'lpfcosim[build]')"
        ) from None
    with _critical_messages() as fatal:  # it only logs that the container cannot run
        try:
            box = FMUContainer(IDENTIFIER, folder, fmi_version=2)
            by_model = {interface.model: interface for interface in interfaces}
            values = model_of(run).parameters(run)
            for interface in interfaces:
                box.get_fmu(str(interface.archive.resolve()), name=interface.model)
            for interface in interfaces:
                for variable, source in zip(
                    interface.inputs, interface.component.inputs.values(), strict=True
                ):
                    model, output = endpoint(source)
                    if model:
                        box.add_link(model, by_model[model].name(output), interface.model, variable)
                    else:
                        box.add_input(source, interface.model, variable)
                for variable, value in interface.parameters(values[interface.model]).items():
                    box.add_start_value(interface.model, variable, _written(value))
            for channel, source in model_of(run).record.items():
                model, output = endpoint(source)
                if model:
                    box.add_output(model, by_model[model].name(output), channel)
            box.stop_time = run.n_samples * run.h
            box.make_fmu(f"{IDENTIFIER}.fmu", step_size=run.h, sequential=True)
        except FMUContainerError as error:
            raise InputError(f"the FMUs do not fit into a container: {error}") from None
    if fatal:
        raise InputError(f"the FMUs do not fit into a container: {fatal[0]}")
    return folder / f"{IDENTIFIER}.fmu"


@contextmanager
def _critical_messages() -> Iterator[list[str]]:
    """Collect what the FMU manipulation toolbox logs as critical; keep it quiet otherwise."""
    messages: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            messages.append(record.getMessage())

    logger = logging.getLogger("fmu_manipulation_toolbox")
    collector = Collector(level=logging.CRITICAL)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(collector)
    try:
        yield messages
    finally:
        logger.removeHandler(collector)
        logger.propagate = propagate


def _written(value: Value) -> str:
    """Return a start value as the toolbox reads it."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def _describe(text: str, settings: bytes, run: Run, interfaces: Sequence[Interface]) -> str:
    """Mend what the toolbox wrote: no units, but the time, the name of the user and a random GUID."""
    root = ET.fromstring(text)
    for name in ("author", "generationDateAndTime", "license", "guid"):
        root.attrib.pop(name, None)
    root.set("description", f"Closed loop of LISA Pathfinder with the parameters of run {run.name}")
    _add_units(root, run, interfaces)
    variables = root.findall("ModelVariables/ScalarVariable")
    unknowns = root.find("ModelStructure/InitialUnknowns")
    if unknowns is not None:
        for unknown in list(unknowns):
            # An output with a start value is known.
            if variables[int(unknown.attrib["index"]) - 1].get("initial") == "exact":
                unknowns.remove(unknown)
    content = hashlib.sha256(ET.tostring(root) + settings).hexdigest()
    root.set("guid", str(uuid.uuid5(uuid.NAMESPACE_OID, content)))
    return serialize_xml(root)


def _add_units(root: ET.Element, run: Run, interfaces: Sequence[Interface]) -> None:
    units: dict[str, str | None] = {}
    for interface in interfaces:
        connected = zip(interface.inputs, interface.component.inputs.values(), strict=True)
        units |= {s: interface.unit(v) for v, s in connected if not endpoint(s)[0]}
        # What passes between the components is local, and called after them in small letters.
        units |= {f"{interface.model.lower()}.{v}": interface.unit(v) for v in interface.outputs}
    by_model = {interface.model: interface for interface in interfaces}
    for channel, source in model_of(run).record.items():
        model, variable = endpoint(source)
        if model:
            units[channel] = by_model[model].unit(by_model[model].name(variable))
    used: set[str] = set()
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        real, unit = element.find("Real"), units.get(element.attrib["name"])
        if real is not None and unit:
            real.set("unit", unit)
            used.add(unit)
    known = {name: base for interface in interfaces for name, base in interface.units.items()}
    definitions = ET.Element("UnitDefinitions")
    for name in sorted(used):
        ET.SubElement(ET.SubElement(definitions, "Unit", name=name), "BaseUnit", known[name])
    root.insert(1, definitions)  # the schema wants it after CoSimulation
