/** Figures that an alarm rests on: those with a limit as bars against it, all as a table. */

import { h, svg } from './dom';
import { figure } from './numbers';
import { t } from './texts';

export interface Compared {
  key: string;
  value: number;
  limit: number;
}

const LIMITS = ['limit', 'tolerance', 'threshold'];
const UNITS: Readonly<Record<string, string>> = {
  W: 'W', J: 'J', A: 'A', V: 'V', s: 's', ms: 'ms', us: 'µs', ns: 'ns', rad: 'rad', Nm: 'Nm', hz: 'Hz', percent: '%', C: '°C', deg: '°', N: 'N', m: 'm',
};
const HALF = 50;

/** Figures that have a limit: `residual_W` beside `limit_W`, `power_residual_W` beside `power_limit_W`. */
export function compared(evidence: Readonly<Record<string, unknown>>): Compared[] {
  return Object.keys(evidence).flatMap((key) => {
    const value = evidence[key];
    if (typeof value !== 'number' || !key.includes('residual')) return [];
    const limit = LIMITS.map((word) => evidence[key.replace('residual', word)]).find((found) => typeof found === 'number');
    return limit === undefined || limit === 0 ? [] : [{ key, value, limit: limit as number }];
  });
}

/** Name and unit of a key: `position_residual_rad` is `position residual` in rad. */
export function named(key: string): [string, string] {
  const cut = key.lastIndexOf('_');
  const unit = cut > 0 ? UNITS[key.slice(cut + 1)] : undefined;
  return unit ? [key.slice(0, cut).replaceAll('_', ' '), unit] : [key.replaceAll('_', ' '), ''];
}

/** The figures of an alarm, null where it has none. */
export function evidenceTable(evidence: Readonly<Record<string, unknown>>): HTMLElement | null {
  const against = compared(evidence);
  const limits = new Set(against.flatMap(({ key }) => LIMITS.map((word) => key.replace('residual', word))));
  const rows = Object.entries(evidence).flatMap(([key, value]) => {
    const bar = against.find((one) => one.key === key);
    if (limits.has(key)) return [];
    const [name, unit] = named(key);
    const shown = bar ? versus(bar, unit) : h('span', {}, text(value, unit));
    return [h('tr', {}, h('th', { scope: 'row' }, name), h('td', {}, shown))];
  });
  return rows.length ? h('table', { class: 'evidence' }, h('caption', { class: 'hidden' }, t('alarm.evidence')), h('tbody', {}, ...rows)) : null;
}

/** The value as a bar; its limit is a mark at half of the width, or less where the value is far beyond. */
function versus({ value, limit }: Compared, unit: string): HTMLElement {
  const scale = Math.max(2 * Math.abs(limit), Math.abs(value));
  const width = (2 * HALF * Math.abs(value)) / scale;
  const at = (2 * HALF * Math.abs(limit)) / scale;
  const beyond = Math.abs(value) > Math.abs(limit);
  const drawing = svg(
    'svg',
    { class: 'bar against', viewBox: '0 0 100 10', preserveAspectRatio: 'none', 'aria-hidden': 'true' },
    svg('rect', { class: 'track', width: 100, height: 10 }),
    svg('rect', { class: beyond ? 'beyond' : 'within', width, height: 10 }),
    svg('rect', { class: 'limit', x: Math.min(99.2, at), width: 0.8, height: 10 }),
  );
  return h('span', { class: 'versus' }, drawing, h('b', {}, text(value, unit)), h('span', { class: 'quiet' }, t('alarm.limit', { limit: text(limit, unit) })));
}

function text(value: unknown, unit: string): string {
  if (typeof value === 'number') {
    const text = Number.isInteger(value) && Math.abs(value) < 1e6 ? String(value) : figure(value);
    return unit ? `${text} ${unit}` : text;
  }
  if (typeof value === 'string' || typeof value === 'boolean') return String(value);
  if (Array.isArray(value)) return value.map((one) => text(one, unit)).join(', ');
  if (value === null || value === undefined) return '–';
  const fields = value as Record<string, unknown>;
  if (typeof fields['statement'] === 'string') return fields['statement'];
  return Object.entries(fields).map(([key, one]) => `${key.replaceAll('_', ' ')} ${text(one, '')}`).join(', ');
}
