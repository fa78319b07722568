"""Write effects that an MJCF cannot hold into a module beside the mended file: a MuJoCo callback without cellwatt."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from cellwatt.files import write_file
from cellwatt_plugins.explain.model import FittedTerm
from cellwatt_plugins.explain.simulators.correction import holds
from cellwatt_plugins.explain.simulators.markup import number

RIPPLE = "{c[0]} * np.sin({s[0]} * q) + {c[1]} * np.cos({s[0]} * q)"
FORMULAS = {
    ("stribeck_friction", 1): "{c[0]} * np.exp(-((w / {s[0]}) ** 2)) * turns(w, {c[0]})",
    ("stribeck_friction", 2): "{c[0]} / (1 + (w / {s[0]}) ** 2) * turns(w, {c[0]})",
    ("load_dependent_friction", 0): "{c[0]} * abs(load) * turns(w, {c[0]} * abs(load))",
    ("asymmetric_friction", 1): "0.5 * {c[0]} * abs(turns(w, {c[0]}))",
    ("nonlinear_viscous_friction", 1): "{c[0]} * abs(w) ** {s[0]} * turns(w, {c[0]})",
    ("position_periodic_torque", 1): RIPPLE,
    ("position_periodic_torque", 2): RIPPLE
    + " + {c[2]} * np.sin({s[0]} * {s[1]} * q) + {c[3]} * np.cos({s[0]} * {s[1]} * q)",
}
"""Torque, Nm, against the motion of a joint at ``q`` rad with ``w`` rad/s; ``load`` is the links' torque, Nm.

By the name of the effect and the number of its shape parameters.
"""
DEAD_BAND = {
    0.0: "kp * np.clip(command - q, -{s[0]}, {s[0]})",
    1.0: "(kp * (command - q) if abs(command - q) < {s[0]} else 0.0)",
}
"""The same for the dead band of a drive that, outside the band, pulls from its edge (0.0) or from the command (1.0)."""

MODULE = '''"""Effects that {name} cannot hold: {what}.

    import mujoco
    import {module}

    model = mujoco.MjModel.from_xml_path("{name}")
    data = mujoco.MjData(model)
    {module}.attach(model)

``attach`` applies to all models of the process that have these joints; ``mujoco.set_mjcb_passive(None)`` undoes it.
"""

import mujoco
import numpy as np

CREEP = 0.015
"""Smallest speed, rad/s, within which friction reverses."""


def attach(model):
    """Add these torques to every step."""
    own = [(model.joint(name).qposadr[0], model.joint(name).dofadr[0], _drive(model, name), law) for name, law in LAWS]

    def passive(model, data):
        for at, dof, drive, law in own:
            step = model.opt.timestep * model.dof_invweight0[dof]
            kp = -model.actuator_biasprm[drive, 1] if drive >= 0 else 0.0
            command = data.ctrl[drive] if drive >= 0 else 0.0

            def turns(w, size):
                return np.tanh(w / max(CREEP, abs(size) * step))

            data.qfrc_passive[dof] -= law(data.qpos[at], data.qvel[dof], data.qfrc_bias[dof], kp, command, turns)

    mujoco.set_mjcb_passive(passive)


def _drive(model, name):
    joint, of_joints = model.joint(name).id, model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    return next((i for i in range(model.nu) if of_joints[i] and model.actuator_trnid[i, 0] == joint), -1)


LAWS = [
{laws}
]
'''


def write_callback(mended: Path, joints: Sequence[str], terms: Sequence[FittedTerm]) -> Path | None:
    """Write the module ``NAME_mended.py``, a name that Python can import, beside a mended file; return its path.

    None if no term needs it.
    """
    laws, what = [], []
    for fitted in terms:
        effect, shape = fitted.term.effect, fitted.term.shape
        formula = DEAD_BAND[shape[1]] if effect.name == "drive_dead_band" else FORMULAS.get((effect.name, len(shape)))
        if formula is None or (holds(fitted.term) and effect.name != "asymmetric_friction"):
            continue
        c, s = [number(x) for x in fitted.coefficients], [number(x) for x in shape]
        if effect.name == "asymmetric_friction" and shape[0] < 0:
            c[0] = number(-fitted.coefficients[0])
        name = joints[fitted.term.joint or 0]
        laws.append(f"    ({name!r}, lambda q, w, load, kp, command, turns: {formula.format(c=c, s=s)}),")
        what.append(f"{effect.name.replace('_', ' ')} of {name}")
    if not what:
        return None
    module = re.sub(r"\W|^(?=\d)", "_", mended.stem)
    path = mended.with_name(f"{module}.py")
    write_file(path, MODULE.format(name=mended.name, module=module, what=", ".join(what), laws="\n".join(laws)))
    return path
