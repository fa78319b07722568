"""Write findings into an MJCF as attributes of joints and bodies; the rest of the file stays as the user wrote it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.simulators.files import Files
from cellwatt_plugins.explain.simulators.inertia import at_centre
from cellwatt_plugins.explain.simulators.markup import Element, number
from cellwatt_plugins.explain.simulators.mujoco import Simulator
from cellwatt_plugins.explain.simulators.target import Target, damping_of
from cellwatt_plugins.explain.simulators.written import Written, differ, differs, free_name, write_inertial
from cellwatt_plugins.robot.arm import loads_several
from cellwatt_plugins.robot.servo.law import Servo, servo_of

_KINEMATIC = ("body", "frame", "worldbody", "mujocoinclude")
HARDNESS = (0.05, 0.9999)
"""Least and greatest impedance of dry friction: a low one hardly changes the inertia of a joint that sticks."""
SERVO = {"kp": "N*m/rad", "kv": "N*m*s/rad", "forcerange": "N*m", "delay": "s"}
"""Numbers of a drive, with their units."""


def write_mjcf(simulator: Simulator, goal: Target, folder: Path) -> Written:
    """Write the mended file into ``folder``. Raises ``ConfigError`` if a joint is not in the text exactly once."""
    files = Files(simulator.path)
    done = Written()
    joints = [_joint(files, name) for name in simulator.joints]
    for at, joint in enumerate(joints):
        _write_joint(simulator, goal, at, joint, done, _turns(files, simulator, at))
    _write_tendons(files, simulator, goal, done)
    _write_links(simulator, goal, [_body(joint, simulator.path) for joint in joints], done)
    _write_gravity(files, simulator, goal, done)
    _write_gears(files, simulator, goal, done)
    if goal.servo is not None:
        _write_servos(files, simulator, goal.servo, done)
    done.files = files.write(folder)
    return done


def _joint(files: Files, name: str) -> Element:
    found = [
        e
        for e in files.all("joint")
        if e.attributes.get("name") == name and e.parent is not None and e.parent.tag in _KINEMATIC
    ]
    if len(found) != 1:
        raise ConfigError(
            f"{files.path}: joint {name} does not occur in it exactly once (attached or replicated?): cannot mend"
        )
    return found[0]


def _body(joint: Element, path: Path) -> Element:
    above = joint.parent
    while above is not None and above.tag == "frame":
        above = above.parent
    if above is None or above.tag != "body":
        raise ConfigError(f"{path}: joint {joint.attributes['name']} is outside of a body: cannot mend")
    return above


def _turns(files: Files, simulator: Simulator, at: int) -> float:
    """The file's unit of a joint's angle, rad; 1 for a slide."""
    import mujoco

    if simulator.model.joint(simulator.joints[at]).type[0] == int(mujoco.mjtJoint.mjJNT_SLIDE):
        return 1.0
    angle = "degree"
    for compiler in files.all("compiler"):
        angle = compiler.attributes.get("angle", angle)
    return float(np.pi / 180) if angle == "degree" else 1.0


def _write_joint(simulator: Simulator, goal: Target, at: int, joint: Element, done: Written, turn: float) -> None:
    model, name = simulator.model, simulator.joints[at]
    dof, place, own = simulator.places[1][at], simulator.places[0][at], model.joint(name).id
    alone = not loads_several(goal.coupling, at)  # else a tendon has them
    numbers = (
        ("frictionloss", alone * goal.friction[at], model.dof_frictionloss[dof], "N*m", 1.0),
        ("armature", alone * goal.armature[at], model.dof_armature[dof], "kg*m^2", 1.0),
        ("stiffness", goal.stiffness[at], model.jnt_stiffness[own], "N*m/rad", 1.0),
        ("springref", goal.rest[at], model.qpos_spring[place], "rad", turn),
    )
    if goal.turnover is not None and goal.turnover[at] > 0 < goal.friction[at]:
        _write_turnover(simulator, float(goal.turnover[at]), goal, at, joint, done)
    for what, value, was, unit, per in numbers:
        if differs(value, was):
            joint.set(**{what: number(value / per)})
            done.record(what, f"joint {name}", value, was, simulator.unit(at, unit))
    wanted, damping = alone * goal.damping[at], damping_of(simulator)[at]
    if differ(wanted, damping):
        # One number, or three if powers of the speed are used.
        if not (np.any(wanted[1:] != 0) or np.any(damping[1:] != 0)):
            wanted, damping = wanted[0], damping[0]
        joint.set(damping=" ".join(map(number, np.atleast_1d(wanted))))
        done.record("damping", f"joint {name}", wanted, damping, simulator.unit(at, "N*m*s/rad"))


def _write_tendons(files: Files, simulator: Simulator, goal: Target, done: Written) -> None:
    """Write a tendon for each motor that turns with several joints: its friction and rotor load them all."""
    taken = {simulator.model.tendon(i).name for i in range(simulator.model.ntendon)}
    for at, joint in enumerate(simulator.joints):
        if goal.coupling is None or not loads_several(goal.coupling, at):
            continue
        name = free_name(f"motor_of_{joint}", taken)
        turns = zip(simulator.joints, goal.coupling[at], strict=True)
        parts = "".join(f'<joint joint="{own}" coef="{number(turn)}"/>' for own, turn in turns if turn)
        known = {"frictionloss": goal.friction[at], "damping": goal.damping[at, 0], "armature": goal.armature[at]}
        text = " ".join(f'{what}="{number(value)}"' for what, value in known.items())
        files.root.added.append(f'<tendon><fixed name="{name}" {text}>{parts}</fixed></tendon>')
        for (what, value), unit in zip(known.items(), ("N*m", "N*m*s/rad", "kg*m^2"), strict=True):
            done.record(what, f"tendon {name}", value, None, simulator.unit(at, unit))


def _write_turnover(simulator: Simulator, width: float, goal: Target, at: int, joint: Element, done: Written) -> None:
    """Soften dry friction so that it grows with the velocity and reaches its full value at ``width`` rad/s.

    MuJoCo brakes with inertia · 2/time/(1 - impedance) · velocity, up to the friction; time is two steps or more.
    """
    model, dof, where = simulator.model, simulator.places[1][at], f"joint {simulator.joints[at]}"
    inertia = 1 / model.dof_invweight0[dof] + goal.armature[at] - model.dof_armature[dof]
    way = 2 * inertia * width / goal.friction[at]
    time = max(way / (1 - HARDNESS[0]), 2 * model.opt.timestep)
    hardness = float(np.clip(1 - way / time, *HARDNESS))
    joint.set(solreffriction=f"{number(time)} 1", solimpfriction=f"{number(hardness)} {number(hardness)}")
    done.record("solreffriction", where, (time, 1.0), model.dof_solref[dof], "s")
    done.record("solimpfriction", where, (hardness, hardness), model.dof_solimp[dof, :2], "")


def _inertial(parameters: Float) -> str:
    mass, centre, inertia = at_centre(parameters)
    return (
        f'<inertial pos="{" ".join(map(number, centre))}" mass="{number(mass)}" '
        f'fullinertia="{" ".join(map(number, inertia))}"/>'
    )


def _write_links(simulator: Simulator, goal: Target, bodies: Sequence[Element], done: Written) -> None:
    """Write the inertia of each joint's body, and a body for the payload in the last one."""
    for body, joint, new, own in zip(bodies, simulator.joints, goal.links, simulator.links(), strict=True):
        if differ(new, own):
            write_inertial(body, _inertial(new))
            done.record_inertial(new, own, f"body {body.attributes.get('name', f'of joint {joint}')}")
    if goal.payload is not None:
        name = free_name("payload", {simulator.model.body(i).name for i in range(simulator.model.nbody)})
        bodies[-1].added.append(f'<body name="{name}">{_inertial(goal.payload)}</body>')
        done.record_inertial(goal.payload, None, f"body {name}")


