"""The paper's symbols and the numbers of the spacecraft: one spelling, one unit, one place.

Sign convention (physics of eq. deltagfull, deltaglinear, deltagjointfit), for test mass j = 1, 2 along x,
seen from the spacecraft::

    x_j'' = g_j - omega2_j x_j + lambda_j f_x_j(t - tau_j) - a_SC        tau_j = C_j / lambda_j

A negative omega2 is destabilising. tau_j is the *effective* delay of the sampled command: the transport delay
plus the half sample of its zero-order hold.
"""

from dataclasses import dataclass

FS = 10.0  # Hz, rate of read-outs and commands
H = 0.1  # s, one sample
M_TM = 1.928  # kg, one test mass
M_SC = 422.7  # kg, the spacecraft without its test masses
THRUSTER_DELAY = 0.25  # s, transport delay of a thrust command
THRUSTER_LAG = 0.1  # s, first-order lag of the thrust
READ_OUT_RANGE = 1e-4  # m, beyond it the interferometers have lost the test mass (choice)


@dataclass(frozen=True)
class Parameter:
    """A parameter of the dynamics with its value in flight (table jointfit), in SI."""

    value: float
    unit: str
    equation: str
    description: str


PARAMETERS: dict[str, Parameter] = {
    "lambda_1": Parameter(1.0748, "1", "fx2", "gain of the force commanded on test mass 1"),
    "lambda_2": Parameter(1.0776, "1", "fx2", "gain of the force commanded on test mass 2"),
    "C_1": Parameter(0.149, "s", "delaylin", "lambda_1 tau_1, delay coefficient of test mass 1"),
    "C_2": Parameter(0.186, "s", "delaylin", "lambda_2 tau_2, delay coefficient of test mass 2"),
    "omega2_1_0": Parameter(-3.99e-7, "s-2", "stiff_model", "background stiffness of test mass 1"),
    "omega2_2_0": Parameter(-4.19e-7, "s-2", "stiff_model", "background stiffness of test mass 2"),
    "alpha_x_1": Parameter(-345.0, "kg-1 m-1", "alphax", "stiffness per force authority, test mass 1"),
    "alpha_x_2": Parameter(-317.0, "kg-1 m-1", "alphax", "stiffness per force authority, test mass 2"),
    "alpha_phi_1": Parameter(-28.2e3, "kg-1 m-2", "alphaphi", "stiffness per torque authority, test mass 1"),
    "alpha_phi_2": Parameter(-27.4e3, "kg-1 m-2", "alphaphi", "stiffness per torque authority, test mass 2"),
    "delta_ifo_1": Parameter(-2.2e-5, "1", "deltagjointfit", "leak of x_1 into o_12, alignment epoch 1"),
    "delta_ifo_2": Parameter(-1.40e-5, "1", "deltagjointfit", "leak of x_1 into o_12, alignment epoch 2"),
    "delta_ifo_3": Parameter(-2.09e-5, "1", "deltagjointfit", "leak of x_1 into o_12, alignment epoch 3"),
    "delta_ifo_4": Parameter(1.91e-5, "1", "deltagjointfit", "leak of x_1 into o_12, alignment epoch 4"),
}
