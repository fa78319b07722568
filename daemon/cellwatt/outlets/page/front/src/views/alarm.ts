/** One alarm as a card. */

import { span, type Clock } from '../clock';
import { button, h } from '../dom';
import { evidenceTable } from '../evidence';
import { severityTag } from '../icons';
import type { Alarm, PastAlarm, Shelved } from '../shapes';
import { t, type Key } from '../texts';

export interface Acts {
  acknowledge(alarm: Alarm): void;
  shelve(alarm: Alarm): void;
  unshelve(alarm: Shelved): void;
}

const SAID: Readonly<Record<string, Key>> = {
  acknowledged: 'history.acknowledged',
  shelved: 'history.shelved',
  unshelved: 'history.unshelved',
};

/** An active alarm with all that is known of it; `acts` where the person may do something. */
export function alarmCard(alarm: Alarm, clock: Clock, acts: Acts | null): HTMLElement {
  const table = evidenceTable(alarm.evidence);
  return h(
    'li',
    { class: `card alarm ${alarm.severity}${alarm.acknowledged ? ' acknowledged' : ''}`, 'data-alarm': alarm.id },
    h('div', { class: 'alarm-head' }, severityTag(alarm.severity), h('span', { class: 'quiet about' })),
    h('h3', {}, alarm.statement),
    others(alarm),
    word(alarm, clock),
    table ? h('details', { open: !alarm.acknowledged && alarm.severity !== 'info' }, h('summary', {}, t('alarm.evidence')), table) : null,
    h(
      'div',
      { class: 'actions' },
      evidenceLink(alarm),
      acts && button(t('alarm.shelve'), () => acts.shelve(alarm)),
      acts && !alarm.acknowledged && button(t('alarm.acknowledge'), () => acts.acknowledge(alarm), { class: 'primary' }),
    ),
  );
}

/** An alarm on the shelf. */
export function shelvedCard(alarm: Shelved, clock: Clock, acts: Acts | null): HTMLElement {
  const { name, note, until } = alarm.shelf;
  return h(
    'li',
    { class: `card alarm shelved ${alarm.severity}`, 'data-alarm': alarm.id },
    h('div', { class: 'alarm-head' }, severityTag(alarm.severity), h('span', { class: 'quiet' }, t('alarm.shelved_until', { until: clock.moment(until) }))),
    h('h3', {}, alarm.statement),
    h('p', { class: 'said' }, h('b', {}, name), note ? `: ${note}` : ''),
    acts && h('div', { class: 'actions' }, button(t('alarm.unshelve'), () => acts.unshelve(alarm))),
  );
}

/** A row of the history. */
export function historyRow(alarm: PastAlarm, clock: Clock): HTMLElement {
  const people = (alarm.people ?? []).map((said) => {
    const key = SAID[said.what];
    const until = said.until ? ` ${t('history.until', { until: clock.moment(said.until) })}` : '';
    return h('li', {}, h('time', {}, clock.moment(said.t)), ` ${key ? t(key, { name: said.name }) : said.name}${until}${said.note ? `: ${said.note}` : ''}`);
  });
  const lasted = alarm.cleared === null ? t('history.active') : span(alarm.cleared - alarm.since);
  const table = evidenceTable(alarm.evidence ?? {});
  const cleared = alarm.cleared_statement ? h('p', { class: 'quiet' }, alarm.cleared_statement) : null;
  return h(
    'tr',
    {},
    h('td', { class: 'time' }, clock.moment(alarm.since)),
    h('td', {}, severityTag(alarm.severity)),
    h(
      'th',
      { scope: 'row' },
      alarm.statement,
      cleared,
      people.length ? h('ul', { class: 'people' }, ...people) : null,
      table ? h('details', {}, h('summary', {}, t('alarm.evidence')), table) : null,
    ),
    h('td', { class: 'time' }, lasted),
    h('td', {}, evidenceLink(alarm)),
  );
}

function evidenceLink(alarm: Alarm): HTMLElement | null {
  if (!alarm.evidence_page) return null;
  return h('a', { class: 'button', href: alarm.evidence_page, target: '_blank', rel: 'noopener' }, t('alarm.page'));
}

/** Age and origin of an active alarm. */
export function about(alarm: Alarm, clock: Clock, now: number): string {
  const facts = [
    t('alarm.since', { at: clock.moment(alarm.since), span: span(now - alarm.since) }),
    alarm.source,
    alarm.joint === null ? null : t('arm.joint', { n: alarm.joint }),
    alarm.interval === null ? null : t('alarm.interval', { n: alarm.interval }),
    alarm.stage ? t('alarm.stage', { stage: alarm.stage }) : t('alarm.daemon'),
  ];
  return facts.filter(Boolean).join('  ·  ');
}

function others(alarm: Alarm): HTMLElement | null {
  if (!alarm.alternatives?.length) return null;
  return h('p', { class: 'others' }, t('alarm.or_else', { joints: alarm.alternatives.join(', ') }));
}

function word(alarm: Alarm, clock: Clock): HTMLElement | null {
  const said = alarm.acknowledged;
  if (!said) return null;
  return h('p', { class: 'said' }, t('alarm.acknowledged_by', { name: said.name, at: clock.moment(said.time) }), said.note ? ' ' : null, said.note ? h('q', {}, said.note) : null);
}
