"""The electrodes along x, and the stiffness about y and z that comes with their stiffness along x.

An electrode that pulls with F at its face makes the stiffness -F C''/C' along x. A turn by a small angle a
about the centre moves the face at a distance r from the axis by r a - (L/2) a^2/2, where L is the side of the
test mass. The force on it makes the stiffness -F (<r^2> C''/C' - L/2) of that angle, with the mean over the
electrode. Authority sets the sum of F, so that the two go together (Eqs. (8), (9), (10)).
"""

from lpfcosim.spacecraft.actuation import ARM, GRADIENT
from lpfcosim.spacecraft.parameters import M_TM

WIDTH, HEIGHT = 14.5e-3, 36e-3  # m, of an electrode along y and z (choice)
SIDE = 46e-3  # m, of a test mass
INERTIA = M_TM * SIDE**2 / 6  # kg m^2
CURVATURE = 1.58e-7 / GRADIENT  # m^-1, C''/C' along x (choice, parallel plates 4 mm apart)

_FACE = SIDE / 2 / CURVATURE
ETA_PER_X = M_TM / INERTIA * (HEIGHT**2 / 12 - _FACE)
PHI_PER_X = M_TM / INERTIA * (ARM**2 + WIDTH**2 / 12 - _FACE)
