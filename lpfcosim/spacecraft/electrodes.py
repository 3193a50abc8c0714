"""The electrodes along x, and the stiffness about y and z that comes with their stiffness along x.

Two electrodes a side of each test mass, ``ARM`` from its middle, pull only. Force F and torque N about z, of
authorities F_max and N_max, are asked of electrode k as

    F_k = (F_max + s_k F)/4 + (N_max + t_k N)/(4 ARM)        s_k, t_k = +-1: its side, its turning sense

whose sum, and with it the stiffness, does not depend on F and N (constant stiffness).

An electrode that pulls with F at its face makes the stiffness -F C''/C' along x. A turn by a small angle a
about the centre moves the face at a distance r from the axis by r a - (L/2) a^2/2, where L is the side of the
test mass. The force on it makes the stiffness -F (<r^2> C''/C' - L/2) of that angle, with the mean over the
electrode. Authority sets the sum of F, so that the two go together (Eqs. (8), (9), (10)).
"""

from lpfcosim.constants import M_TM

ARM = 11e-3  # m, of an electrode about the middle of its face (choice)
GRADIENT = 2.9e-10  # F/m, capacitance of an electrode by the place of the test mass (choice)
WIDTH, HEIGHT = 14.5e-3, 36e-3  # m, of an electrode along y and z (choice)
SIDE = 46e-3  # m, of a test mass
INERTIA = M_TM * SIDE**2 / 6  # kg m^2
CURVATURE = 1.58e-7 / GRADIENT  # m^-1, C''/C' along x (choice, parallel plates 4 mm apart)

_FACE = SIDE / 2 / CURVATURE
ETA_PER_X = M_TM / INERTIA * (HEIGHT**2 / 12 - _FACE)
PHI_PER_X = M_TM / INERTIA * (ARM**2 + WIDTH**2 / 12 - _FACE)
