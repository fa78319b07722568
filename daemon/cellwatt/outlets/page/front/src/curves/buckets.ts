/** Least and most of channels in equal steps of time: as many as there are pixels, whatever comes in. */

import type { Curves, Values } from '../shapes';

/** Data of a uPlot chart: times, then the values of each series; null is a gap, undefined is nothing. */
export type Aligned = [number[], ...(number | null | undefined)[][]];

/** ms by which a time may be early through rounding. */
const ROUNDING = 0.01;
/** Steps without a value after which a line breaks. */
const BROKEN = 4;

/**
 * A ring of steps of `step` ms, `capacity` of them, the first of all beginning at `anchor`. A step that is asked for
 * beyond the newest makes the oldest go. Memory is taken once, when a channel is added.
 */
export class Buckets {
  readonly capacity: number;
  private newest = -1;
  private readonly low = new Map<string, Float64Array>();
  private readonly high = new Map<string, Float64Array>();

  constructor(
    readonly step: number,
    readonly anchor: number,
    capacity: number,
    channels: readonly string[] = [],
    private readonly broken = BROKEN,
  ) {
    this.capacity = Math.max(2, Math.ceil(capacity));
    for (const name of channels) this.row(name);
  }

  /** Steps for `curves` and for what follows them, over `span` ms. */
  static of(curves: Curves, channels: readonly string[], span: number): Buckets {
    const step = curves.step_ms > 0 ? curves.step_ms : 20;
    const found = new Buckets(step, curves.t[0] ?? Date.now(), span / step + 2, channels);
    for (const name of channels) {
      const values = curves.v[name];
      if (!values) continue;
      found.add(name, curves.t, values.min);
      if (values.max) found.add(name, curves.t, values.max);
    }
    return found;
  }

  /** Take values of a channel at times, ms. */
  add(name: string, times: readonly number[], values: Values): void {
    const low = this.row(name);
    const high = this.high.get(name) as Float64Array;
    for (let i = 0; i < times.length; i++) {
      const place = this.place(times[i] as number);
      const value = values[i];
      if (place < 0 || value === null || value === undefined) continue;
      if (!(low[place]! <= value)) low[place] = value;
      if (!(high[place]! >= value)) high[place] = value;
    }
  }

  /** Begin of the newest step, ms. */
  get end(): number {
    return this.anchor + this.newest * this.step;
  }

  /**
   * Write the steps from `from` to `to` ms into `out`, whose arrays are kept: two points a step where least and most
   * differ in some channel, else one. The answer is true where there are two.
   */
  draw(channels: readonly string[], from: number, to: number, out: Aligned): boolean {
    const first = Math.max(0, this.newest - this.capacity + 1, Math.floor((from - this.anchor) / this.step) - 1);
    const last = Math.min(this.newest, Math.ceil((to - this.anchor) / this.step) + 1);
    const twice = this.ranges(channels);
    const count = Math.max(0, last - first + 1) * (twice ? 2 : 1);
    const times = out[0];
    times.length = count;
    for (let i = 0, n = first; n <= last; n++) {
      const t = this.anchor + n * this.step;
      times[i++] = t;
      if (twice) times[i++] = t + this.step / 2;
    }
    channels.forEach((name, series) => {
      const values = (out[series + 1] ??= []);
      values.length = count;
      this.write(name, first, last, twice, values);
    });
    out.length = channels.length + 1;
    return twice;
  }

  private write(name: string, first: number, last: number, twice: boolean, out: (number | null | undefined)[]): void {
    const low = this.low.get(name);
    const high = this.high.get(name);
    let empty = 0;
    for (let i = 0, n = first; n <= last; n++) {
      const place = n % this.capacity;
      const least = low ? low[place]! : NaN;
      const known = least === least;
      empty = known ? 0 : empty + 1;
      const gap = empty >= this.broken ? null : undefined;
      out[i++] = known ? least : gap;
      if (twice) out[i++] = known ? high![place]! : gap;
    }
  }

  private ranges(channels: readonly string[]): boolean {
    for (const name of channels) {
      const low = this.low.get(name);
      const high = this.high.get(name);
      if (low && high && low.some((value, i) => value < high[i]!)) return true;
    }
    return false;
  }

  private row(name: string): Float64Array {
    const known = this.low.get(name);
    if (known) return known;
    const low = new Float64Array(this.capacity).fill(NaN);
    this.low.set(name, low);
    this.high.set(name, new Float64Array(this.capacity).fill(NaN));
    return low;
  }

  /** Place of a time in the ring, -1 if it is too old. */
  private place(time: number): number {
    const n = Math.floor((time - this.anchor + ROUNDING) / this.step);
    if (n < 0 || n <= this.newest - this.capacity) return -1;
    if (n > this.newest) this.advance(n);
    return n % this.capacity;
  }

  private advance(to: number): void {
    const first = Math.max(this.newest + 1, to - this.capacity + 1);
    for (const rows of [this.low, this.high]) {
      for (const row of rows.values()) {
        for (let n = first; n <= to; n++) row[n % this.capacity] = NaN;
      }
    }
    this.newest = to;
  }
}
