/** Energy of each task by consumer, repetition for repetition, and what would save some. */

import { h, put, svg } from '../dom';
import { figure, quantity } from '../numbers';
import type { Alarm, Energy } from '../shapes';
import { t } from '../texts';
import { Ends, type CellView } from '../view';
import { stack } from './stack';

const ADVICE = 'energy_advice';
const SHOWN = 40;
const COLOURS = 8;
const [WIDE, HIGH] = [1000, 220];

export const energyView: CellView = (root, cell, around) => {
  const ends = new Ends();
  const advice = h('div');
  const tasks = h('div', { class: 'stack' });
  root.append(h('h1', {}, t('energy.title')), h('p', { class: 'quiet lead' }, t('energy.lead')), advice, tasks);
  const show = (): void => {
    put(advice, adviceCard(cell.ranked().filter((alarm) => alarm.kind.startsWith(ADVICE))));
    const energies = Object.entries(cell.state?.energies ?? {}).filter(([, done]) => done.length);
    const cards = energies.map(([task, done]) => taskCard(task, done.slice(-SHOWN), (ms) => around.clock().moment(ms)));
    put(tasks, ...cards, cards.length || !cell.state ? null : h('p', { class: 'card empty' }, t('energy.none')));
  };
  ends.add(
    cell.on('state', show),
    cell.on('energy', show),
    cell.on('alarm', ({ alarm }) => alarm.kind.startsWith(ADVICE) && show()),
  );
  show();
  return { title: t('energy.title'), close: () => ends.call(), retime: show };
};

function adviceCard(alarms: readonly Alarm[]): HTMLElement | null {
  if (!alarms.length) return null;
  const saving = (alarm: Alarm): number => Number(alarm.evidence['saving_J'] ?? 0);
  const rows = [...alarms]
    .sort((a, b) => saving(b) - saving(a))
    .map((alarm) =>
      h('li', {}, h('b', { class: 'saving' }, quantity(saving(alarm), 'J')), h('span', {}, h('span', { class: 'quiet' }, t('energy.each')), ' ', alarm.statement)),
    );
  return h('section', { class: 'card advice' }, h('h2', {}, t('energy.advice')), h('ul', {}, ...rows));
}

function taskCard(task: string, done: readonly Energy[], moment: (ms: number) => string): HTMLElement {
  const last = done.at(-1) as Energy;
  const mean = done.reduce((sum, energy) => sum + energy.total, 0) / done.length;
  const names = groupNames(done);
  const tiles: [string, string, string?][] = [
    [t('energy.last'), quantity(last.total, 'J'), `± ${quantity(last.uncertainty, 'J')}`],
    [t('energy.mean'), quantity(mean, 'J')],
    [t('energy.per_part'), quantity(last.total_per_part, 'J')],
    [t('energy.efficiency'), `${figure(last.motion_efficiency_percent)} %`],
  ];
  return h(
    'section',
    { class: 'card task' },
    h('div', { class: 'head' }, h('h2', {}, task.replaceAll('_', ' ')), h('span', { class: 'quiet' }, last.variant)),
    h('dl', { class: 'figures' }, ...tiles.map(([name, value, more]) => h('div', {}, h('dt', {}, name), h('dd', {}, value, more ? h('small', {}, ` ${more}`) : null)))),
    drawing(task, done, names),
    legend(names, last),
    h('details', {}, h('summary', {}, t('energy.table')), table(done, names, moment)),
  );
}

/** Names of all groups, the largest first, what is unexplained last. */
export function groupNames(done: readonly Energy[]): string[] {
  const sums = new Map<string, number>();
  for (const energy of done) {
    for (const [name, value] of Object.entries(energy.groups)) sums.set(name, (sums.get(name) ?? 0) + Math.abs(value));
  }
  const rank = (name: string): number => (name === 'unexplained' ? -1 : (sums.get(name) ?? 0));
  return [...sums.keys()].filter((name) => sums.get(name)).sort((a, b) => rank(b) - rank(a));
}

function drawing(task: string, done: readonly Energy[], names: readonly string[]): HTMLElement {
  const { bars, low, high } = stack(done.map((energy) => names.map((name) => energy.groups[name] ?? 0)));
  const y = (value: number): number => HIGH - (HIGH * (value - low)) / (high - low || 1);
  const step = WIDE / Math.max(done.length, 8);
  const rects = bars.flatMap((bar, i) =>
    bar.map(({ from, to }, group) =>
      svg('rect', {
        class: colourOf(names[group] as string, group),
        x: i * step + step * 0.1,
        width: step * 0.8,
        y: y(Math.max(from, to)),
        height: Math.abs(y(from) - y(to)),
      }),
    ),
  );
  const chart = svg('svg', { viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: 'none', class: 'stacked', 'aria-hidden': 'true' });
  chart.append(svg('line', { class: 'zero', x1: 0, x2: WIDE, y1: y(0), y2: y(0) }), ...rects);
  const label = t('energy.alternative', { task, n: done.length, last: quantity(done.at(-1)?.total, 'J') });
  return h(
    'div',
    { class: 'stacked-frame', role: 'img', 'aria-label': label },
    h('span', { class: 'most' }, quantity(high, 'J')),
    chart,
    h('span', { class: 'axis' }, t('energy.repetitions', { first: done[0]?.repetition ?? 0, last: done.at(-1)?.repetition ?? 0 })),
  );
}

function legend(names: readonly string[], last: Energy): HTMLElement {
  const rows = names.map((name, i) => {
    const unsure = last.group_uncertainty?.[name];
    const value = quantity(last.groups[name], 'J') + (unsure === undefined ? '' : ` ± ${quantity(unsure, 'J', 2)}`);
    return h('li', {}, h('i', { class: `swatch ${colourOf(name, i)}` }), name.replaceAll('_', ' '), h('span', { class: 'value' }, value));
  });
  return h('ul', { class: 'legend wrap' }, ...rows);
}

function table(done: readonly Energy[], names: readonly string[], moment: (ms: number) => string): HTMLElement {
  const heads = [t('energy.repetition'), t('energy.ended'), t('energy.total'), ...names.map((name) => name.replaceAll('_', ' '))];
  const rows = [...done].reverse().map((energy) =>
    h('tr', {}, h('th', { scope: 'row' }, energy.repetition), h('td', { class: 'time' }, moment(energy.end)), ...[energy.total, ...names.map((name) => energy.groups[name])].map((value) => h('td', { class: 'number' }, quantity(value, 'J')))),
  );
  return h(
    'div',
    { class: 'wide', tabindex: 0, role: 'group', 'aria-label': t('energy.table') },
    h('table', {}, h('thead', {}, h('tr', {}, ...heads.map((name) => h('th', { scope: 'col' }, name)))), h('tbody', {}, ...rows)),
  );
}

function colourOf(name: string, place: number): string {
  return name === 'unexplained' ? 'series-rest' : `series-${place % COLOURS}`;
}
