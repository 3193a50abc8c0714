"""What a run of the whole spacecraft needs beyond the x axis, as a frozen record in SI units.

Values are those of the LTPDA parameter files and the flight papers where they are marked so, else choices.
"""

from dataclasses import dataclass, replace

from lpfcosim.spacecraft.control import Controller, Lead
from lpfcosim.spacecraft.thrusters import Layout

ROTATION = Controller(unity_gain=30e-3, zero=9e-3, integrator_zero=1.8e-3, poles=(0.24, 0.6))
ANGLES = Controller(unity_gain=2e-3, zero=0.6e-3, integrator_zero=0.12e-3, poles=(12e-3, 60e-3))
ATTITUDE = Lead(unity_gain=0.07e-3, zero=0.021e-3, pole=0.42e-3)


@dataclass(frozen=True)
class Spacecraft:
    """Geometry, dynamics, authority and control of the degrees of freedom other than x.

    Angles theta, eta, phi are about x, y, z; ``d`` points from test mass 1 to test mass 2 along x.

    Attributes
    ----------
    I_xx_sc, I_yy_sc, I_zz_sc : float
        Inertia of the spacecraft [kg m^2].
    I_tm : float
        Inertia of a test mass about any axis [kg m^2].
    d : float
        Distance of the test masses [m].
    delta_phi, delta_eta : float
        Misalignment of the line through the test masses [rad]: offsets delta_y/d and delta_z/d.
    omega2_y, omega2_z, omega2_theta, omega2_eta, omega2_phi : float
        Stiffness of each test mass [s^-2], that about y and z apart from what follows the authority.
    eta_per_x, phi_per_x : float
        Stiffness about y and z per stiffness along x that the authority gives the same test mass [1].
    tau_es : float
        Transport delay of electrostatic commands other than x [s].
    b : tuple of float
        b_1 … b_6 of Eq. (3) [m rad^-1, m rad^-1, 1, 1, s^-2, s^-2], as the read-out has them.
    b_drift : tuple of float
        Of b_1 and b_2 [m rad^-1 s^-1].
    Omega_DC : tuple of float
        Rates about x, y, z that the attitude set points follow [rad s^-1].
    lambda_N : float
        True over commanded torque on the test masses.
    leak_phi_1 : float
        Force along x commanded on test mass 1 per torque N_phi_1 [m^-1].
    kappa_phi, kappa_eta : float
        Force along x on test mass 2 per torque on it that no command shows [m^-1].
    F_max_yz, N_max_theta, N_max_eta : float
        Authority of forces along y and z [N], of torques about x and y [N m].
    rotation : Controller
        Thrusters along y and z and about all axes.
    angles : Controller
        Torques that make the test masses follow the spacecraft.
    attitude : Lead
        Star tracker to differential force and N_theta_1.
    layout : Layout, optional
        Nozzles, by whose noise forces and torques on the spacecraft go together; without, each axis has its
        own.
    """

    I_xx_sc: float = 202.5
    I_yy_sc: float = 209.7
    I_zz_sc: float = 191.7
    I_tm: float = 6.80e-4
    d: float = 0.376
    delta_phi: float = 0.0
    delta_eta: float = 0.0
    omega2_y: float = -8e-7
    omega2_z: float = -8e-7
    omega2_theta: float = -1.5e-6
    omega2_eta: float = -1.5e-6
    omega2_phi: float = -1.5e-6
    eta_per_x: float = 0.0
    phi_per_x: float = 0.0
    tau_es: float = 0.1
    b: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    b_drift: tuple[float, float] = (0.0, 0.0)
    Omega_DC: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lambda_N: float = 1.0
    leak_phi_1: float = 0.0
    kappa_phi: float = 0.0
    kappa_eta: float = 0.0
    F_max_yz: float = 50e-12
    N_max_theta: float = 10.4e-12
    N_max_eta: float = 10.4e-12
    rotation: Controller = ROTATION
    angles: Controller = ANGLES
    attitude: Lead = ATTITUDE
    layout: Layout | None = None

    @property
    def delta_y(self) -> float:
        """Offset of test mass 2 against test mass 1 along y [m]."""
        return self.d * self.delta_phi

    @property
    def delta_z(self) -> float:
        """Offset of test mass 2 against test mass 1 along z [m]."""
        return self.d * self.delta_eta

    def compensated(self) -> "Spacecraft":
        """Take the lever arm of the misalignment off b_1 and b_2, which then are what is left after it.

        Above the bandwidth of their suspension the test masses do not follow the spacecraft, phi'' =
        -dOmega_phi, and a misalignment acts as d delta_phi and -d delta_eta beside b_1 and b_2 do. In flight
        the test masses were tilted until little of the sum was left.
        """
        return self._shifted(-self.delta_y, self.delta_z)

    def after(self, seconds: float) -> "Spacecraft":
        """Return it with b_1 and b_2 where their drifts have led after a time [s]."""
        return self._shifted(*(rate * seconds for rate in self.b_drift))

    def _shifted(self, by_1: float, by_2: float) -> "Spacecraft":
        b_1, b_2, b_3, b_4, b_5, b_6 = self.b
        return replace(self, b=(b_1 + by_1, b_2 + by_2, b_3, b_4, b_5, b_6))
