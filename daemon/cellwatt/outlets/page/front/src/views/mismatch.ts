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
  let mismatch: Mismatch | null = null;
  const show = (): void => {
    if (mismatch) put(found, ...card(mismatch, when(mismatch.made, (ms) => around.clock().moment(ms))));
    found.removeAttribute('aria-busy');
  };
  cell.api.mismatch().then(
    (answer) => {
      mismatch = answer;
      show();
    },
    (error: unknown) => {
      if (error instanceof Refused) put(found, h('p', { class: 'problem', role: 'alert' }, error.message || t('connection.lost')));
    },
  );
  return { title: t('mismatch.title'), close: () => undefined, retime: show };
};

function card(mismatch: Mismatch, made: string): HTMLElement[] {
  if (!mismatch.finding) return [h('p', { class: 'card empty' }, t('mismatch.none'))];
  const effects = (mismatch.effects ?? []).filter((effect) => effectText(effect));
  const link = mismatch.href ? h('a', { class: 'button', href: mismatch.href, target: '_blank', rel: 'noopener' }, t('mismatch.report')) : null;
  return [
    h(
      'section',
      { class: `card finding tone-${mismatch.tone ?? 'part'}` },
      h('h2', {}, mismatch.finding),
      made ? h('p', { class: 'quiet' }, t('mismatch.made', { made })) : null,
      link,
    ),
    mismatch.before !== null && mismatch.before !== undefined ? bars(mismatch) : null,
    effects.length
      ? h('section', { class: 'card' }, h('h2', {}, t('mismatch.effects')), h('ul', { class: 'effects' }, ...effects.map((effect) => h('li', {}, effectText(effect), h('span', { class: 'quiet' }, gained(effect))))))
      : null,
  ].filter((element) => element !== null);
}

function bars(mismatch: Mismatch): HTMLElement {
  const unit = mismatch.unit ?? '';
  const rows = [
    [t('mismatch.before'), mismatch.before, 'before'],
    [t('mismatch.after'), mismatch.after, 'after'],
  ] as const;
  const most = Math.max(...rows.map(([, value]) => Math.abs(value ?? 0))) || 1;
  const list = rows.map(([label, value, name]) => {
    const width = (FULL * Math.abs(value ?? 0)) / most;
    const bar = svg('svg', { class: 'bar', viewBox: `0 0 ${FULL} 10`, preserveAspectRatio: 'none', 'aria-hidden': 'true' });
    bar.append(svg('rect', { class: 'track', width: FULL, height: 10 }), svg('rect', { class: name, width, height: 10 }));
    return h('div', { class: 'bar-row' }, h('dt', {}, label), h('dd', {}, bar, h('b', {}, quantity(value, unit))));
  });
  const title = mismatch.channel ? t('mismatch.difference_in', { channel: mismatch.channel }) : t('mismatch.difference');
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
  const fields = effect as Record<string, unknown>;
  if (typeof fields['statement'] === 'string' && fields['statement']) return fields['statement'];
  const name = String(fields['effect'] ?? fields['name'] ?? '').replaceAll('_', ' ');
  return typeof fields['joint'] === 'number' ? t('mismatch.effect_of', { name, joint: fields['joint'] }) : name;
}
