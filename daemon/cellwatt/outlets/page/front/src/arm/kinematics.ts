/** Where the joints of an arm are, and how they look from somewhere. Pure. */

import type { Joint } from '../shapes';

export type Vector = readonly [number, number, number];
/** A rotation by rows, then a translation: 12 numbers. */
export type Frame = readonly number[];

export interface Placed {
  /** Centre of the joint, m. */
  at: Vector;
  /** Its axis in the world, length 1. */
  axis: Vector;
  parent: number;
  joint: Joint;
}

const NONE: Frame = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0];

/** Joints of an arm in the world at their positions, rad or m. */
export function forward(joints: readonly Joint[], positions: readonly number[]): Placed[] {
  const frames: Frame[] = [];
  return joints.map((joint, i) => {
    const parent = joint.parent >= 0 ? (frames[joint.parent] ?? NONE) : NONE;
    const fixed = times(parent, shifted(rolled(joint.rpy), joint.xyz));
    const axis = unit(turned(fixed, joint.axis));
    frames[i] = times(fixed, moved(joint, positions[i] ?? 0));
    const at = origin(frames[i] as Frame);
    return { at, axis, parent: joint.parent, joint };
  });
}

/** Rotation by roll, pitch and yaw about fixed axes, as in URDF. */
export function rolled([r, p, y]: Vector): Frame {
  const [sr, cr, sp, cp, sy, cy] = [Math.sin(r), Math.cos(r), Math.sin(p), Math.cos(p), Math.sin(y), Math.cos(y)];
  return [
    cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,
    sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,
    -sp, cp * sr, cp * cr,
    0, 0, 0,
  ];
}

/** Rotation by an angle about an axis. */
export function about(axis: Vector, angle: number): Frame {
  const [x, y, z] = unit(axis);
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  const d = 1 - c;
  return [
    c + x * x * d, x * y * d - z * s, x * z * d + y * s,
    y * x * d + z * s, c + y * y * d, y * z * d - x * s,
    z * x * d - y * s, z * y * d + x * s, c + z * z * d,
    0, 0, 0,
  ];
}

/** First `b`, then `a`. */
export function times(a: Frame, b: Frame): Frame {
  const out: number[] = [];
  for (let row = 0; row < 3; row++) {
    for (let column = 0; column < 3; column++) {
      out.push(a[3 * row]! * b[column]! + a[3 * row + 1]! * b[3 + column]! + a[3 * row + 2]! * b[6 + column]!);
    }
  }
  const [x, y, z] = turned(a, origin(b));
  return [...out, x + a[9]!, y + a[10]!, z + a[11]!];
}

/** A direction after the rotation of a frame. */
export function turned(f: Frame, [x, y, z]: Vector): Vector {
  return [
    f[0]! * x + f[1]! * y + f[2]! * z,
    f[3]! * x + f[4]! * y + f[5]! * z,
    f[6]! * x + f[7]! * y + f[8]! * z,
  ];
}

export function origin(f: Frame): Vector {
  return [f[9]!, f[10]!, f[11]!];
}

export const plus = (a: Vector, b: Vector, by = 1): Vector => [a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** The vector with length 1; along z where it has none. */
export function unit(v: Vector): Vector {
  const size = Math.hypot(...v);
  return size > 0 ? [v[0] / size, v[1] / size, v[2] / size] : [0, 0, 1];
}

/** Longest way that an arm can reach, m: its joints in one line. */
export function reach(joints: readonly Joint[]): number {
  return joints.reduce((sum, joint) => sum + Math.hypot(...joint.xyz), 0) || 1;
}

/** Looks at a point from `distance` m away, from angles around and above, rad. */
export class Camera {
  constructor(
    public around = -0.9,
    public above = 0.35,
    public distance = 3,
    public target: Vector = [0, 0, 0.4],
  ) {}

  /** Projection onto a picture of `width` by `height` pixels: x, y, and pixels per metre there; far is small. */
  project(point: Vector, width: number, height: number): [number, number, number] {
    const { right, up, ahead } = this.axes();
    const eye = plus(this.target, ahead, -this.distance);
    const away = plus(point, eye, -1);
    const depth = Math.max(0.05, dot(away, ahead));
    const scale = (1.9 * Math.min(width, height)) / depth;
    return [width / 2 + dot(away, right) * scale, height / 2 - dot(away, up) * scale, scale];
  }

  /** Directions of the picture in the world. */
  axes(): { right: Vector; up: Vector; ahead: Vector } {
    const [ca, sa, ce, se] = [Math.cos(this.around), Math.sin(this.around), Math.cos(this.above), Math.sin(this.above)];
    const ahead: Vector = [-ca * ce, -sa * ce, -se];
    const right: Vector = [-sa, ca, 0];
    return { right, up: cross(right, ahead), ahead };
  }

  /** Go around and above; never over the top. */
  orbit(around: number, above: number): void {
    this.around += around;
    this.above = Math.min(1.5, Math.max(-0.2, this.above + above));
  }
}

function shifted(f: Frame, [x, y, z]: Vector): Frame {
  return [...f.slice(0, 9), x, y, z];
}

function moved(joint: Joint, position: number): Frame {
  if (joint.type === 'revolute') return about(joint.axis, position);
  if (joint.type === 'fixed') return NONE;
  const [x, y, z] = unit(joint.axis);
  return [...NONE.slice(0, 9), x * position, y * position, z * position];
}
