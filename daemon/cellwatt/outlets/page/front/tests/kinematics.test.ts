import { describe, expect, it } from 'vitest';

import { hull } from '../src/arm/drawing';
import { jointNumbers, position, suspected } from '../src/arm/figure';
import { about, Camera, forward, reach, rolled, times, turned, type Vector } from '../src/arm/kinematics';
import type { Alarm, Joint } from '../src/shapes';

const joint = (parent: number, xyz: Vector, rpy: Vector, more: Partial<Joint> = {}): Joint => ({
  name: 'j',
  parent,
  xyz: [...xyz],
  rpy: [...rpy],
  axis: [0, 0, 1],
  type: 'revolute',
  channel: null,
  ...more,
});
const close = (found: Vector, expected: Vector): void => found.forEach((value, i) => expect(value).toBeCloseTo(expected[i] as number, 6));

/** Joint origins of a UR5e as its description gives them. */
const UR5E = [
  joint(-1, [0, 0, 0.1625], [0, 0, 0]),
  joint(0, [0, 0, 0], [Math.PI / 2, 0, 0]),
  joint(1, [-0.425, 0, 0], [0, 0, 0]),
  joint(2, [-0.3922, 0, 0.1333], [0, 0, 0]),
  joint(3, [0, -0.0997, 0], [Math.PI / 2, 0, 0]),
  joint(4, [0, 0.0996, 0], [Math.PI / 2, Math.PI, Math.PI]),
];

describe('an arm', () => {
  it('stretched out stands where its data sheet says', () => {
    const placed = forward(UR5E, [0, 0, 0, 0, 0, 0]);
    close(placed[2]!.at, [-0.425, 0, 0.1625]);
    close(placed[3]!.at, [-0.8172, -0.1333, 0.1625]);
    close(placed[4]!.at, [-0.8172, -0.1333, 0.0628]);
    close(placed[5]!.at, [-0.8172, -0.2329, 0.0628]);
  });

  it('turned about its base turns as a whole', () => {
    const placed = forward(UR5E, [Math.PI / 2, 0, 0, 0, 0, 0]);
    close(placed[2]!.at, [0, -0.425, 0.1625]);
    close(placed[5]!.at, [0.2329, -0.8172, 0.0628]);
  });

  it('has its second joint lift it', () => {
    const placed = forward(UR5E, [0, -Math.PI / 2, 0, 0, 0, 0]);
    close(placed[2]!.at, [0, 0, 0.1625 + 0.425]);
    close(placed[1]!.axis, [0, -1, 0]);
  });

  it('slides where a joint is prismatic, and not where it is fixed', () => {
    const arm = [joint(-1, [0, 0, 1], [0, 0, 0], { type: 'prismatic', axis: [2, 0, 0] }), joint(0, [0, 0, 1], [0, 0, 0], { type: 'fixed' })];
    const placed = forward(arm, [0.5, 7]);
    close(placed[0]!.at, [0.5, 0, 1]);
    close(placed[1]!.at, [0.5, 0, 2]);
    expect(reach(arm)).toBe(2);
  });

  it('turns by roll, pitch and yaw in this order', () => {
    const one = rolled([0.3, -0.7, 1.1]);
    const other = times(times(about([0, 0, 1], 1.1), about([0, 1, 0], -0.7)), about([1, 0, 0], 0.3));
    one.forEach((value, i) => expect(value).toBeCloseTo(other[i] as number, 12));
    close(turned(rolled([Math.PI / 2, 0, 0]), [0, 1, 0]), [0, 0, 1]);
  });
});

describe('a camera', () => {
  it('sees its target in the middle, and what is higher above', () => {
    const camera = new Camera(-0.9, 0.3, 3, [0, 0, 0.4]);
    const [x, y] = camera.project([0, 0, 0.4], 400, 300);
    close([x, y, 0], [200, 150, 0]);
    expect(camera.project([0, 0, 0.9], 400, 300)[1]).toBeLessThan(150);
  });

  it('sees what is farther away smaller', () => {
    const camera = new Camera(0, 0, 3, [0, 0, 0]);
    expect(camera.project([1, 0, 0], 400, 300)[2]).toBeGreaterThan(camera.project([-1, 0, 0], 400, 300)[2]);
  });

  it('never goes over the top', () => {
    const camera = new Camera();
    camera.orbit(0, 10);
    expect(camera.above).toBeLessThan(Math.PI / 2);
  });
});

describe('joints', () => {
  it('are counted as alarms count them', () => {
    const arm = [joint(-1, [0, 0, 0], [0, 0, 0]), joint(0, [0, 0, 0], [0, 0, 0], { type: 'fixed' }), joint(1, [0, 0, 0], [0, 0, 0], { channel: 'arm.joint_5.position' })];
    expect(jointNumbers(arm)).toEqual([1, null, 5]);
  });

  it('that follow another have a multiple of its position, and no number', () => {
    const finger = joint(-1, [0, 0, 0], [0, 0, 0], { channel: 'arm.joint_1.position', multiplier: -2, offset: 0.5 });
    expect(position(finger, new Map([['arm.joint_1.position', 3]]))).toBe(-5.5);
    expect(jointNumbers([finger])).toEqual([null]);
  });

  it('are suspected by active alarms about their source alone', () => {
    const alarm = (more: Partial<Alarm>): Alarm =>
      ({ id: 'a', active: true, source: 'arm', joint: 3, alternatives: [2, 4], ...more }) as Alarm;
    const found = suspected([alarm({}), alarm({ joint: 4 }), alarm({ joint: 1, source: 'other' }), alarm({ joint: 6, active: false })], 'arm');
    expect([...found.suspects]).toEqual([3, 4]);
    expect([...found.maybe]).toEqual([2]);
  });

  it('are outlined without the points inside', () => {
    const square: [number, number][] = [[0, 0], [4, 0], [4, 4], [0, 4]];
    expect(hull([...square, [2, 2], [1, 3]])).toHaveLength(4);
  });
});
