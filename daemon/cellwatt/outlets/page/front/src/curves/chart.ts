/** One chart: some series of one unit over time, with a legend that tells values. */

import uPlot from 'uplot';

import type { Clock } from '../clock';
import { h, mark, say } from '../dom';
import { onScale } from '../numbers';
import { colour } from '../palette';
import { t } from '../texts';
import type { Aligned } from './buckets';
import { drawColumns } from './columns';
import type { Marks } from './marks';
import type { Span } from './timeline';

export interface Line {
  /** Channel. */
  name: string;
  label: string;
  /** Name of its colour. */
  colour: string;
  dashed?: boolean;
}

export interface Wishes {
  /** A span was drawn with the pointer. */
  span(span: Span): void;
  /** To the side, as a part of the width. */
  pan(part: number): void;
  /** Show more. */
  out(): void;
  /** Time under the pointer, null if it has left. */
  over(time: number | null): void;
}

const SYNC = 'cell';
/** Heights of the first chart and of others, px. */
const [HIGH, LOW] = [260, 210];
/** px of a drag below which it is a click. */
const DRAG = 8;
/** Width of a step, px, up to which it is drawn as a column. */
const FINE = 2.2;
/** Points before the one that is asked for among which a value is looked for. */
const AROUND = 10;
const LINEAR = uPlot.paths.linear!();

export class Chart {
  readonly element: HTMLElement;
  private readonly host = h('div', { class: 'plot' });
  private readonly values: HTMLElement[];
  private readonly data: Aligned = [[]];
  private readonly plot: uPlot;
  private at: number | null = null;
  private ranges = false;

  constructor(
    private readonly title: string,
    private readonly unit: string,
    readonly lines: readonly Line[],
    private readonly marks: Marks,
    clock: () => Clock,
    private readonly wishes: Wishes,
    private readonly first: boolean,
  ) {
    this.values = lines.map(() => h('span', { class: 'value' }));
    const legend = lines.map((line, i) =>
      h('li', { title: line.name }, h('i', { class: `swatch ${line.colour}${line.dashed ? ' dashed' : ''}` }), line.label, this.values[i]),
    );
    const head = h('div', { class: 'chart-head' }, h('h3', {}, title, unit ? h('span', { class: 'unit' }, unit) : null));
    head.append(h('ul', { class: 'legend' }, ...legend));
    this.element = h('section', { class: 'chart' }, head, this.host);
    mark(this.host, 'role', 'img');
    this.describe();
    this.plot = new uPlot(this.options(clock, first ? HIGH : LOW), this.data as unknown as uPlot.AlignedData, this.host);
    this.touch();
  }

  /** Channels of the lines. */
  get names(): string[] {
    return this.lines.map((line) => line.name);
  }

  /** Width of the drawing, px. */
  get width(): number {
    return Math.max(50, this.plot.bbox.width / devicePixelRatio);
  }

  /** Take the width of the surroundings. */
  fit(): void {
    const width = this.host.clientWidth;
    if (width > 0 && width !== this.plot.width) this.plot.setSize({ width, height: this.plot.height });
  }

  /** Draw a span; `fill` writes its data into the given arrays, and tells if they are pairs of least and most. */
  draw(span: Span, fill: (out: Aligned) => boolean): void {
    this.ranges = fill(this.data);
    this.plot.batch(() => {
      this.plot.setData(this.data as unknown as uPlot.AlignedData, false);
      this.plot.setScale('x', { min: span.from, max: span.to });
    });
    this.tell();
  }

  /** Take other colours. */
  paint(): void {
    this.plot.redraw(false, true);
  }

  /** Tell the chart in words. */
  describe(): void {
    const values = this.lines.map((line, i) => `${line.label} ${this.values[i]?.textContent ?? ''}`);
    mark(this.host, 'aria-label', t('chart.alternative', { title: this.title, values: values.join(', ') }));
  }

  destroy(): void {
    this.plot.destroy();
  }

