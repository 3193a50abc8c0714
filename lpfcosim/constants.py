"""The numbers of the spacecraft and its sign convention.

Sign convention (physics of Eqs. (1), (5) and (11) of the paper), for test mass j = 1, 2 along x,
seen from the spacecraft::

    x_j'' = g_j - omega2_j x_j + lambda_j f_x_j(t - tau_j) - a_SC        tau_j = C_j / lambda_j

A negative omega2 is destabilising. tau_j is the *effective* delay of the sampled command: the transport delay
plus the half sample of its zero-order hold.
"""

FS = 10.0  # Hz, rate of read-outs and commands
H = 0.1  # s, one sample
M_TM = 1.928  # kg, one test mass
READ_OUT_RANGE = 1e-4  # m, beyond it the interferometers have lost the test mass (choice)
LONGEST_DELAY = 10.0  # s, of a command; the actuation FMU keeps a few more
