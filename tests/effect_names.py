"""The effects of ``cellwatt explain``, as the contract names them."""

CONTRACT = """
coulomb_friction viscous_friction stribeck_friction load_dependent_friction asymmetric_friction
nonlinear_viscous_friction temperature_dependent_friction presliding_hysteresis payload* payload_change*
link_inertial_error gravity_tilt* spring_load position_periodic_torque rotor_inertia joint_elasticity backlash
external_contact torque_gain torque_offset torque_drift time_delay* clock_drift* torque_saturation standby_power*
brake_power* copper_loss* winding_temperature* iron_loss* converter_efficiency* regeneration_dissipated*
fan_switching*
"""
"""The names that the output's contract has; * acts on the whole robot or the supply."""
