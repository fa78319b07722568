/** Times of day and spans, local or UTC. */

import { t } from './texts';

const DAY = 86_400_000;
const pad = (n: number, width = 2): string => String(n).padStart(width, '0');

/** Shows times in one zone. */
export class Clock {
  constructor(readonly utc: boolean) {}

  /** `14:03:21`, with `digits` after the second. */
  time(ms: number, digits = 0): string {
    const [, , , h, m, s, rest] = this.fields(ms);
    const base = `${pad(h)}:${pad(m)}:${pad(s)}`;
    return digits ? `${base}.${pad(rest, 3).slice(0, digits)}` : base;
  }

  /** `14:03`. */
  minute(ms: number): string {
    return this.time(ms).slice(0, 5);
  }

  /** `2026-11-24`. */
  date(ms: number): string {
    const [y, month, d] = this.fields(ms);
    return `${y}-${pad(month)}-${pad(d)}`;
  }

  /** Time of day, with the date before it unless that is today's. */
  moment(ms: number, now = Date.now()): string {
    return this.date(ms) === this.date(now) ? this.time(ms) : `${this.date(ms)} ${this.time(ms)}`;
  }

  /** Marks of an axis whose steps are `step` ms. */
  ticks(at: readonly number[], step: number): string[] {
    let before = '';
    return at.map((ms) => {
      if (step >= DAY) return this.date(ms).slice(5);
      const shown = step >= 60_000 ? this.minute(ms) : step >= 1000 ? this.time(ms) : this.time(ms, step >= 100 ? 1 : 3);
      const day = this.date(ms).slice(5);
      const first = before !== '' && day !== before;
      before = day;
      return first ? `${day} ${shown}` : shown;
    });
  }

  /** Name of the zone. */
  get zone(): string {
    return this.utc ? 'UTC' : t('time.local');
  }

  private fields(ms: number): [number, number, number, number, number, number, number] {
    const d = new Date(ms);
    return this.utc
      ? [d.getUTCFullYear(), d.getUTCMonth() + 1, d.getUTCDate(), d.getUTCHours(), d.getUTCMinutes(), d.getUTCSeconds(), d.getUTCMilliseconds()]
      : [d.getFullYear(), d.getMonth() + 1, d.getDate(), d.getHours(), d.getMinutes(), d.getSeconds(), d.getMilliseconds()];
  }
}

/** A span in its largest unit: `12 min`. */
export function span(ms: number): string {
  const s = Math.max(0, ms) / 1000;
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 99.5) return `${Math.round(s)} s`;
  if (s < 5940) return `${Math.round(s / 60)} min`;
  if (s < 172_000) return `${Math.round(s / 3600)} h`;
  return `${Math.round(s / 86_400)} d`;
}
