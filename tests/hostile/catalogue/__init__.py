"""The faults of docs/faults.md that are put into the campaign of thirteen experiments."""

from tests.hostile.catalogue.channels import CHANNELS
from tests.hostile.catalogue.common import COMMON
from tests.hostile.catalogue.fault import Fault
from tests.hostile.catalogue.labels import LABELS
from tests.hostile.catalogue.mixed import MIXED
from tests.hostile.catalogue.samples import SAMPLES
from tests.hostile.catalogue.several import SEVERAL
from tests.hostile.catalogue.world import WORLD

FAULTS = (*LABELS, *CHANNELS, *SAMPLES, *WORLD, *SEVERAL, *MIXED, *COMMON)

__all__ = ["FAULTS", "Fault"]