def _write_gravity(files: Files, simulator: Simulator, goal: Target, done: Written) -> None:
    was = np.array(simulator.model.opt.gravity)
    if not differ(goal.gravity, was):
        return
    written = " ".join(map(number, goal.gravity))
    options = [e for e in files.all("option") if e.parent is not None and e.parent.tag != "default"]
    stated = [e for e in options if "gravity" in e.attributes] or options[-1:]
    for option in stated:
        option.set(gravity=written)
    if not stated:
        files.root.added.append(f'<option gravity="{written}"/>')
    done.record("gravity", "option", goal.gravity, was, "m/s^2")


def _write_gears(files: Files, simulator: Simulator, goal: Target, done: Written) -> None:
    drives = simulator.actuators()
    for at in np.flatnonzero(np.abs(goal.gear - 1) > 1e-9):
        name = simulator.joints[at]
        motors = [e for e in files.all("motor") if e.attributes.get("joint") == name]
        if len(motors) != 1 or np.isnan(drives.gains[at]):
            done.refused.append(("torque_gain", int(at), "the joint has no motor of its own whose gear could hold it"))
            continue
        gear = simulator.model.actuator_gear[drives.numbers[at]].copy()
        was = float(gear[0])
        gear[0] *= goal.gear[at]
        last = int(np.flatnonzero(gear)[-1]) + 1
        motors[0].set(gear=" ".join(map(number, gear[:last])))
        done.record("gear", f"motor of joint {name}", gear[0], was, "")


def _write_servos(files: Files, simulator: Simulator, goal: Servo, done: Written) -> None:
    """Write gains, limits and delay of the joints' position actuators, in the actuators' own units."""
    own, gears = servo_of(simulator.path, simulator.joints), simulator.actuators().gears
    assert own is not None
    for at, name in enumerate(simulator.joints):
        acting = [
            e
            for actuators in files.all("actuator")
            for e in actuators.children
            if e.attributes.get("joint") == name and e.tag in ("position", "general")
        ]
        new, was = ((each.stiffness[at], each.damping[at], each.high[at], each.delay[at]) for each in (goal, own))
        numbers = zip(SERVO, new, was, strict=True)
        changed = {what: pair for what, *pair in numbers if np.isfinite(pair[0]) and differs(*pair)}
        if not changed:
            continue
        if len(acting) != 1 or "dampratio" in acting[0].attributes:
            done.refused.append(("drive_gain", at, "the joint has no position actuator with kp and kv of its own"))
            continue
        drive = acting[0]
        gear = float(gears[at])
        stiffness, damping = new[0] / gear**2, new[1] / gear**2
        if drive.tag == "position":
            drive.set(kp=number(stiffness), kv=number(damping))
        else:
            pull = number(goal.pull[at] / gear)
            drive.set(gainprm=pull, biasprm=f"0 {number(-stiffness)} {number(-damping)}")
        if "forcerange" in changed:
            drive.set(forcelimited="true", forcerange=f"{number(goal.low[at] / gear)} {number(goal.high[at] / gear)}")
        if "delay" in changed:
            rows = int(np.ceil(new[3] / simulator.model.opt.timestep)) + 2
            drive.set(delay=number(new[3]), nsample=str(rows), interp="linear")
        for what, (value, before) in changed.items():
            old = before if np.isfinite(before) else None
            done.record(what, f"drive of joint {name}", value, old, simulator.unit(at, SERVO[what]))
