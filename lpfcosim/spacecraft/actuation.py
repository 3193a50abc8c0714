"""The electrostatic actuation along x: its electrodes, and what makes it noisy.

Two electrodes a side of each test mass, ``ARM`` from its middle, pull only. Force F and torque N about z, of
authorities F_max and N_max, are asked of electrode k as

    F_k = (F_max + s_k F)/4 + (N_max + t_k N)/(4 ARM)        s_k, t_k = +-1: its side, its turning sense

whose sum, and with it the stiffness, does not depend on F and N (constant stiffness).
"""

from dataclasses import dataclass

ARM = 11e-3  # m, of an electrode about the middle of its face (choice)
GRADIENT = 2.9e-10  # F/m, capacitance of an electrode by the place of the test mass (choice)
LARGEST_VOLTAGE = 12.0  # V rms on an electrode (choice)
LARGEST_PULL = GRADIENT * LARGEST_VOLTAGE**2 / 2  # N, of an electrode


@dataclass(frozen=True)
class Actuation:
    """What the electronics of the electrodes do to the force along x; all of it is off by default.

    Attributes
    ----------
    electrode : float
        Relative noise of the voltage of each electrode, independent of the others [Hz^-0.5]: white from 1 mHz
        up, rising as f^-1/2 below.
    electrode_common : float
        The same, of what the electrodes of one test mass have in common [Hz^-0.5].
    """

    electrode: float = 0.0
    electrode_common: float = 0.0


def largest_pull(F_max: float, N_max: float) -> float:
    """Return what authorities may ask of one electrode [N]: force and torque both at their limit."""
    return (F_max + N_max / ARM) / 2
