/** What the cell is and does now, in letters that can be read from afar. */

import type { Cell } from '../cell';
import { condition } from '../condition';
import { measuredPower, predictedPower } from '../curves/lines';
import { h, mark, put, say } from '../dom';
import { stateName, stateShape, stateWord } from '../icons';
import { figure, parts } from '../numbers';
import { t } from '../texts';
import { Ends } from '../view';

/** ms between two readings of the power. */
const PERIOD = 250;
/** Reasons of a state that are shown. */
const REASONS = 3;
/** ms without health after which the cell counts as silent. */
const SILENT = 5000;

export function nowCards(cell: Cell): { element: HTMLElement; close(): void } {
  const state = stateCard();
  const doing = doingCard();
  const power = powerCard();
  const show = (): void => {
    state.show(cell);
    doing.show(cell);
  };
  const ends = new Ends();
  const timer = setInterval(() => (power.show(cell), state.show(cell)), PERIOD);
  ends.add(cell.on('state', show), cell.on('alarm', show), cell.on('shelved', show), cell.on('health', show), cell.on('interval', show), cell.on('task', show), () => clearInterval(timer));
  show();
  return { element: h('div', { class: 'now' }, state.element, doing.element, power.element), close: () => ends.call() };
}

interface Card {
  element: HTMLElement;
  show(cell: Cell): void;
}

function stateCard(): Card {
  const shape = h('span', { class: 'shape' });
  const word = h('p', { class: 'big' });
  const reasons = h('ul', { class: 'reasons' });
  const element = h('section', { class: 'card state', 'aria-labelledby': 'state-title' }, h('h2', { id: 'state-title' }, t('now.state')), h('div', { class: 'state-line' }, shape, word), reasons);
  let listed = '';
  return {
    element,
    show(cell) {
      const status = cell.state?.status;
      const silent = cell.state && cell.heard ? performance.now() - cell.heard : 0;
      const gone = silent > SILENT;
      const state = condition(status?.state, cell.alarms.values());
      const name = gone ? 'unknown' : stateName(state);
      if (element.dataset['state'] !== name) {
        mark(element, 'data-state', name);
        put(shape, stateShape(gone ? null : state));
      }
      say(word, gone ? t('now.silent', { s: Math.round(silent / 1000) }) : stateWord(state));
      const all = [...(status?.reasons ?? []), ...(status?.warnings ?? [])];
      const more = all.length - REASONS;
      const said = more > 1 ? [...all.slice(0, REASONS), t('now.more', { n: more })] : all;
      if (JSON.stringify(said) === listed) return;
      listed = JSON.stringify(said);
      put(reasons, ...said.map((reason) => h('li', {}, reason)));
    },
  };
}

function doingCard(): Card {
  const task = h('p', { class: 'big' });
  const repetition = h('span', { class: 'after' });
  const speed = h('p', { class: 'quiet' });
  const interval = h('p', { class: 'interval' });
  const element = h('section', { class: 'card doing', 'aria-labelledby': 'doing-title' }, h('h2', { id: 'doing-title' }, t('now.doing')), h('div', { class: 'state-line' }, task, repetition), speed, interval);
  let drawn = '';
  return {
    element,
    show(cell) {
      const current = cell.state?.task;
      say(task, current ? current.name.replaceAll('_', ' ') : t('now.no_task'));
      say(repetition, current ? `× ${current.repetition}` : '');
      say(speed, current ? t('now.speed', { speed: figure(100 * current.speed), variant: current.variant }) : '');
      const last = cell.state?.intervals.at(-1);
      const key = JSON.stringify(last && [last.number, last.moving]);
      if (key === drawn) return;
      drawn = key;
      put(interval, ...(last ? [h('span', { class: 'quiet' }, t('alarm.interval', { n: last.number })), ...moving(last.moving)] : []));
    },
  };
}

function moving(joints: readonly number[]): HTMLElement[] {
  if (!joints.length) return [h('span', { class: 'chip rest' }, t('interval.rest'))];
  return joints.map((joint) => h('span', { class: `chip series-${joint % 8}` }, t('arm.joint', { n: joint })));
}

function powerCard(): Card {
  const [value, unit] = [h('span', { class: 'big' }), h('span', { class: 'after' })];
  const [predicted, off, which] = [h('b'), h('b'), h('span')];
  const beside = h('p', { class: 'beside' }, t('now.predicted'), ' ', predicted, h('span', { class: 'quiet' }, '  ·  ', t('now.off'), ' ', off));
  const element = h('section', { class: 'card power', 'aria-labelledby': 'power-title' }, h('h2', { id: 'power-title' }, t('now.power'), ' ', which), h('div', { class: 'state-line' }, value, unit), beside);
  return {
    element,
    show(cell) {
      if (!cell.state) return;
      const names = measuredPower(cell.state.channels);
      const measured = cell.latest.get(names[0] ?? '') ?? null;
      say(which, names.length > 1 ? `· ${(names[0] as string).split('.')[0] as string}` : '');
      const said = cell.latest.get(predictedPower(cell.state)[0] ?? '') ?? null;
      const [number, shown] = parts(measured, 'W');
      say(value, number);
      say(unit, shown);
      beside.hidden = said === null;
      say(predicted, parts(said, 'W').join(' '));
      const apart = measured === null || said === null ? null : measured - said;
      say(off, `${(apart ?? 0) > 0 ? '+' : ''}${parts(apart, 'W', 2).join(' ')}`);
    },
  };
}
