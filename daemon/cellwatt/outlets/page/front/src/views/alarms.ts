/** Alarms of a cell: active, on the shelf, and those of the past. */

import { Refused } from '../api';
import { choice, h, put, reorder, say } from '../dom';
import type { Alarm, PastAlarm } from '../shapes';
import { t } from '../texts';
import { Ends, type CellView } from '../view';
import { about, alarmCard, historyRow, shelvedCard, type Acts } from './alarm';
import { ask } from './dialogs';

const MINUTE = 60_000;
const HOUR = 60 * MINUTE;
const SPANS = [24 * HOUR, 7 * 24 * HOUR, 30 * 24 * HOUR] as const;
const MOST = 200;

export const alarmsView: CellView = (root, cell, around) => {
  const ends = new Ends();
  const active = h('ul', { class: 'cards', 'aria-labelledby': 'active-title' });
  const shelf = h('ul', { class: 'cards', 'aria-labelledby': 'shelf-title' });
  const shelfSection = h('section', {}, h('h2', { id: 'shelf-title' }, t('alarms.shelved')), shelf);
  const rows = h('tbody');
  const remark = h('p', { class: 'quiet', role: 'status' });
  const reason = h('p', { class: 'quiet' });
  let reach: number = SPANS[0];
  let past: PastAlarm[] = [];

  const acts = (): Acts | null => {
    if (!cell.state?.may_act) return null;
    const open = (what: 'acknowledge' | 'shelve' | 'unshelve') => (alarm: { id: string; statement: string }) =>
      ask(what, cell, alarm, around.site.user);
    return { acknowledge: open('acknowledge'), shelve: open('shelve'), unshelve: open('unshelve') };
  };
  const made = new Map<string, { key: string; element: HTMLElement }>();
  /** The card of an alarm: the one there is, while nothing of it but its age has changed. */
  const card = (alarm: Alarm): HTMLElement => {
    const key = JSON.stringify([{ ...alarm, time: 0 }, around.clock().utc, acts() !== null]);
    const before = made.get(alarm.id);
    if (before?.key === key) return before.element;
    const element = alarmCard(alarm, around.clock(), acts());
    const open = before?.element.querySelector('details')?.open;
    const details = element.querySelector('details');
    if (details && open !== undefined) details.open = open;
    made.set(alarm.id, { key, element });
    return element;
  };
  const showAges = (): void => {
    for (const alarm of cell.alarms.values()) {
      const line = made.get(alarm.id)?.element.querySelector('.about');
      if (line) say(line, about(alarm, around.clock(), cell.now));
    }
  };
  const showActive = (): void => {
    const cards = cell.ranked().map(card);
    for (const id of [...made.keys()]) if (!cell.alarms.has(id)) made.delete(id);
    if (cards.length) reorder(active, cards);
    else put(active, h('li', { class: 'card empty good' }, t('alarms.none')));
    showAges();
    const kept = cell.state?.shelved ?? [];
    shelfSection.hidden = !kept.length;
    put(shelf, ...kept.map((alarm) => shelvedCard(alarm, around.clock(), acts())));
    say(reason, cell.state && !cell.state.may_act ? t('alarms.may_not_act') : '');
  };
  const showPast = (): void => put(rows, ...past.map((alarm) => historyRow(alarm, around.clock())));
  const read = async (): Promise<void> => {
    const to = cell.now + MINUTE;
    try {
      const answer = await cell.api.alarms({ from: to - reach, to }, MOST);
      past = answer.alarms;
      const all = answer.complete && past.length < MOST;
      say(remark, past.length ? (all ? '' : t('alarms.incomplete', { n: past.length })) : t('alarms.no_history'));
      showPast();
    } catch (error) {
      if (error instanceof Refused) say(remark, error.message || t('connection.lost'));
    }
  };
  const spans = choice<number>(
    t('alarms.history_span'),
    [
      [SPANS[0], t('alarms.24h')],
      [SPANS[1], t('alarms.7d')],
      [SPANS[2], t('alarms.30d')],
    ],
    (ms) => {
      reach = ms;
      spans.set(ms);
      void read();
    },
  );
  spans.set(reach);

  const columns = [t('history.since'), t('history.severity'), t('history.what'), t('history.lasted'), t('history.page')];
  root.append(
    h('h1', {}, t('alarms.title')),
    reason,
    h('section', {}, h('h2', { id: 'active-title' }, t('alarms.active')), active),
    shelfSection,
    h(
      'section',
      { class: 'card history' },
      h('div', { class: 'head' }, h('h2', {}, t('alarms.history')), spans.element),
      remark,
      h(
        'div',
        { class: 'wide', tabindex: 0, role: 'group', 'aria-label': t('alarms.history') },
        h('table', {}, h('thead', {}, h('tr', {}, ...columns.map((name) => h('th', { scope: 'col' }, name)))), rows),
      ),
    ),
  );
  ends.add(
    cell.on('state', () => (showActive(), void read())),
    cell.on('shelved', showActive),
    cell.on('health', showAges),
    cell.on('alarm', ({ alarm }: { alarm: Alarm }) => {
      showActive();
      if (!alarm.active) void read();
    }),
  );
  if (cell.state) {
    showActive();
    void read();
  }
  return {
    title: t('alarms.title'),
    close: () => ends.call(),
    retime: () => {
      showActive();
      showPast();
    },
  };
};
