"""One run of a spacecraft, with all that a simulation needs, as frozen records in SI units.

The records are the tables of a campaign file: validation reads a table into its record.
"""

from lpfcosim.constants import FS, LONGEST_DELAY, READ_OUT_RANGE, H
from lpfcosim.spacecraft.electrodes import ETA_PER_X, PHI_PER_X
from lpfcosim.spacecraft.events import DAY, LONGEST_GAP, MAX_GAP_FRACTION, Events
from lpfcosim.spacecraft.injections import SHAPES, HalfCosine, Injection, Sine
from lpfcosim.spacecraft.run import Authority, Kind, Replacement, Run
from lpfcosim.spacecraft.thrusters import EIGHT_NOZZLES
