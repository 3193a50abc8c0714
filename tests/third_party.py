"""A suspension controller in C with a description of its own, as another tool might export it.

`built` makes it with variations: macros of ``third_party.c``, and changes of the description.
"""

import re
import subprocess
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import fmpy

from lpfcosim.modelica import compiler

SOURCE = Path(__file__).with_suffix(".c")
HEADERS = Path(fmpy.__file__).parent / "c-code"

#: What maps it into the place of our SuspensionControl.
VARIABLES = {
    "o_12": "distance",
    "guidance_o_12": "wanted",
    "f_control_2": "force",
    "f_u": "bandwidth",
    "f_x_2_start": "hold",
}
UNUSED = ("h", "f_z", "f_i", "f_p", "f_r")
_MAP = ", ".join(f'{ours} = "{theirs}"' for ours, theirs in VARIABLES.items())
TABLE = f"""
[fmus.SuspensionControl]
path = "ThirdParty.fmu"
variables = {{ {_MAP} }}
unused = {list(UNUSED)}
"""

_UNITS = """<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit><Unit name="m/s2"><BaseUnit m="1" s="-2"/>
</Unit><Unit name="Hz"><BaseUnit s="-1"/></Unit></UnitDefinitions>"""
_FMI2 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="ThirdParty" guid="1" generationTool="By hand">
<CoSimulation modelIdentifier="ThirdParty" canHandleVariableCommunicationStepSize="true"/>
{_UNITS}
<TypeDefinitions><SimpleType name="Law"><Enumeration>
<Item name="standard" value="1"/><Item name="stiff" value="2"/>
</Enumeration></SimpleType></TypeDefinitions>
<ModelVariables>
<ScalarVariable name="distance" valueReference="0" causality="input">
<Real unit="m" start="0"/></ScalarVariable>
<ScalarVariable name="wanted" valueReference="1" causality="input">
<Real unit="m" start="0"/></ScalarVariable>
<ScalarVariable name="bandwidth" valueReference="2" causality="parameter" variability="fixed"
  description="Unity gain"><Real unit="Hz" start="0.001" min="0" max="0.1"/></ScalarVariable>
<ScalarVariable name="hold" valueReference="3" causality="parameter" variability="tunable">
<Real unit="m/s2" start="0"/></ScalarVariable>
<ScalarVariable name="force" valueReference="4" causality="output"><Real unit="m/s2"/></ScalarVariable>
<ScalarVariable name="mode" valueReference="5" causality="parameter" variability="fixed">
<Integer start="1"/>
</ScalarVariable>
<ScalarVariable name="enabled" valueReference="6" causality="parameter" variability="fixed">
<Boolean start="true"/></ScalarVariable>
<ScalarVariable name="label" valueReference="7" causality="parameter" variability="fixed"><String start=""/>
</ScalarVariable>
<ScalarVariable name="law" valueReference="8" causality="parameter" variability="fixed">
<Enumeration declaredType="Law" start="1"/></ScalarVariable>
<ScalarVariable name="state" valueReference="10" causality="local" variability="continuous" initial="exact">
<Real start="0"/></ScalarVariable>
<ScalarVariable name="cold" valueReference="11" causality="calculatedParameter" variability="fixed"><Real/>
</ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="5" dependencies="1 2"/></Outputs>
<InitialUnknowns><Unknown index="5"/><Unknown index="11"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""
_FMI3 = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="ThirdParty" instantiationToken="1" generationTool="By hand">
<CoSimulation modelIdentifier="ThirdParty" canHandleVariableCommunicationStepSize="true"/>
{_UNITS}
<TypeDefinitions><EnumerationType name="Law">
<Item name="standard" value="1"/><Item name="stiff" value="2"/>
</EnumerationType></TypeDefinitions>
<ModelVariables>
<Float64 name="time" valueReference="99" causality="independent"/>
<Float64 name="distance" valueReference="0" causality="input" unit="m" start="0"/>
<Float64 name="wanted" valueReference="1" causality="input" unit="m" start="0"/>
<Float64 name="bandwidth" valueReference="2" causality="parameter" unit="Hz" start="0.001" min="0" max="0.1"
  description="Unity gain"/>
<Float64 name="hold" valueReference="3" causality="parameter" variability="tunable" unit="m/s2" start="0"/>
<Float64 name="force" valueReference="4" causality="output" unit="m/s2"/>
<UInt8 name="mode" valueReference="5" causality="parameter" start="1"/>
<Boolean name="enabled" valueReference="6" causality="parameter" start="true"/>
<String name="label" valueReference="7" causality="parameter"><Start value=""/></String>
<Enumeration name="law" valueReference="8" causality="parameter" declaredType="Law" start="1"/>
<Float32 name="single" valueReference="9" causality="parameter" start="1"/>
<Float64 name="state" valueReference="10" causality="local" initial="exact" start="0"/>
<Float64 name="cold" valueReference="11" causality="calculatedParameter"/>
</ModelVariables>
<ModelStructure><Output valueReference="4" dependencies="0 1"/><InitialUnknown valueReference="4"/>
<InitialUnknown valueReference="11"/></ModelStructure>
</fmiModelDescription>"""
_DESCRIPTIONS = {"2.0": _FMI2, "3.0": _FMI3}


def built(
    folder: Path,
    *macros: str,
    fmi: str = "2.0",
    name: str = "ThirdParty",
    changes: Sequence[tuple[str, str]] = (),
    files: Mapping[str, str] | None = None,
) -> Path:
    """Build the FMU.

    `macros` are defined for the C source; `changes` are (pattern, replacement) on the description; `files`
    are added.
    """
    text = _DESCRIPTIONS[fmi]
    for pattern, replacement in changes:
        text, n = re.subn(pattern, replacement, text)
        assert n, pattern
    code = f"#define FMI {fmi[0]}\n" + "".join(f"#define {m.replace('=', ' ', 1)}\n" for m in macros)
    code += SOURCE.read_text() + _stubs(fmi, SOURCE.read_text())
    archive = folder / f"{name}.fmu"
    with zipfile.ZipFile(archive, "w") as target:
        target.write(
            _library(folder, code), f"binaries/{_platform(fmi)}/ThirdParty{fmpy.sharedLibraryExtension}"
        )
        target.writestr("modelDescription.xml", text)
        for place, content in (files or {}).items():
            target.writestr(place, content)
    return archive


def _platform(fmi: str) -> str:
    return fmpy.platform if fmi == "2.0" else fmpy.platform_tuple


def _stubs(fmi: str, code: str) -> str:
    """Return functions of FMI that FMPy looks for and nothing calls."""
    header = (HEADERS / f"fmi{fmi[0]}Functions.h").read_text()
    names = set(re.findall(rf"\b(fmi{fmi[0]}[A-Z]\w+?)TYPE\b", header))
    return "".join(
        f"EXPORT int {n}(void) {{ return ERROR; }}\n" for n in sorted(names) if f"{n}(" not in code
    )


def _library(folder: Path, code: str) -> Path:
    source, library = folder / "third_party.c", folder / "third_party.so"
    source.write_text(code)
    command = [*compiler.compiler().command, "-shared", "-fPIC", "-O1", "-w", "-fvisibility=hidden"]
    subprocess.run([*command, str(source), "-o", str(library), "-lm"], check=True)
    return library
