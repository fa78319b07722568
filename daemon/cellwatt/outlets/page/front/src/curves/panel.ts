/** All charts of a cell on one axis of time: live, or a span of the past. */

import type { Cell } from '../cell';
import { Refused, type Span } from '../api';
import type { Clock } from '../clock';
import { h, put } from '../dom';
import { onColours } from '../palette';
import type { Alarm, Curves, Frames, Prediction, Values } from '../shapes';
import { t } from '../texts';
import { Buckets } from './buckets';
import { Chart } from './chart';
import { groups, powerGroup, type Group } from './lines';
import { Marks } from './marks';
import { Timeline } from './timeline';
import { toolbar } from './toolbar';

/** ms to wait for further changes before curves are read. */
const PATIENCE = 120;
/** ms beyond the newest data for which is asked while live: more may have come meanwhile. */
const AHEAD = 1000;
/** Shortest hole, ms, that is filled, and ms between two attempts. */
const [HOLE, HEALING] = [100, 3000];
/** Change of width, px, for which curves are read anew. */
const ENOUGH = 16;
/** ms between two descriptions of charts in words. */
const WORDS = 2000;
const FAST = 20;
const SLOW = 10;
/** Longest time, ms, that new data wait to be drawn: less than a step of the charts cannot be seen. */
const WAIT = 500;

export class Panel {
  readonly element = h('div', { class: 'curves' });
  readonly timeline: Timeline;
  readonly marks = new Marks();
  private readonly charts = h('div', { class: 'charts' });
  private readonly bar: ReturnType<typeof toolbar>;
  private list: Chart[] = [];
  private buckets: Buckets | null = null;
  private chosen: readonly string[] = [];
  private readonly waiting: [string, readonly number[], Values][] = [];
  private asking: AbortController | null = null;
  private timer = 0;
  private frame = 0;
  private newest = 0;
  private described = 0;
  private healed = 0;
  private asked = 0;
  private drawnAt = 0;
  private later = 0;
  private readonly ends: (() => void)[];

  constructor(
    private readonly cell: Cell,
    private readonly clock: () => Clock,
    width: number,
    private readonly onspan: (timeline: Timeline) => void,
  ) {
    this.timeline = new Timeline(width, () => this.turned());
    this.bar = toolbar(this.timeline, () => this.now);
    this.element.append(this.bar.element, this.charts, this.bar.alarms);
    const watcher = new ResizeObserver(() => this.resized());
    watcher.observe(this.charts);
    this.ends = [
      cell.on('frames', (frames) => this.takeFrames(frames)),
      cell.on('prediction', (prediction) => this.takePrediction(prediction)),
      cell.on('interval', (interval) => (this.marks.interval(interval), this.draw())),
      cell.on('alarm', ({ alarm }) => (this.marks.alarm(asMark(alarm)), this.draw())),
      cell.on('hole', () => ((this.newest = 0), this.ask())),
      onColours(() => this.list.forEach((chart) => chart.paint())),
      () => watcher.disconnect(),
    ];
  }

  /** Show the power and these channels. */
  show(chosen: readonly string[]): void {
    this.chosen = chosen;
    const state = this.cell.state;
    if (!state) return;
    const power = powerGroup(state, t('chart.power'), t('chart.measured'), t('chart.predicted'));
    const wanted = [...(power ? [power] : []), ...groups(state.channels, chosen)];
    this.list.forEach((chart) => chart.destroy());
    this.list = wanted.map((group, i) => this.chart(group, i === 0 && power !== null));
    put(this.charts, ...this.list.map((chart) => chart.element));
    if (!wanted.length) put(this.charts, h('p', { class: 'quiet' }, t('chart.none')));
    this.list.forEach((chart) => chart.fit());
    this.follow();
    this.ask();
    this.draw();
  }

  /** Show times in another zone. */
  retime(): void {
    this.show(this.chosen);
  }

  close(): void {
    this.ends.forEach((end) => end());
    this.asking?.abort();
    clearTimeout(this.timer);
    clearTimeout(this.later);
    cancelAnimationFrame(this.frame);
    this.list.forEach((chart) => chart.destroy());
  }

  private get now(): number {
    return this.newest || this.cell.newest || Date.now();
  }

  private get names(): string[] {
    return [...new Set(this.list.flatMap((chart) => chart.names))];
  }

  private chart(group: Group, first: boolean): Chart {
    const wishes = {
      span: (span: Span) => this.timeline.show(span, this.now),
      pan: (part: number) => this.timeline.pan(part, this.now),
      out: () => this.timeline.zoom(3, this.now),
      over: (time: number | null) => this.bar.over(time, this.marks, this.clock()),
    };
    return new Chart(group.title, group.unit, group.lines, this.marks, this.clock, wishes, first);
  }

  private turned(): void {
    this.onspan(this.timeline);
    this.follow();
    this.ask();
    this.draw();
  }

