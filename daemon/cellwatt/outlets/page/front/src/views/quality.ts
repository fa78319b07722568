/** Quality of the frames: the worst of each channel that is followed, and what the recorder does. */

import type { Cell } from '../cell';
import { h, put } from '../dom';
import { count } from '../numbers';
import { t, type Key } from '../texts';
import { Ends } from '../view';

const QUALITIES: readonly Key[] = ['quality.good', 'quality.interpolated', 'quality.late', 'quality.clipped', 'quality.missing'];
const TONES = ['green', 'green', 'amber', 'amber', 'red'];
const PERIOD = 1000;

export function qualityCard(cell: Cell): { element: HTMLElement; close(): void } {
  const list = h('ul', { class: 'quality' });
  const facts = h('p', { class: 'quiet' });
  const element = h('section', { class: 'card', 'aria-labelledby': 'quality-title' }, h('h2', { id: 'quality-title' }, t('quality.title')), list, facts);
  let shown = '';
  const show = (): void => {
    const worst = QUALITIES.map((_, level) => [...cell.quality].filter(([, q]) => q === level).map(([name]) => name));
    const frames = cell.state?.status.frames?.count ?? 0;
    const recorder = cell.state?.status.recorder;
    const text = [t('quality.frames', { n: count(frames) }), recorder ? t('quality.recorder', { state: recorder.state }) : t('quality.no_record')].join('  ·  ');
    const key = JSON.stringify([worst, text]);
    if (key === shown) return;
    shown = key;
    const rows = worst.map((names, level) => {
      if (!names.length) return null;
      const which = level >= 2 ? h('span', { class: 'quiet' }, names.join(', ')) : null;
      return h('li', {}, h('span', { class: `dot ${TONES[level]}` }, t(QUALITIES[level] as Key)), h('b', {}, names.length), which);
    });
    put(list, ...rows);
    put(facts, text);
  };
  const timer = setInterval(show, PERIOD);
  const ends = new Ends();
  ends.add(cell.on('state', show), () => clearInterval(timer));
  show();
  return { element, close: () => ends.call() };
}
