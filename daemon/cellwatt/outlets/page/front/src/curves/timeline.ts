/** The span of time that is shown: live, with an end that moves, or one of the past. */

export interface Span {
  from: number;
  to: number;
}

/** Spans to choose from, ms. */
export const SPANS = [10e3, 60e3, 600e3, 3600e3, 8 * 3600e3, 86_400e3, 7 * 86_400e3] as const;
const SHORTEST = 1000;
const LONGEST = 31 * 86_400e3;

export class Timeline {
  /** Span of the past, null while live. */
  past: Span | null = null;
  private lively: number;

  constructor(
    public width: number = 60e3,
    private readonly onchange: () => void = () => undefined,
  ) {
    this.lively = width;
  }

  get live(): boolean {
    return this.past === null;
  }

  /** The span that is shown where `now` is the time of the newest data. */
  shown(now: number): Span {
    return this.past ?? { from: now - this.width, to: now };
  }

  /** Show the last `width` ms, or as many around the middle of the past. */
  wide(width: number, now: number): void {
    const bounded = Math.min(LONGEST, Math.max(SHORTEST, width));
    if (this.past) {
      const middle = (this.past.from + this.past.to) / 2;
      this.show({ from: middle - bounded / 2, to: middle + bounded / 2 }, now);
      return;
    }
    this.width = this.lively = bounded;
    this.onchange();
  }

  /** Show a span of the past; what is still to come is not shown. */
  show(span: Span, now: number): void {
    const width = Math.min(LONGEST, Math.max(SHORTEST, span.to - span.from));
    const to = Math.min(now, Math.max(span.to, span.from + width));
    this.past = { from: to - width, to };
    this.width = width;
    this.onchange();
  }

  /** Move by a part of the width, negative into the past. */
  pan(part: number, now: number): void {
    const { from, to } = this.shown(now);
    const by = part * (to - from);
    if (to + by >= now && by > 0) this.follow();
    else this.show({ from: from + by, to: to + by }, now);
  }

  /** Show `factor` times as much. */
  zoom(factor: number, now: number): void {
    this.wide(this.width * factor, now);
  }

  /** Be live again, as wide as before. */
  follow(): void {
    this.past = null;
    this.width = this.lively;
    this.onchange();
  }
}
