"""The 24 coefficients of tilt-to-length coupling: two angles of six assemblies, on reception and on emission.

The assembly (MOSA) 12 is the one of spacecraft 1 that points to spacecraft 2. Its motion changes the length
of the beam that it receives from 2 by ``c_12_phi_rx phi_12 + c_12_eta_rx eta_12``, and that of the beam which
it emits, seen at 2 a light time later, by the same with ``tx``. A positive coefficient makes the path longer
where the angle grows. The names are those of lisainstrument.
"""

from fit.parameters import Parameter

ASSEMBLIES = ("12", "23", "31", "13", "32", "21")
PAIRS = (("12", "13"), ("23", "21"), ("31", "32"))  # of spacecraft 1, 2, 3: left, right
ANGLES = ("phi", "eta")
PATHS = {"rx": "receives", "tx": "emits"}
#: The angles of all assemblies, such as ``phi_12``.
SERIES = tuple(f"{angle}_{assembly}" for assembly in ASSEMBLIES for angle in ANGLES)
N_PATHS = len(PATHS)
WIDTH = 5e-3  # m/rad, of the weak prior: twice the range of lisainstrument's coefficients
_GREEK = {"phi": ("φ", r"\phi"), "eta": ("η", r"\eta")}


def coefficient(assembly: str, angle: str, path: str) -> Parameter:
    """Return a coefficient."""
    html, latex = _GREEK[angle]
    index = f"{assembly},{path}"
    return Parameter(
        f"c_{assembly}_{angle}_{path}",
        0.0,
        0.0,
        "m rad-1",
        WIDTH,
        0,
        f"c<sub>{html},{index}</sub>",
        rf"c_{{{latex},\mathrm{{{index}}}}}",
        f"path length of the beam that assembly {assembly} {PATHS[path]} by its angle {html}",
        flown=False,
    )


#: All coefficients, the two of a series beside each other.
COEFFICIENTS = tuple(
    coefficient(assembly, angle, path) for assembly in ASSEMBLIES for angle in ANGLES for path in PATHS
)
NAMES = tuple(parameter.name for parameter in COEFFICIENTS)
