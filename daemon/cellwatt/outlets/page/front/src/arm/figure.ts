/** The arm as it stands now: a picture that can be turned, and its joints as a list. */

import type { Cell } from '../cell';
import { h, mark, say } from '../dom';
import { figure } from '../numbers';
import { onColours } from '../palette';
import type { Alarm, Joint, Skeleton } from '../shapes';
import { t } from '../texts';
import { drawArm, type Tone } from './drawing';
import { Camera, forward, reach } from './kinematics';

const TURN = 0.01;
const STEP = 0.12;
/** ms between two readings of the list. */
const WORDS = 500;

export class ArmFigure {
  readonly element: HTMLElement;
  private readonly canvas: HTMLCanvasElement;
  private readonly angles: HTMLElement[];
  private readonly names: HTMLElement[];
  private readonly camera: Camera;
  private readonly size: number;
  private readonly numbers: readonly (number | null)[];
  private tones: Tone[] = [];
  private frame = 0;
  private describedAt = 0;
  private readonly ends: (() => void)[];

  constructor(
    private readonly cell: Cell,
    private readonly arm: Skeleton,
  ) {
    this.size = reach(arm.joints);
    this.camera = new Camera(-0.9, 0.3, 2.3 * this.size, [0, 0, 0.27 * this.size]);
    this.numbers = jointNumbers(arm.joints);
    this.canvas = h('canvas', { class: 'arm', tabindex: 0, role: 'img', onkeydown: (e: KeyboardEvent) => this.key(e) });
    this.names = arm.joints.map(() => h('span'));
    this.angles = arm.joints.map(() => h('span', { class: 'value' }));
    const rows = arm.joints.map((_, i) => (this.numbers[i] === null ? null : h('li', {}, this.names[i], this.angles[i])));
    this.element = h('div', { class: 'arm-figure' }, this.canvas, h('ul', { class: 'joints', 'aria-label': t('arm.joints') }, ...rows));
    this.drag();
    const watcher = new ResizeObserver(() => this.draw());
    watcher.observe(this.canvas);
    const channels = new Set(arm.joints.map((joint) => joint.channel));
    this.ends = [
      cell.on('frames', (frames) => Object.keys(frames.v).some((name) => channels.has(name)) && this.draw()),
      cell.on('alarm', () => this.suspect()),
      cell.on('state', () => this.suspect()),
      onColours(() => this.draw()),
      () => watcher.disconnect(),
    ];
    this.suspect();
  }

  close(): void {
    this.ends.forEach((end) => end());
    cancelAnimationFrame(this.frame);
  }

  /** Mark the joints that active alarms of this arm are about. */
  private suspect(): void {
    const { suspects, maybe } = suspected(this.cell.alarms.values(), this.arm.source);
    this.tones = this.numbers.map((n) => (n !== null && suspects.has(n) ? 'suspect' : n !== null && maybe.has(n) ? 'maybe' : 'sound'));
    mark(this.canvas, 'data-suspect', [...suspects].sort().join(' ') || null);
    mark(this.canvas, 'data-maybe', [...maybe].sort().join(' ') || null);
    const said = suspects.size ? t('arm.suspect', { joints: [...suspects].join(', ') }) : t('arm.sound');
    mark(this.canvas, 'aria-label', t('arm.alternative', { name: this.arm.name, said }));
    this.names.forEach((element, i) => {
      const tone = this.tones[i];
      const name = t('arm.joint', { n: this.numbers[i] ?? '' });
      say(element, tone === 'suspect' ? t('arm.is_suspect', { name }) : tone === 'maybe' ? t('arm.is_maybe', { name }) : name);
      mark(element.parentElement ?? element, 'class', tone ?? 'sound');
    });
    this.draw();
  }

  private positions(): number[] {
    return this.arm.joints.map((joint) => position(joint, this.cell.latest));
  }

  private draw(): void {
    this.frame ||= requestAnimationFrame((at) => this.drawn(at));
  }

  private drawn(at: number): void {
    this.frame = 0;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ctx = this.canvas.getContext('2d');
    if (!ctx || !width || !height) return;
    const fine = Math.min(2, devicePixelRatio);
    if (this.canvas.width !== Math.round(width * fine)) this.canvas.width = Math.round(width * fine);
    if (this.canvas.height !== Math.round(height * fine)) this.canvas.height = Math.round(height * fine);
    ctx.setTransform(fine, 0, 0, fine, 0, 0);
    const positions = this.positions();
    drawArm(ctx, this.camera, forward(this.arm.joints, positions), (i) => this.tones[i] ?? 'sound', this.size, width, height);
    if (at - this.describedAt < WORDS) return;
    this.describedAt = at;
    this.arm.joints.forEach((joint, i) => say(this.angles[i] as Node, reading(joint, positions[i] as number)));
  }

  private drag(): void {
    const canvas = this.canvas;
    canvas.addEventListener('pointerdown', (e) => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener('pointermove', (e) => {
      if (!canvas.hasPointerCapture(e.pointerId)) return;
      this.camera.orbit(-e.movementX * TURN, e.pointerType === 'touch' ? 0 : e.movementY * TURN);
      this.draw();
    });
  }

  private key(event: KeyboardEvent): void {
    const turns: Record<string, [number, number]> = {
      ArrowLeft: [-STEP, 0],
      ArrowRight: [STEP, 0],
      ArrowUp: [0, STEP],
      ArrowDown: [0, -STEP],
    };
    const zooms: Record<string, number> = { '+': 0.9, '-': 1.1 };
    if (event.key in turns) this.camera.orbit(...(turns[event.key] as [number, number]));
    else if (event.key in zooms) this.camera.distance *= zooms[event.key] as number;
    else return;
    event.preventDefault();
    this.draw();
  }
}

/** Position of a joint, rad or m; one that follows another has a multiple of its position. */
export function position(joint: Joint, latest: ReadonlyMap<string, number | null>): number {
  const found = joint.channel ? (latest.get(joint.channel) ?? 0) : 0;
  return found * (joint.multiplier ?? 1) + (joint.offset ?? 0);
}

/** Numbers of joints as alarms count them, from 1; null for those that do not move by themselves. */
export function jointNumbers(joints: readonly Joint[]): (number | null)[] {
  let n = 0;
  return joints.map((joint) => {
    if (joint.type === 'fixed' || joint.multiplier !== undefined) return null;
    n++;
    const number = /joint_(\d+)\./.exec(joint.channel ?? '')?.[1];
    return number ? Number(number) : n;
  });
}

/** Joints that alarms about a source suspect, and those that may be it instead. */
export function suspected(alarms: Iterable<Alarm>, source: string): { suspects: Set<number>; maybe: Set<number> } {
  const suspects = new Set<number>();
  const maybe = new Set<number>();
  for (const alarm of alarms) {
    if (!alarm.active || alarm.joint === null || (alarm.source ?? source) !== source) continue;
    suspects.add(alarm.joint);
    for (const other of alarm.alternatives) maybe.add(other);
  }
  for (const joint of suspects) maybe.delete(joint);
  return { suspects, maybe };
}

function reading(joint: Joint, position: number): string {
  return joint.type === 'prismatic' ? `${figure(position * 1000, 4)} mm` : `${((position * 180) / Math.PI).toFixed(1).replace(/^-0\.0$/, '0.0')}°`;
}
