/** All cells of a site, the worst first; only tiles that changed are touched. */

import { plant, Refused } from '../api';
import { h, mark, put, reorder, say } from '../dom';
import { condition } from '../condition';
import { severityWord, stateName, stateShape, stateWord } from '../icons';
import { kilowattHours, parts } from '../numbers';
import { cellPath } from '../router';
import type { PlantAlarm, PlantCell } from '../shapes';
import { browser, Stream } from '../stream';
import { counted, t, type Key } from '../texts';
import type { Surroundings, View } from '../view';

const ORDER = ['red', 'amber', 'gone', 'unknown', 'green'];
const SEVERITIES = ['info', 'warning', 'error'];
/** Cells up to which tiles are large, and very large. */
const LARGE = 24;
const HUGE = 6;

interface Tile {
  cell: PlantCell;
  element: HTMLElement;
  update(cell: PlantCell): void;
}

/** State of a cell with its alarms. */
function seen(cell: PlantCell): PlantCell['state'] {
  return condition(cell.state, cell.alarms) ?? null;
}

/** Cells from the worst to the best, those alike by name. */
export function worstFirst(cells: readonly PlantCell[]): PlantCell[] {
  const rank = (c: PlantCell): number => ORDER.indexOf(stateName(seen(c)));
  const grave = (c: PlantCell): number => SEVERITIES.indexOf(gravest(c.alarms)?.severity ?? '');
  return [...cells].sort(
    (a, b) => rank(a) - rank(b) || grave(b) - grave(a) || a.cell.localeCompare(b.cell, undefined, { numeric: true }),
  );
}

/** The gravest alarm, unacknowledged before acknowledged, new before old. */
export function gravest(alarms: readonly PlantAlarm[]): PlantAlarm | undefined {
  const weight = (a: PlantAlarm): number => 2 * SEVERITIES.indexOf(a.severity) + (a.acknowledged ? 0 : 1);
  return [...alarms].sort((a, b) => weight(b) - weight(a) || b.since - a.since)[0];
}

export function plantView(root: HTMLElement, around: Surroundings, onconnection: (live: boolean) => void): View {
  const tiles = new Map<string, Tile>();
  const grid = h('ul', { class: 'tiles-plant' });
  const summary = h('p', { class: 'plant-summary', role: 'status' });
  const filter = h('input', { type: 'search', id: 'filter', autocomplete: 'off', placeholder: t('plant.filter_hint') });
  const empty = h('p', { class: 'quiet empty' });
  const title = around.site.site ? t('plant.of', { site: around.site.site }) : t('plant.title');
  root.append(
    h('div', { class: 'plant-head' }, h('h1', {}, title), summary, h('label', { class: 'filter', for: 'filter' }, h('span', {}, t('plant.filter')), filter)),
    grid,
    empty,
  );

  const take = (cells: readonly PlantCell[], all = false): void => {
    const names = new Set(cells.map((cell) => cell.cell));
    for (const name of [...tiles.keys()]) if (all && !names.has(name)) tiles.delete(name);
    for (const cell of cells) {
      const known = tiles.get(cell.cell);
      if (known) known.update(cell);
      else tiles.set(cell.cell, tile(cell));
    }
    arrange();
  };
  const arrange = (): void => {
    const all = worstFirst([...tiles.values()].map((one) => one.cell));
    const wanted = filter.value.trim().toLowerCase();
    const shown = all.filter((cell) => !wanted || text(cell).includes(wanted));
    mark(grid, 'data-size', shown.length <= HUGE ? 'huge' : shown.length <= LARGE ? 'large' : 'normal');
    reorder(grid, shown.map((cell) => (tiles.get(cell.cell) as Tile).element));
    summarise(summary, all);
    say(empty, all.length ? (shown.length ? '' : t('plant.no_match')) : t('plant.empty'));
  };
  filter.addEventListener('input', arrange);

  const read = async (): Promise<void> => {
    try {
      take((await plant()).cells, true);
    } catch (error) {
      if (error instanceof Refused) say(empty, error.message || t('connection.lost'));
    }
  };
  const stream = new Stream(
    '/api/plant/stream',
    { plant: (plant: { cells: PlantCell[] }) => take(plant.cells) },
    (state) => {
      onconnection(state !== 'lost');
      if (state === 'lost' && !tiles.size) void read();
    },
    () => void read(),
    browser,
  );
  return { title, close: () => stream.close() };
}

