"""The emulated state against what a session of the vendor's client showed; its client reads the rest in the driver."""

from __future__ import annotations

import numpy as np

from cellwatt_drivers.franka import fci


def test_where_everything_is_in_a_state():
    offsets = {name: place for name, (_, place) in fci.STATE.fields.items()}
    assert fci.STATE.itemsize == 1377
    expected = {
        "message_id": 0, "O_T_EE": 8, "O_T_EE_d": 72, "m_ee": 392, "m_load": 444, "tau_J": 512, "tau_J_d": 540,
        "dtau_J": 568, "q": 596, "q_d": 624, "dq": 652, "joint_contact": 736, "tau_ext_hat_filtered": 840,
        "O_F_ext_hat_K": 868, "O_T_EE_c": 976, "theta": 1088, "dtheta": 1116, "accelerometer_top": 1144,
        "accelerometer_bottom": 1216, "motion_generator_mode": 1288, "controller_mode": 1289, "errors": 1290,
        "reflex_reason": 1331, "robot_mode": 1372, "control_command_success_rate": 1373,
    }  # fmt: skip
    assert {name: offsets[name] for name in expected} == expected
    assert all(
        kind.base in (np.dtype("<f4"), np.dtype("u1"), np.dtype("<u8")) for kind, *_ in fci.STATE.fields.values()
    )
