/** An arm drawn on a canvas: links, joints as short cylinders, floor and shadow; the farthest first. */

import { colour, pale } from '../palette';
import { cross, plus, unit, type Camera, type Placed, type Vector } from './kinematics';

export type Tone = 'sound' | 'suspect' | 'maybe';

/** Sides of a drawn circle. */
const SIDES = 20;
/** Radius of a joint, half its length and width of a link, as parts of the reach. */
const RADIUS = 0.05;
const LENGTH = 0.056;
const LINK = 0.064;

type Point = [number, number];

/** Draw a placed arm of a reach, m, into `width` by `height` px; `tone` is that of each joint. */
export function drawArm(
  ctx: CanvasRenderingContext2D,
  camera: Camera,
  placed: readonly Placed[],
  tone: (place: number) => Tone,
  reach: number,
  width: number,
  height: number,
): void {
  ctx.clearRect(0, 0, width, height);
  const view: View = { ctx, camera, width, height };
  floor(view, reach);
  shadow(view, placed, reach);
  const parts = [...links(placed, reach), ...joints(placed, tone, reach)];
  const { ahead } = camera.axes();
  const depth = ([x, y, z]: Vector): number => x * ahead[0] + y * ahead[1] + z * ahead[2];
  parts.sort((a, b) => depth(b.at) - depth(a.at));
  for (const part of parts) part.draw(view);
}

interface View {
  ctx: CanvasRenderingContext2D;
  camera: Camera;
  width: number;
  height: number;
}

interface Part {
  at: Vector;
  draw(view: View): void;
}

function floor({ ctx, camera, width, height }: View, reach: number): void {
  ctx.strokeStyle = colour('grid');
  ctx.lineWidth = 1;
  const half = Math.ceil(reach * 2) / 2;
  for (let at = -half; at <= half + 1e-9; at += 0.25) {
    for (const [a, b] of [
      [[at, -half, 0], [at, half, 0]],
      [[-half, at, 0], [half, at, 0]],
    ] as [Vector, Vector][]) {
      const [x, y] = camera.project(a, width, height);
      const [u, v] = camera.project(b, width, height);
      ctx.beginPath();
      ctx.moveTo(x, y);
      ctx.lineTo(u, v);
      ctx.stroke();
    }
  }
}

function shadow({ ctx, camera, width, height }: View, placed: readonly Placed[], reach: number): void {
  ctx.strokeStyle = pale('ink', 0.12);
  ctx.lineCap = ctx.lineJoin = 'round';
  for (const { at, parent } of placed) {
    const from: Vector = parent >= 0 ? (placed[parent] as Placed).at : [0, 0, 0];
    const [x, y, scale] = camera.project([from[0], from[1], 0], width, height);
    const [u, v] = camera.project([at[0], at[1], 0], width, height);
    ctx.lineWidth = LINK * reach * scale;
    ctx.beginPath();
    ctx.moveTo(x, y);
    ctx.lineTo(u, v);
    ctx.stroke();
  }
}

function* links(placed: readonly Placed[], reach: number): Generator<Part> {
  for (const { at, parent } of placed) {
    const from: Vector = parent >= 0 ? (placed[parent] as Placed).at : [0, 0, 0];
    const pieces = Math.max(1, Math.ceil(Math.hypot(...plus(at, from, -1)) / (0.12 * reach)));
    for (let i = 0; i < pieces; i++) {
      const a = between(from, at, i / pieces);
      const b = between(from, at, (i + 1) / pieces);
      yield { at: between(a, b, 0.5), draw: (view) => link(view, a, b, reach) };
    }
  }
}

function link({ ctx, camera, width, height }: View, a: Vector, b: Vector, reach: number): void {
  const [x, y, scale] = camera.project(a, width, height);
  const [u, v, other] = camera.project(b, width, height);
  const wide = LINK * reach * ((scale + other) / 2);
  ctx.lineCap = 'round';
  for (const [name, part] of [
    ['arm-edge', 1],
    ['arm', 0.82],
    ['arm-light', 0.3],
  ] as const) {
    ctx.strokeStyle = colour(name);
    ctx.lineWidth = wide * part;
    const by = name === 'arm-light' ? wide * 0.18 : 0;
    ctx.beginPath();
    ctx.moveTo(x - by, y - by);
    ctx.lineTo(u - by, v - by);
    ctx.stroke();
  }
}

function* joints(placed: readonly Placed[], tone: (place: number) => Tone, reach: number): Generator<Part> {
  for (const [place, { at, axis, joint }] of placed.entries()) {
    if (joint.type === 'fixed') continue;
    const marked = tone(place);
    yield { at, draw: (view) => cylinder(view, at, axis, reach, marked) };
  }
}

function cylinder(view: View, at: Vector, axis: Vector, reach: number, tone: Tone): void {
  const { ctx, camera } = view;
  const size = tone === 'sound' ? 1 : 1.25;
  const { ahead } = camera.axes();
  const toUs = axis[0] * ahead[0] + axis[1] * ahead[1] + axis[2] * ahead[2] < 0 ? 1 : -1;
  const near = ring(view, plus(at, axis, toUs * LENGTH * reach * size), axis, RADIUS * reach * size);
  const far = ring(view, plus(at, axis, -toUs * LENGTH * reach * size), axis, RADIUS * reach * size);
  const name = tone === 'suspect' ? 'red' : tone === 'maybe' ? 'amber' : 'joint';
  if (tone !== 'sound') {
    const [x, y, scale] = camera.project(at, view.width, view.height);
    ctx.fillStyle = pale(name, 0.22);
    ctx.beginPath();
    ctx.arc(x, y, 0.13 * reach * scale, 0, 2 * Math.PI);
    ctx.fill();
  }
  ctx.lineWidth = 1;
  fill(ctx, hull([...near, ...far]), colour(name), colour('arm-edge'));
  fill(ctx, near, colour(name), colour('arm-edge'));
  fill(ctx, near, pale('arm-light', 0.35), colour('arm-edge'));
}

function ring({ camera, width, height }: View, centre: Vector, axis: Vector, radius: number): Point[] {
  const one = unit(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
  const two = cross(axis, one);
  return Array.from({ length: SIDES }, (_, i) => {
    const angle = (2 * Math.PI * i) / SIDES;
    const point = plus(plus(centre, one, radius * Math.cos(angle)), two, radius * Math.sin(angle));
    const [x, y] = camera.project(point, width, height);
    return [x, y];
  });
}

function fill(ctx: CanvasRenderingContext2D, points: readonly Point[], inside: string, edge: string): void {
  ctx.beginPath();
  points.forEach(([x, y], i) => (i ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
  ctx.closePath();
  ctx.fillStyle = inside;
  ctx.strokeStyle = edge;
  ctx.fill();
  ctx.stroke();
}

/** Corners of the least convex outline around points, in order. */
export function hull(points: readonly Point[]): Point[] {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (from: readonly Point[]): Point[] => {
    const out: Point[] = [];
    for (const p of from) {
      while (out.length > 1 && turn(out.at(-2) as Point, out.at(-1) as Point, p) <= 0) out.pop();
      out.push(p);
    }
    return out.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

function turn(a: Point, b: Point, c: Point): number {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

function between(a: Vector, b: Vector, part: number): Vector {
  return plus(a, plus(b, a, -1), part);
}