function tile(first: PlantCell): Tile {
  const figures = (['plant.power', 'plant.energy', 'plant.task'] as const).map((key: Key) => {
    const value = h('dd');
    return { value, row: h('div', {}, h('dt', {}, t(key)), value) };
  });
  const shape = h('span', { class: 'shape' });
  const word = h('span', { class: 'word' });
  const alarms = h('span', { class: 'count' });
  const worst = h('p', { class: 'worst' });
  const link = h('a', { href: cellPath(first.site, first.cell) }, first.cell);
  const element = h(
    'li',
    { class: 'tile' },
    h('div', { class: 'top' }, shape, h('h2', {}, link), word),
    h('dl', {}, ...figures.map((f) => f.row)),
    h('div', { class: 'foot' }, alarms, worst),
  );
  const found: Tile = {
    cell: first,
    element,
    update(cell) {
      found.cell = cell;
      const state = stateName(seen(cell));
      if (element.dataset['state'] !== state) {
        element.dataset['state'] = state;
        put(shape, stateShape(seen(cell)));
        say(word, stateWord(seen(cell)));
      }
      const [power, unit] = parts(cell.power_W, 'W', 3, 1000);
      say(figures[0]!.value, cell.power_W === null ? '–' : `${power} ${unit}`);
      say(figures[1]!.value, kilowattHours(cell.energy_today_J));
      say(figures[2]!.value, cell.task?.replaceAll('_', ' ') ?? '–');
      const alarm = gravest(cell.alarms);
      say(alarms, alarm ? counted(cell.alarms.length, 'plant.alarm', 'plant.alarms') : '');
      say(worst, alarm ? `${severityWord(alarm.severity)}: ${alarm.statement}` : quiet(cell));
      element.classList.toggle('acknowledged', cell.alarms.length > 0 && cell.alarms.every((a) => a.acknowledged));
    },
  };
  found.update(first);
  return found;
}

function quiet(cell: PlantCell): string {
  if (cell.state === null) return t('plant.no_answer');
  if (cell.state === 'gone') return t('plant.gone');
  if ((cell.age_s ?? 0) > 10) return t('plant.old', { age: Math.round(cell.age_s ?? 0) });
  return cell.shelved ? counted(cell.shelved, 'plant.shelved_one', 'plant.shelved') : '';
}

function text(cell: PlantCell): string {
  return [cell.cell, stateWord(seen(cell)), cell.task ?? '', ...cell.alarms.map((a) => a.statement)].join(' ').toLowerCase();
}

function summarise(element: HTMLElement, cells: readonly PlantCell[]): void {
  const counts = new Map<string, { n: number; state: PlantCell['state'] }>();
  for (const cell of cells) {
    const name = stateName(seen(cell));
    counts.set(name, { n: (counts.get(name)?.n ?? 0) + 1, state: seen(cell) });
  }
  const key = ORDER.map((name) => `${name} ${counts.get(name)?.n ?? 0}`).join();
  if (element.dataset['key'] === key) return;
  element.dataset['key'] = key;
  const known = ORDER.filter((name) => counts.has(name)).map((name) => {
    const { n, state } = counts.get(name) as { n: number; state: PlantCell['state'] };
    return h('span', { class: 'tally' }, stateShape(state), h('b', {}, n), stateWord(state));
  });
  put(element, ...known);
}
