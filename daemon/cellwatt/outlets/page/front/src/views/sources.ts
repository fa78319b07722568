/** Sources of a cell: rate, what came, what was lost, and how far its clocks are known. */

import type { Cell } from '../cell';
import { h, put } from '../dom';
import { count, figure } from '../numbers';
import type { Source } from '../shapes';
import { t, type Key } from '../texts';
import { Ends } from '../view';

const STATES: Readonly<Record<string, Key>> = { ok: 'source.ok', starting: 'source.starting', retrying: 'source.retrying' };
const TONES: Readonly<Record<string, string>> = { ok: 'green', starting: 'amber', retrying: 'red' };
/** Looks at health, one a second, between two readings of the table. */
const EVERY = 2;

export function sourcesCard(cell: Cell): { element: HTMLElement; close(): void } {
  const rows = h('tbody');
  const heads = (['source.name', 'source.rate', 'source.received', 'source.lost', 'source.clock'] as const).map((key, i) =>
    h('th', { scope: 'col', class: i ? 'number' : '' }, t(key)),
  );
  const element = h(
    'section',
    { class: 'card', 'aria-labelledby': 'sources-title' },
    h('h2', { id: 'sources-title' }, t('source.title')),
    h('div', { class: 'wide', tabindex: 0, role: 'group', 'aria-labelledby': 'sources-title' }, h('table', { class: 'sources' }, h('thead', {}, h('tr', {}, ...heads)), rows)),
  );
  let looks = 0;
  const show = (): void => put(rows, ...Object.entries(cell.state?.status.sources ?? {}).flatMap(([name, source]) => lines(name, source)));
  const ends = new Ends();
  ends.add(
    cell.on('state', show),
    cell.on('health', () => {
      if (looks++ % EVERY === 0) show();
    }),
  );
  show();
  return { element, close: () => ends.call() };
}

function lines(name: string, source: Source): HTMLElement[] {
  const lost = sum(source.missed) + sum(source.dropped);
  const streams = Object.entries(source.streams);
  const word = STATES[source.state];
  const state = h('span', { class: `dot ${TONES[source.state] ?? 'amber'}` }, word ? t(word) : source.state);
  const rates = streams.map(([, figures]) => (figures.rate_hz === null ? '–' : `${figure(figures.rate_hz, 4)} Hz`));
  const bounds = streams.map(([stream]) => {
    const clock = source.clocks[stream];
    return clock ? `± ${figure(clock.bound_ns * 1e-6, 2)} ms` : t('source.half_trip');
  });
  const cells = [
    h('th', { scope: 'row' }, name, state),
    h('td', { class: 'number' }, stacked(rates)),
    h('td', { class: 'number' }, count(source.received)),
    h('td', { class: `number ${lost ? 'bad' : 'good'}` }, count(lost)),
    h('td', { class: 'number' }, stacked(bounds)),
  ];
  const found = [h('tr', {}, ...cells)];
  if (source.error) found.push(h('tr', { class: 'source-error' }, h('td', { colspan: 5 }, source.error)));
  return found;
}

function stacked(texts: readonly string[]): HTMLElement {
  return h('span', { class: 'stacked-cell' }, ...(texts.length ? texts : ['–']).map((text) => h('span', {}, text)));
}

function sum(counts: Readonly<Record<string, number>>): number {
  return Object.values(counts).reduce((total, n) => total + n, 0);
}
