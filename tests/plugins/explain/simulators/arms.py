"""A shoulder and an elbow in a vertical plane, as MJCF and URDF, and the torque that they need in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

G = 9.81


@dataclass(frozen=True)
class TwoLinks:
    """Links hang down at 0; (shoulder, elbow) each. Torque by Lagrange's equations of the double pendulum."""

    length: float = 0.5
    """m from shoulder to elbow."""
    mass: tuple[float, float] = (3.0, 1.5)
    centre: tuple[float, float] = (0.2, 0.15)
    inertia: tuple[float, float] = (0.05, 0.02)
    """kg m² about the centres, across the plane."""
    friction: tuple[float, float] = (0.0, 0.0)
    damping: tuple[float, float] = (0.0, 0.0)
    armature: tuple[float, float] = (0.0, 0.0)
    stiffness: tuple[float, float] = (0.0, 0.0)
    rest: tuple[float, float] = (0.0, 0.0)

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """(N, 2) Nm."""
        (m1, m2), (c1, c2), (i1, i2), l1 = self.mass, self.centre, self.inertia, self.length
        cos, sin = np.cos(q[:, 1]), np.sin(q[:, 1])
        own, bend = i2 + m2 * c2**2, m2 * l1 * c2
        first = i1 + m1 * c1**2 + own + m2 * l1**2 + 2 * bend * cos
        swing = bend * sin
        inertial = np.column_stack(
            [
                first * qdd[:, 0] + (own + bend * cos) * qdd[:, 1] - swing * (2 * qd[:, 0] + qd[:, 1]) * qd[:, 1],
                (own + bend * cos) * qdd[:, 0] + own * qdd[:, 1] + swing * qd[:, 0] ** 2,
            ]
        )
        lower = m2 * G * c2 * np.sin(q[:, 0] + q[:, 1])
        gravity = np.column_stack([(m1 * c1 + m2 * l1) * G * np.sin(q[:, 0]) + lower, lower])
        joints = np.array(self.friction) * np.tanh(qd / 0.004) + np.array(self.damping) * qd
        spring = np.array(self.stiffness) * (q - np.array(self.rest))
        return inertial + gravity + joints + np.array(self.armature) * qdd + spring

    def mjcf(self, names: tuple[str, str] = ("shoulder", "elbow"), base: str = "", hand: str = "") -> str:
        """The arm as a person writes it: a default class, frames away from the joints, comments."""
        lines = []
        for i in range(2):
            spring = f' stiffness="{self.stiffness[i]}" springref="{self.rest[i]}"' if self.stiffness[i] else ""
            lines.append(
                f'name="{names[i]}" axis="0 -1 0" pos="-0.1 0 0.05" damping="{self.damping[i]}" '
                f'frictionloss="{self.friction[i]}" armature="{self.armature[i]}"{spring}'
            )
        turned = [f"{0.6 * inertia} {inertia} {0.7 * inertia}" for inertia in self.inertia]
        return f"""<mujoco model="two links">
  <!-- measured on the bench -->
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0 0 -{G}"/>
  <worldbody>
    <body name="base" pos="0.3 0 1">{base}
      <body name="upper" pos="0.1 0 -0.05">
        <joint {lines[0]}/>
        <inertial pos="-0.1 0 {0.05 - self.centre[0]}" mass="{self.mass[0]}" diaginertia="{turned[0]}"/>
        <geom type="capsule" size="0.03" fromto="-0.1 0 0.05 -0.1 0 -0.4"/>
        <body name="lower" pos="0 0 -{self.length}">
          <joint {lines[1]}/>  <!-- the elbow -->
          <inertial pos="-0.1 0 {0.05 - self.centre[1]}" mass="{self.mass[1]}" diaginertia="{turned[1]}"/>{hand}
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="m1" joint="{names[0]}" gear="50"/>
    <motor name="m2" joint="{names[1]}" gear="50"/>
  </actuator>
</mujoco>
"""

    def urdf(self, names: tuple[str, str] = ("shoulder", "elbow"), shape: str = "") -> str:
        """The same as a URDF."""
        links = "".join(
            f"""
  <link name="{link}">{shape}
    <inertial>
      <origin xyz="0 0 {-self.centre[i]}"/>
      <mass value="{self.mass[i]}"/>
      <inertia ixx="{0.6 * self.inertia[i]}" ixy="0" ixz="0" iyy="{self.inertia[i]}" iyz="0"
               izz="{0.7 * self.inertia[i]}"/>
    </inertial>
  </link>"""
            for i, link in enumerate(("upper", "lower"))
        )
        joints = "".join(
            f"""
  <joint name="{names[i]}" type="revolute">
    <parent link="{parent}"/><child link="{child}"/>
    <origin xyz="0 0 {z}"/><axis xyz="0 -1 0"/><limit lower="-9" upper="9" effort="99" velocity="9"/>
    <dynamics damping="{self.damping[i]}" friction="{self.friction[i]}"/>
  </joint>"""
            for i, (parent, child, z) in enumerate((("base", "upper", 1.0), ("upper", "lower", -self.length)))
        )
        return f'<robot name="two_links">\n  <link name="base"/>{links}{joints}\n</robot>\n'


FULL = TwoLinks(friction=(2.0, 1.0), damping=(1.5, 0.4), armature=(0.3, 0.1), stiffness=(8.0, 0.0), rest=(0.4, 0.0))


def moves(count: int = 200, seed: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations (N, 2), unrelated to one another."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-3, 3, (count, 2)), rng.uniform(-2, 2, (count, 2)), rng.uniform(-5, 5, (count, 2))
