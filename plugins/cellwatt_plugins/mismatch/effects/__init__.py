"""The effects that a simulation may lack, one module each. To add one: write its module, name it here."""

from cellwatt_plugins.mismatch.effects.asymmetric_friction import AsymmetricFriction
from cellwatt_plugins.mismatch.effects.backlash import Backlash
from cellwatt_plugins.mismatch.effects.brake_power import BrakePower
from cellwatt_plugins.mismatch.effects.clock_drift import ClockDrift
from cellwatt_plugins.mismatch.effects.converter_efficiency import ConverterEfficiency
from cellwatt_plugins.mismatch.effects.copper_loss import CopperLoss
from cellwatt_plugins.mismatch.effects.coulomb_friction import CoulombFriction
from cellwatt_plugins.mismatch.effects.effect import Effect
from cellwatt_plugins.mismatch.effects.external_contact import ExternalContact
from cellwatt_plugins.mismatch.effects.fan_switching import FanSwitching
from cellwatt_plugins.mismatch.effects.gravity_tilt import GravityTilt
from cellwatt_plugins.mismatch.effects.iron_loss import IronLoss
from cellwatt_plugins.mismatch.effects.joint_elasticity import JointElasticity
from cellwatt_plugins.mismatch.effects.link_inertial_error import LinkInertialError
from cellwatt_plugins.mismatch.effects.load_dependent_friction import LoadDependentFriction
from cellwatt_plugins.mismatch.effects.nonlinear_viscous_friction import NonlinearViscousFriction
from cellwatt_plugins.mismatch.effects.payload import Payload
from cellwatt_plugins.mismatch.effects.payload_change import PayloadChange
from cellwatt_plugins.mismatch.effects.position_periodic_torque import PositionPeriodicTorque
from cellwatt_plugins.mismatch.effects.presliding_hysteresis import PreslidingHysteresis
from cellwatt_plugins.mismatch.effects.regeneration_dissipated import RegenerationDissipated
from cellwatt_plugins.mismatch.effects.rotor_inertia import RotorInertia
from cellwatt_plugins.mismatch.effects.spring_load import SpringLoad
from cellwatt_plugins.mismatch.effects.standby_power import StandbyPower
from cellwatt_plugins.mismatch.effects.stribeck_friction import StribeckFriction
from cellwatt_plugins.mismatch.effects.temperature_dependent_friction import TemperatureDependentFriction
from cellwatt_plugins.mismatch.effects.time_delay import TimeDelay
from cellwatt_plugins.mismatch.effects.torque_drift import TorqueDrift
from cellwatt_plugins.mismatch.effects.torque_gain import TorqueGain
from cellwatt_plugins.mismatch.effects.torque_offset import TorqueOffset
from cellwatt_plugins.mismatch.effects.torque_saturation import TorqueSaturation
from cellwatt_plugins.mismatch.effects.viscous_friction import ViscousFriction
from cellwatt_plugins.mismatch.effects.winding_temperature import WindingTemperature

EFFECTS: tuple[Effect, ...] = (
    CoulombFriction(),
    ViscousFriction(),
    StribeckFriction(),
    LoadDependentFriction(),
    AsymmetricFriction(),
    NonlinearViscousFriction(),
    TemperatureDependentFriction(),
    PreslidingHysteresis(),
    Payload(),
    PayloadChange(),
    LinkInertialError(),
    GravityTilt(),
    SpringLoad(),
    PositionPeriodicTorque(),
    RotorInertia(),
    JointElasticity(),
    Backlash(),
    ExternalContact(),
    TorqueGain(),
    TorqueOffset(),
    TorqueDrift(),
    TimeDelay(),
    ClockDrift(),
    TorqueSaturation(),
    StandbyPower(),
    BrakePower(),
    CopperLoss(),
    WindingTemperature(),
    IronLoss(),
    ConverterEfficiency(),
    RegenerationDissipated(),
    FanSwitching(),
)

BY_NAME = {effect.name: effect for effect in EFFECTS}
