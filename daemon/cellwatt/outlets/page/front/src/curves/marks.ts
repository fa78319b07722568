/** Intervals as coloured bands and alarms as lines, on the time axis of a chart. */

import type uPlot from 'uplot';

import { colour, pale } from '../palette';
import type { AlarmMark, Interval } from '../shapes';

/** Narrower bands, px, are left out: they would only blur the picture. */
const NARROWEST = 3;
const STRIP = 6;
const SERIES = 8;

export class Marks {
  intervals: Interval[] = [];
  alarms: AlarmMark[] = [];
  /** True while the right edge is now: there the last interval of each source still runs, if it is open. */
  live = true;

  /** Take an interval that has begun, gone on or ended. */
  interval(interval: Interval): void {
    const before = this.intervals.findLastIndex((i) => i.source === interval.source && i.number === interval.number);
    if (before >= 0) this.intervals[before] = interval;
    else this.intervals.push(interval);
  }

  /** Take an alarm that was raised, changed or cleared; the record may know it with another time of its raise. */
  alarm(alarm: AlarmMark): void {
    const place = this.alarms.findLastIndex((a) => a.id === alarm.id && (a.cleared === null || a.cleared >= alarm.raised));
    const before = this.alarms[place];
    if (before) this.alarms[place] = { ...before, severity: alarm.severity, cleared: alarm.cleared };
    else this.alarms.push(alarm);
  }

  /** Forget what ended before a time, ms. */
  forget(before: number): void {
    this.intervals = this.intervals.filter((i) => !i.closed || i.end >= before);
    this.alarms = this.alarms.filter((a) => a.cleared === null || a.cleared >= before);
  }

  /** Interval that runs at a time. */
  at(time: number): Interval | undefined {
    return this.intervals.findLast((i) => i.start <= time && time <= i.end);
  }

  /** Alarm whose line is within `near` ms of a time. */
  close(time: number, near: number): AlarmMark | undefined {
    return this.alarms.find((a) => Math.abs(a.raised - time) <= near);
  }

  /** Draw the bands, before the curves; `named` with the joints that move. */
  under(u: uPlot, named: boolean): void {
    const { ctx, bbox } = u;
    ctx.save();
    const running = this.live ? last(this.intervals) : null;
    for (const interval of this.intervals) {
      if (!interval.moving.length) continue;
      const open = !interval.closed && running?.get(interval.source) === interval;
      const [left, right] = inside(u, interval.start, open ? Infinity : interval.end);
      if (right - left < NARROWEST) continue;
      const name = `series-${Math.max(...interval.moving) % SERIES}`;
      ctx.fillStyle = pale(name, 0.09);
      ctx.fillRect(left, bbox.top, right - left, bbox.height);
      ctx.fillStyle = pale(name, 0.75);
      ctx.fillRect(left, bbox.top, right - left - 1, STRIP);
      if (named) this.name(u, interval.moving.join('+'), left, right);
    }
    ctx.restore();
  }

  private name(u: uPlot, text: string, left: number, right: number): void {
    const { ctx, bbox } = u;
    ctx.font = `600 ${11 * devicePixelRatio}px system-ui, sans-serif`;
    if (ctx.measureText(text).width + 6 > right - left) return;
    ctx.fillStyle = colour('quiet');
    ctx.textAlign = 'center';
    ctx.textBaseline = 'top';
    ctx.fillText(text, (left + right) / 2, bbox.top + STRIP + 3);
  }

  /** Draw the lines, over the curves. */
  over(u: uPlot): void {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.setLineDash([]);
    for (const alarm of this.alarms) {
      const [left, right] = inside(u, alarm.raised, alarm.cleared ?? Infinity);
      const name = alarm.severity === 'error' ? 'red' : alarm.severity === 'warning' ? 'amber-line' : 'accent';
      if (right > left) {
        ctx.fillStyle = pale(name, 0.8);
        ctx.fillRect(left, bbox.top + bbox.height - STRIP / 2, right - left, STRIP / 2);
      }
      const x = u.valToPos(alarm.raised, 'x', true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.fillStyle = ctx.strokeStyle = colour(name);
      ctx.lineWidth = 2;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.beginPath();
      ctx.moveTo(x - 7, bbox.top);
      ctx.lineTo(x + 7, bbox.top);
      ctx.lineTo(x, bbox.top + 10);
      ctx.fill();
    }
    ctx.restore();
  }
}

/** The interval of each source that began last. */
function last(intervals: readonly Interval[]): Map<string, Interval> {
  const found = new Map<string, Interval>();
  for (const one of intervals) if (one.start >= (found.get(one.source)?.start ?? -Infinity)) found.set(one.source, one);
  return found;
}

function inside(u: uPlot, from: number, to: number): [number, number] {
  const { left, width } = u.bbox;
  const [a, b] = [u.valToPos(from, 'x', true), Number.isFinite(to) ? u.valToPos(to, 'x', true) : left + width];
  return [Math.max(left, Math.min(left + width, a)), Math.max(left, Math.min(left + width, b))];
}