  private options(clock: () => Clock, height: number): uPlot.Options {
    const axis = { stroke: () => colour('quiet'), font: '12px system-ui, sans-serif' };
    const grid = { stroke: () => colour('grid'), width: 1 };
    return {
      width: Math.max(200, this.host.clientWidth || 600),
      height,
      ms: 1,
      legend: { show: false },
      padding: [8, 30, 0, 0],
      scales: { x: { time: true, auto: false }, y: { range: (_u, low, high) => range(low, high) } },
      axes: [
        { ...axis, grid, ticks: grid, size: 28, space: 72, values: (_u, at, _axis, _space, step) => clock().ticks(at, step) },
        { ...axis, grid, ticks: { show: false }, size: 56, values: (_u, at) => at.map((v) => compact(v)) },
      ],
      series: [
        {},
        ...this.lines.map((line) => ({
          stroke: () => colour(line.colour),
          width: 1.6,
          points: { show: false },
          paths: (u: uPlot, i: number, first: number, last: number) =>
            this.fine(u) ? null : LINEAR(u, i, first, last),
          ...(line.dashed ? { dash: [7, 4] } : {}),
        })),
      ],
      tzDate: (ms) => (clock().utc ? uPlot.tzDate(new Date(ms), 'Etc/UTC') : new Date(ms)),
      cursor: {
        y: false,
        sync: { key: SYNC, setSeries: false },
        drag: { x: true, y: false, setScale: false, dist: DRAG },
        points: { size: 7 },
        bind: { dblclick: () => () => (this.wishes.out(), null) },
      },
      hooks: {
        drawClear: [(u) => this.marks.under(u, this.first)],
        drawSeries: [(u, i) => this.columns(u, i)],
        draw: [(u) => this.marks.over(u)],
        setSelect: [(u) => this.selected(u)],
        setCursor: [(u) => this.pointed(u)],
      },
    };
  }

  private columns(u: uPlot, series: number): void {
    const line = this.lines[series - 1];
    if (line && this.fine(u)) drawColumns(u, series, { colour: line.colour, dashed: line.dashed ?? false, pairs: this.ranges });
  }

  /** True if steps are so narrow that columns of pixels are a line. */
  private fine(u: uPlot): boolean {
    const times = this.data[0];
    const { min, max } = u.scales['x'] ?? {};
    const step = ((times[1] ?? 0) - (times[0] ?? 0)) * (this.ranges ? 2 : 1);
    return step * this.width <= FINE * ((max ?? 0) - (min ?? 0));
  }

  private selected(u: uPlot): void {
    const { left, width } = u.select;
    if (width < DRAG) return;
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.wishes.span({ from: u.posToVal(left, 'x'), to: u.posToVal(left + width, 'x') });
  }

  private pointed(u: uPlot): void {
    const left = u.cursor.left ?? -1;
    this.at = left >= 0 ? (u.cursor.idx ?? null) : null;
    this.wishes.over(left >= 0 ? u.posToVal(left, 'x') : null);
    this.tell();
  }

  /** Values at the pointer, else the newest. */
  private tell(): void {
    this.values.forEach((element, i) => {
      const values = this.data[i + 1] ?? [];
      const last = this.at ?? values.length - 1;
      const first = this.at === null ? last - Math.max(AROUND, values.length / 10) : last - AROUND;
      let n = last;
      while (n > 0 && n > first && typeof values[n] !== 'number') n--;
      say(element, onScale(values[n], this.unit, this.plot.scales['y']));
    });
  }

  /** Drag with a finger moves through time; up and down still scrolls the page. */
  private touch(): void {
    let from: number | null = null;
    const over = this.plot.over;
    over.addEventListener('pointerdown', (e) => (from = e.pointerType === 'touch' ? e.clientX : null));
    over.addEventListener('pointercancel', () => (from = null));
    over.addEventListener('pointerup', (e) => {
      if (from !== null && Math.abs(e.clientX - from) > DRAG) this.wishes.pan((from - e.clientX) / this.width);
      from = null;
    });
  }
}

function range(low: number | null, high: number | null): [number, number] {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [0, 1];
  const [from, to] = uPlot.rangeNum(low, high, 0.1, true);
  return [from ?? 0, to ?? 1];
}

function compact(value: number): string {
  const size = Math.abs(value);
  if (size >= 1e4) return `${+(value / 1e3).toPrecision(4)}k`;
  return String(+value.toPrecision(6));
}
