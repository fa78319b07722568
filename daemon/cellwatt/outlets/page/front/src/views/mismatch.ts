/** What the newest comparison of the cell with its simulation found. */

import { Refused } from '../api';
import { h, put, svg } from '../dom';
import { quantity } from '../numbers';
import type { Mismatch } from '../shapes';
import { t } from '../texts';
import type { CellView } from '../view';
import { when } from './reports';

/** Width of the longest bar, in hundredths of the drawing. */
const FULL = 100;

export const mismatchView: CellView = (root, cell, around) => {
  const found = h('div', { class: 'stack', 'aria-busy': 'true' }, h('p', { class: 'quiet' }, t('page.reading')));
  root.append(h('h1', {}, t('mismatch.title')), h('p', { class: 'quiet lead' }, t('mismatch.lead')), found);
  let told: Mismatch | null = null;
  const show = (): void => {
    if (told) put(found, ...card(told, when(told.made, (ms) => around.clock().moment(ms))));
    found.removeAttribute('aria-busy');
  };
  cell.api.mismatch().then(
    (answer) => {
      told = answer;
      show();
    },
    (error: unknown) => {
      if (error instanceof Refused) put(found, h('p', { class: 'problem', role: 'alert' }, error.message || t('connection.lost')));
    },
  );
  return { title: t('mismatch.title'), close: () => undefined, retime: show };
};

function card(told: Mismatch, made: string): HTMLElement[] {
  if (!told.finding) return [h('p', { class: 'card empty' }, t('mismatch.none'))];
  const effects = (told.effects ?? []).filter((effect) => effectText(effect));
  const link = told.href ? h('a', { class: 'button', href: told.href, target: '_blank', rel: 'noopener' }, t('mismatch.report')) : null;
  return [
    h(
      'section',
      { class: `card finding tone-${told.tone ?? 'part'}` },
      h('h2', {}, told.finding),
      made ? h('p', { class: 'quiet' }, t('mismatch.made', { made })) : null,
      link,
    ),
    told.before !== null && told.before !== undefined ? bars(told) : null,
    effects.length
      ? h('section', { class: 'card' }, h('h2', {}, t('mismatch.effects')), h('ul', { class: 'effects' }, ...effects.map((effect) => h('li', {}, effectText(effect), h('span', { class: 'quiet' }, gained(effect))))))
      : null,
  ].filter((element) => element !== null);
}

function bars(told: Mismatch): HTMLElement {
  const unit = told.unit ?? '';
  const rows = [
    [t('mismatch.before'), told.before, 'before'],
    [t('mismatch.after'), told.after, 'after'],
  ] as const;
  const most = Math.max(...rows.map(([, value]) => Math.abs(value ?? 0))) || 1;
  const list = rows.map(([label, value, name]) => {
    const width = (FULL * Math.abs(value ?? 0)) / most;
    const bar = svg('svg', { class: 'bar', viewBox: `0 0 ${FULL} 10`, preserveAspectRatio: 'none', 'aria-hidden': 'true' });
    bar.append(svg('rect', { class: 'track', width: FULL, height: 10 }), svg('rect', { class: name, width, height: 10 }));
    return h('div', { class: 'bar-row' }, h('dt', {}, label), h('dd', {}, bar, h('b', {}, quantity(value, unit))));
  });
  const title = told.channel ? t('mismatch.difference_in', { channel: told.channel }) : t('mismatch.difference');
  return h('section', { class: 'card' }, h('h2', {}, title), h('dl', { class: 'bars' }, ...list));
}

/** How much an effect explains, and how sure it is. */
function gained(effect: unknown): string {
  if (typeof effect !== 'object' || effect === null) return '';
  const { before, after, unit, channel, confidence } = effect as Record<string, unknown>;
  const said: string[] = [];
  if (typeof before === 'number' && typeof after === 'number') {
    const shown = { channel: String(channel ?? ''), before: quantity(before, String(unit ?? '')), after: quantity(after, String(unit ?? '')) };
    said.push(t('mismatch.gain', shown));
  }
  if (typeof confidence === 'number') said.push(t('mismatch.sure', { percent: Math.round(100 * confidence) }));
  return said.join('  ·  ');
}

/** An effect in words: a text, or an object that tells one. */
export function effectText(effect: unknown): string {
  if (typeof effect === 'string') return effect;
  if (typeof effect !== 'object' || effect === null) return '';
  const told = effect as Record<string, unknown>;
  if (typeof told['statement'] === 'string' && told['statement']) return told['statement'];
  const name = String(told['effect'] ?? told['name'] ?? '').replaceAll('_', ' ');
  return typeof told['joint'] === 'number' ? t('mismatch.effect_of', { name, joint: told['joint'] }) : name;
}
