"""The same recordings to ``mujoco.sysid``: its parameters in boxes, its model builder and its optimiser.

Free are friction loss, damping and armature of each joint, mass and centre of each body. The residual is torque by
inverse dynamics on the planned motion over the noise: rollouts of a gravity-loaded arm under recorded torque leave the
motion within a second. Dry friction is as the file states it, not as MuJoCo's constraint softens it.
"""

from __future__ import annotations

import sys
from contextlib import redirect_stdout

import mujoco
import mujoco.sysid as sysid
import numpy as np

from mend.judge import Array, Motion, torque

ROWS = 3000
JOINT_NUMBERS = ("frictionloss", "damping", "armature")
MOST = 3.0
"""Upper end of a joint number's box, as a factor of the largest of its kind in the arm."""
MASS, CENTRE = 0.5, 0.05
"""Boxes: share of the mass, and m."""
HELD = 10.0
"""kg more, and twice the way, that the last body may have: whoever sets the boxes thinks of a payload."""


def parameters(model: mujoco.MjModel) -> sysid.ParameterDict:
    """All free numbers with their boxes; nominal is the user's value."""
    out = sysid.ParameterDict()
    for number in JOINT_NUMBERS:
        values = getattr(model, f"dof_{number}")
        for j in range(model.nv):

            def change(spec: mujoco.MjSpec, p: sysid.Parameter, j: int = j, number: str = number) -> None:
                joint = spec.joint(model.joint(j).name)
                if number == "damping" and np.size(joint.damping) > 1:
                    joint.damping = [float(p.value[0]), *np.zeros(np.size(joint.damping) - 1)]
                else:
                    setattr(joint, number, float(p.value[0]))

            out.add(sysid.Parameter(f"{number}_{j}", values[j], 0.0, MOST * values.max(), modifier=change))
    for b in range(1, model.nbody):
        mass, centre = model.body_mass[b], model.body_ipos[b]

        def weigh(spec: mujoco.MjSpec, p: sysid.Parameter, b: int = b) -> None:
            body = spec.body(model.body(b).name)
            body.mass, body.ipos = float(p.value[0]), p.value[1:]

        last = b == model.nbody - 1
        way = (2 if last else 1) * CENTRE
        low, high = (np.array([mass * (1 + s * MASS), *(centre + s * way)]) for s in (-1, 1))
        high[0] += HELD * last
        out.add(sysid.Parameter(f"body_{b}", np.array([mass, *centre]), low, high, modifier=weigh))
    return out


def identified(spec: mujoco.MjSpec, runs: list[Motion], noise: Array) -> mujoco.MjModel:
    """The user's model with the numbers that fit the runs best."""
    free = parameters(spec.compile())
    skip = max(1, sum(len(run.q) for run in runs) // ROWS)
    q, v, a, measured = (np.concatenate([getattr(r, n)[::skip] for r in runs]) for n in ("q", "v", "a", "measured"))

    def residual(x: Array, given: sysid.ParameterDict) -> tuple[list[Array], None, None]:
        columns = []
        for column in np.atleast_2d(x.T):
            given.update_from_vector(column)
            model = sysid.apply_param_modifiers(given, spec.copy())
            columns.append(((torque(model, q, v, a) - measured) / noise).ravel() / np.sqrt(measured.size))
        return [np.stack(columns, axis=1) if x.ndim > 1 else columns[0]], None, None

    free.move_off_bounds()
    with redirect_stdout(sys.stderr):  # the optimiser prints its steps
        found, _ = sysid.optimize(free, residual, optimizer="mujoco", verbose=False, max_iters=30)
    return sysid.apply_param_modifiers(found, spec.copy())