  private follow(): void {
    const streamed = this.names.filter((name) => !name.startsWith('prediction/'));
    this.cell.follow(streamed, this.timeline.live && this.timeline.width <= 60e3 ? FAST : SLOW);
  }

  private resized(): void {
    this.list.forEach((chart) => chart.fit());
    if (Math.abs((this.list[0]?.width ?? 0) - this.asked) > ENOUGH) this.ask();
    this.draw();
  }

  // data ---------------------------------------------------------------------------------------------

  private ask(): void {
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.read(), PATIENCE);
  }

  private async read(): Promise<void> {
    const names = this.names;
    if (!names.length || !this.cell.state) return;
    this.asking?.abort();
    const asking = (this.asking = new AbortController());
    const shown = this.timeline.shown(this.now);
    const span = this.timeline.live ? { from: shown.from, to: shown.to + AHEAD } : shown;
    const points = Math.round(this.list[0]?.width ?? 600);
    this.asked = points;
    this.waiting.length = 0;
    this.bar.busy(true);
    try {
      this.fill(await this.cell.api.curves(names, span, points, asking.signal), names, span, points);
    } catch (error) {
      if (!(error instanceof Refused)) return;
      this.bar.note(error.message || t('connection.lost'));
      const step = Math.max((span.to - span.from) / points, 1000 / FAST);
      this.buckets ??= new Buckets(step, span.from, (span.to - span.from) / step + 2, names);
    } finally {
      if (asking === this.asking) {
        this.asking = null;
        this.bar.busy(false);
      }
    }
    this.draw();
  }

  private fill(curves: Curves, names: readonly string[], span: Span, points: number): void {
    const width = span.to - span.from;
    const anchored = curves.t.length ? curves : { ...curves, t: [span.from], step_ms: Math.max(curves.step_ms, width / points) };
    this.buckets = Buckets.of(anchored, names, width);
    this.marks.intervals = curves.intervals;
    this.marks.alarms = curves.alarms;
    for (const [name, times, values] of this.waiting.splice(0)) this.buckets.add(name, times, values);
    const short = !curves.from_record && !this.cell.state?.record && width > 120e3;
    this.bar.note(short ? t('chart.no_record') : curves.complete ? '' : t('chart.incomplete'));
    this.bar.list(this.marks.alarms, this.clock());
  }

  private takeFrames(frames: Frames): void {
    this.heal(frames.t[0] ?? 0);
    this.newest = Math.max(this.newest, frames.t.at(-1) ?? 0);
    for (const [name, values] of Object.entries(frames.v)) this.take(name, frames.t, values);
  }

  /** Read anew what is missing between the curves and the first frames that came. */
  private heal(first: number): void {
    if (!this.buckets || !this.timeline.live || this.asking) return;
    const missing = first - this.buckets.end - this.buckets.step;
    if (missing < Math.max(2 * this.buckets.step, HOLE) || performance.now() - this.healed < HEALING) return;
    this.healed = performance.now();
    this.ask();
  }

  private takePrediction(prediction: Prediction): void {
    for (const [output, values] of Object.entries(prediction.v)) this.take(`prediction/${prediction.model}/${output}`, prediction.t, values);
  }

  private take(name: string, times: readonly number[], values: Values): void {
    if (!this.timeline.live) return;
    if (this.asking && this.waiting.length < 10_000) this.waiting.push([name, times, values]);
    this.buckets?.add(name, times, values);
    this.soon();
  }

  // drawing ------------------------------------------------------------------------------------------

  /** Draw new data, once they can be seen. */
  private soon(): void {
    if (this.later || this.frame) return;
    const wait = Math.min(WAIT, this.buckets?.step ?? 0) - (performance.now() - this.drawnAt);
    if (wait <= 0) return this.draw();
    this.later = window.setTimeout(() => this.draw(), wait);
  }

  private draw(): void {
    clearTimeout(this.later);
    this.later = 0;
    this.frame ||= requestAnimationFrame((at) => this.drawn(at));
  }

  private drawn(at: number): void {
    this.frame = 0;
    this.drawnAt = at;
    const span = this.timeline.shown(this.now);
    this.marks.live = this.timeline.live;
    for (const chart of this.list) {
      chart.draw(span, (out) => this.buckets?.draw(chart.names, span.from, span.to, out) ?? false);
    }
    this.bar.times(span, this.clock());
    if (at - this.described < WORDS) return;
    this.described = at;
    this.marks.forget(span.from);
    this.list.forEach((chart) => chart.describe());
    this.bar.list(this.marks.alarms, this.clock());
  }
}

function asMark(alarm: Alarm): { id: string; severity: Alarm['severity']; statement: string; raised: number; cleared: number | null } {
  const { id, severity, statement, since, active, time } = alarm;
  return { id, severity, statement, raised: since, cleared: active ? null : time };
}
