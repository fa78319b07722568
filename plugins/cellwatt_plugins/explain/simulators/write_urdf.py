"""Write findings into a URDF, which can hold friction, damping, inertias and a payload only."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.simulators.files import Files
from cellwatt_plugins.explain.simulators.inertia import at_centre
from cellwatt_plugins.explain.simulators.markup import Element, number
from cellwatt_plugins.explain.simulators.mujoco import Simulator
from cellwatt_plugins.explain.simulators.target import Target, spring_of
from cellwatt_plugins.explain.simulators.written import Written, differ, differs, free_name, write_inertial
from cellwatt_plugins.robot.arm import loads_several

NO_TERM = "a URDF has no such term"
ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def write_urdf(simulator: Simulator, goal: Target, folder: Path) -> Written:
    """Write the mended file into ``folder``. Raises ``ConfigError``."""
    files = Files(simulator.path)
    done = Written()
    links, joints = (
        {e.attributes.get("name", ""): e for e in files.root.children if e.tag == tag} for tag in ("link", "joint")
    )
    own = simulator.links()
    for at, name in enumerate(simulator.joints):
        _write_dynamics(simulator, goal, at, joints[name], done)
        child = joints[name].child("child")
        link = links.get("" if child is None else child.attributes.get("link", ""))
        if link is None:
            raise ConfigError(f"{simulator.path}: joint {name} has no child link")
        if differ(goal.links[at], own[at]):
            write_inertial(link, _inertial(goal.links[at]))
            done.record_inertial(goal.links[at], own[at], f"link {link.attributes.get('name', '')}")
        if goal.payload is not None and at == len(own) - 1:
            _add_payload(goal.payload, files.root, link, links, done)
    done.files = files.write(folder)
    return done


def _write_dynamics(simulator: Simulator, goal: Target, at: int, joint: Element, done: Written) -> None:
    model, dof, name = simulator.model, simulator.places[1][at], simulator.joints[at]
    dynamics = joint.child("dynamics")
    wanted = {
        "damping": (goal.damping[at, 0], model.dof_damping[dof], "N*m*s/rad"),
        "friction": (goal.friction[at], model.dof_frictionloss[dof], "N*m"),
    }
    new = {what: number(value) for what, (value, was, _) in wanted.items() if differs(value, was)}
    for what in new:
        value, was, unit = wanted[what]
        done.record(what, f"joint {name}", value, was, simulator.unit(at, unit))
    if dynamics is not None:
        dynamics.set(**new)
    elif new:
        joint.added.append("<dynamics " + " ".join(f'{k}="{v}"' for k, v in new.items()) + "/>")


def _inertial(parameters: Float) -> str:
    mass, centre, inertia = at_centre(parameters)
    entries = " ".join(f'{name}="{number(value)}"' for name, value in sorted(zip(ENTRIES, inertia, strict=True)))
    return (
        f'<inertial><origin xyz="{" ".join(map(number, centre))}"/><mass value="{number(mass)}"/>'
        f"<inertia {entries}/></inertial>"
    )


def _add_payload(parameters: Float, root: Element, link: Element, taken: Collection[str], done: Written) -> None:
    name = free_name("payload", taken)
    root.added += [
        f'<link name="{name}">{_inertial(parameters)}</link>',
        f'<joint name="{name}_fixed" type="fixed">'
        f'<parent link="{link.attributes["name"]}"/><child link="{name}"/></joint>',
    ]
    done.record_inertial(parameters, None, f"link {name}")


def what_urdf_holds(simulator: Simulator, goal: Target) -> Target:
    """The target with those values that a URDF can hold; the others stay the user's, and are refused with a reason."""
    model, (_, dof) = simulator.model, simulator.places
    armature, (stiffness, rest) = model.dof_armature[dof].copy(), spring_of(simulator)
    shared = np.array([loads_several(goal.coupling, at) for at in range(len(dof))])
    friction = np.where(shared, model.dof_frictionloss[dof], goal.friction)
    damping = np.where(shared, model.dof_damping[dof], goal.damping[:, 0])
    lacking = (
        ("coulomb_friction", goal.friction - friction),
        ("viscous_friction", goal.damping[:, 0] - damping),
        ("rotor_inertia", goal.armature - armature),
        ("nonlinear_viscous_friction", np.abs(goal.damping[:, 1:]).sum(axis=1)),
        ("spring_load", goal.stiffness - stiffness),
        ("torque_gain", goal.gear - 1),
    )
    refused: list[tuple[str, int | None, str]] = [
        (effect, int(at), NO_TERM) for effect, more in lacking for at in np.flatnonzero(np.abs(more) > 1e-9)
    ]
    if np.any(np.abs(goal.gravity - model.opt.gravity) > 1e-9):
        refused.append(("gravity_tilt", None, "a URDF does not define the direction of gravity"))
    return replace(
        goal,
        friction=friction,
        armature=armature,
        damping=np.column_stack([damping, np.zeros((len(dof), 2))]),
        coupling=None,
        stiffness=stiffness,
        rest=rest,
        gear=np.ones_like(goal.gear),
        gravity=np.array(model.opt.gravity),
        refused=(*goal.refused, *refused),
    )
