/** A cell at a glance: its state, what it does now, its power, curves, arm and sources. */

import { ArmFigure } from '../arm/figure';
import { MOST, firstChoice } from '../curves/lines';
import { Panel } from '../curves/panel';
import type { Timeline } from '../curves/timeline';
import { h, put } from '../dom';
import { keepChannels, keptChannels } from '../prefs';
import { asked, note } from '../router';
import { t } from '../texts';
import { Ends, type CellView } from '../view';
import { alarmStrip } from './alarm_strip';
import { nowCards } from './now';
import { Picker } from './picker';
import { qualityCard } from './quality';
import { sourcesCard } from './sources';

const DEFAULT_SPAN = 60;

export const overviewView: CellView = (root, cell, around) => {
  const ends = new Ends();
  const key = `${cell.site}/${cell.name}`;
  const panel = new Panel(cell, around.clock, 1000 * (Number(asked('span')) || DEFAULT_SPAN), noteSpan);
  const picker = new Picker(MOST, (chosen) => {
    keepChannels(key, chosen);
    note({ channels: chosen.join(',') });
    panel.show(chosen);
  });
  const arms = h('div', { class: 'stack' });
  const now = nowCards(cell);
  const strip = alarmStrip(cell, around);
  const quality = qualityCard(cell);
  const sources = sourcesCard(cell);
  root.append(
    h('h1', { class: 'hidden' }, t('overview.title', { cell: cell.name })),
    now.element,
    strip.element,
    h(
      'div',
      { class: 'columns' },
      h('section', { class: 'card curves-card', 'aria-labelledby': 'curves-title' }, h('div', { class: 'head' }, h('h2', { id: 'curves-title' }, t('chart.title')), picker.element), panel.element),
      h('div', { class: 'side' }, arms, sources.element, quality.element),
    ),
  );

  let figures: ArmFigure[] = [];
  let [layout, shape] = ['', ''];
  const laidOut = (): void => {
    const state = cell.state;
    if (!state) return;
    const found = JSON.stringify([state.channels, state.predictions, state.arms]);
    if (found === layout) return;
    layout = found;
    const wanted = asked('channels')?.split(',').filter(Boolean) ?? keptChannels(key) ?? firstChoice(state.channels);
    const chosen = wanted.filter((name) => state.channels.some((c) => c.name === name)).slice(0, MOST);
    picker.offer(state.channels, chosen);
    panel.show(chosen);
    const arm = JSON.stringify(state.arms);
    if (arm === shape) return;
    shape = arm;
    figures.forEach((figure) => figure.close());
    figures = state.arms.map((one) => new ArmFigure(cell, one));
    put(arms, ...figures.map((figure, i) => h('section', { class: 'card arm-card' }, h('h2', {}, t('arm.title', { name: state.arms[i]?.source ?? '' })), figure.element)));
  };
  document.addEventListener('pointerdown', picker.elsewhere);
  ends.add(
    cell.on('state', laidOut),
    () => document.removeEventListener('pointerdown', picker.elsewhere),
    () => figures.forEach((figure) => figure.close()),
    () => panel.close(),
    now.close,
    strip.close,
    quality.close,
    sources.close,
  );
  const from = Number(asked('from'));
  const to = Number(asked('to'));
  if (from && to > from) panel.timeline.show({ from, to }, Math.max(Date.now(), to));
  laidOut();
  return { title: cell.name, close: () => ends.call(), retime: () => panel.retime() };
};

function noteSpan(timeline: Timeline): void {
  const past = timeline.past;
  note({
    span: timeline.live ? String(timeline.width / 1000) : null,
    from: past ? String(Math.round(past.from)) : null,
    to: past ? String(Math.round(past.to)) : null,
  });
}
