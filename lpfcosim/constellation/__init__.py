"""Three spacecraft as a constellation: the file of their motion, and lisainstrument moved by it.

The attitude of a LISA spacecraft is sensed locally, so that the three move independently: each is a run by
itself, and the constellation begins where their telemetry ends.
"""

from lpfcosim.constellation.jitter import (
    ASSEMBLIES,
    SERIES,
    Jitter,
    assembly_angles,
    join,
    read_jitter,
    spacecraft_motion,
    write_jitter,
)
from lpfcosim.constellation.lisainstrument_adapter import (
    LEAD,
    TAIL,
    import_lisainstrument,
    simulate_measurements,
)
