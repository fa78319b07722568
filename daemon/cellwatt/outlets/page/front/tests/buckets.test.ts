import { describe, expect, it } from 'vitest';

import { Buckets, type Aligned } from '../src/curves/buckets';
import type { Curves } from '../src/shapes';

const drawn = (buckets: Buckets, names: string[], from: number, to: number): Aligned => {
  const out: Aligned = [[]];
  buckets.draw(names, from, to, out);
  return out;
};

describe('steps of least and most', () => {
  it('keep the least and the most of what falls into a step', () => {
    const buckets = new Buckets(100, 1000, 10);
    buckets.add('a', [1000, 1030, 1099, 1100], [5, -2, 3, 7]);
    expect(drawn(buckets, ['a'], 1000, 1100)).toEqual([
      [1000, 1050, 1100, 1150],
      [-2, 5, 7, 7],
    ]);
  });

  it('give one point a step where least and most are the same', () => {
    const buckets = new Buckets(20, 0, 50);
    buckets.add('a', [0, 20, 40], [1, 2, 3]);
    expect(drawn(buckets, ['a'], 0, 40)).toEqual([
      [0, 20, 40],
      [1, 2, 3],
    ]);
  });

  it('never lose a spike, however many samples there are', () => {
    const times = Array.from({ length: 36_000 }, (_, i) => i * 100);
    const values = times.map((t) => (t === 1_234_500 ? 99 : Math.sin(t)));
    const buckets = new Buckets(3_600_000 / 800, 0, 802);
    buckets.add('a', times, values);
    const [t, a] = drawn(buckets, ['a'], 0, 3_600_000);
    expect(t.length).toBeLessThanOrEqual(2 * 802);
    expect(Math.max(...(a as number[]))).toBe(99);
  });

  it('forget the oldest when the newest come, and take nothing older', () => {
    const buckets = new Buckets(10, 0, 4);
    buckets.add('a', [0, 10, 20, 30, 40, 50], [0, 1, 2, 3, 4, 5]);
    buckets.add('a', [0], [100]);
    expect(drawn(buckets, ['a'], 0, 100)).toEqual([
      [20, 30, 40, 50],
      [2, 3, 4, 5],
    ]);
    expect(buckets.end).toBe(50);
  });

  it('leave nothing behind of what was a lap ago', () => {
    const buckets = new Buckets(10, 0, 4);
    buckets.add('a', [0, 10, 20, 30], [9, 9, 9, 9]);
    buckets.add('a', [1000], [1]);
    const [, a] = drawn(buckets, ['a'], 970, 1000);
    expect(a?.filter((value) => typeof value === 'number')).toEqual([1]);
  });

  it('tell a gap from a slower channel', () => {
    const buckets = new Buckets(10, 0, 100, [], 4);
    buckets.add('fast', Array.from({ length: 21 }, (_, i) => 10 * i), Array.from({ length: 21 }, () => 1));
    buckets.add('slow', [0, 30, 60, 200], [1, 2, 3, 4]);
    const [, slow] = drawn(buckets, ['slow'], 0, 200);
    expect(slow?.slice(0, 7)).toEqual([1, undefined, undefined, 2, undefined, undefined, 3]);
    expect(slow).toContain(null);
  });

  it('go on from the curves of the record', () => {
    const curves: Curves = {
      t: [1000, 2000, 3000],
      v: { a: { min: [1, null, 3], max: [2, null, 4] } },
      step_ms: 1000,
      intervals: [],
      alarms: [],
      from_record: true,
      complete: true,
    };
    const buckets = Buckets.of(curves, ['a', 'b'], 10_000);
    buckets.add('a', [3500, 4000], [9, 5]);
    expect(drawn(buckets, ['a'], 1000, 4000)[1]).toEqual([1, 2, undefined, undefined, 3, 9, 5, 5]);
  });

  it('count a time that rounding made early to its own step', () => {
    const buckets = new Buckets(20, 1_795_541_171_678.4, 100);
    buckets.add('a', [1_795_541_171_678.4, 1_795_541_171_698.3999, 1_795_541_171_718.4], [1, 2, 3]);
    expect(drawn(buckets, ['a'], 1_795_541_171_678, 1_795_541_171_800)[1]).toEqual([1, 2, 3]);
  });

  it('use the same arrays again', () => {
    const buckets = new Buckets(10, 0, 10, ['a']);
    const out: Aligned = [[]];
    buckets.add('a', [0, 10], [1, 2]);
    buckets.draw(['a'], 0, 100, out);
    const [times, values] = out;
    buckets.add('a', [20], [3]);
    buckets.draw(['a'], 0, 100, out);
    expect(out[0]).toBe(times);
    expect(out[1]).toBe(values);
    expect(values).toEqual([1, 2, 3]);
  });
});
