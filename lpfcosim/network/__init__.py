"""The network: components, which of them feeds which, and in which order that lets them step.

Which components there are depends on the spacecraft model of a run (`lpfcosim.models`). The order is
Gauss-Seidel and follows from the connections: sensors, controllers, actuators, plant. Each FMU sees what the
FMUs before it computed at this sample; only the plant's motion comes from the step before. Any other order
would add a
sample of delay, comparable to the delays that are to be measured.
"""

from lpfcosim.network.wiring import Component, check_feedthrough, endpoint, in_order
