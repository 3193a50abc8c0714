"""The plant as a whole, whatever its world: is it stable, with what margins, what does it do.

Nothing here steps an FMU; the reference plants themselves belong to `lpfcosim.worlds`.
"""

__all__ = ["margins", "planning", "saturation", "spectral", "stability"]
