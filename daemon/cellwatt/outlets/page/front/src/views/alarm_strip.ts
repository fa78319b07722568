/** The gravest alarms of a cell, before everything else. */

import type { Cell } from '../cell';
import { h, put } from '../dom';
import { severityShape, severityWord } from '../icons';
import { cellPath } from '../router';
import { counted, t } from '../texts';
import { Ends, type Surroundings } from '../view';

const SHOWN = 3;

export function alarmStrip(cell: Cell, around: Surroundings): { element: HTMLElement; close(): void } {
  const list = h('ul', { class: 'strip' });
  const element = h('section', { 'aria-labelledby': 'strip-title', class: 'strip-section' }, h('h2', { id: 'strip-title', class: 'hidden' }, t('alarms.active')), list);
  const show = (): void => {
    const found = cell.ranked();
    element.hidden = !found.length;
    const path = cellPath(cell.site, cell.name, 'alarms');
    const grave = found.filter((alarm) => alarm.severity !== 'info');
    const shown = (grave.length ? grave : found).slice(0, SHOWN);
    const rows = shown.map((alarm) =>
      h(
        'li',
        { class: `${alarm.severity}${alarm.acknowledged ? ' acknowledged' : ''}` },
        severityShape(alarm.severity),
        h('b', {}, severityWord(alarm.severity)),
        h('a', { href: path }, alarm.statement),
        h('span', { class: 'quiet' }, alarm.acknowledged ? t('alarm.known_to', { name: alarm.acknowledged.name }) : around.clock().moment(alarm.since)),
      ),
    );
    const more = found.length - shown.length;
    put(list, ...rows, more > 0 ? h('li', { class: 'more' }, h('a', { href: path }, counted(more, 'alarms.one_more', 'alarms.more'))) : null);
  };
  const ends = new Ends();
  ends.add(cell.on('state', show), cell.on('alarm', show), cell.on('shelved', show));
  show();
  return { element, close: () => ends.call() };
}
