/** Reports of a cell, by kind. */

import { Refused } from '../api';
import type { Cell } from '../cell';
import { h, put } from '../dom';
import type { Report } from '../shapes';
import { t } from '../texts';
import type { CellView } from '../view';

export const reportsView: CellView = (root, cell, around) => {
  const list = h('div', { class: 'stack', 'aria-busy': 'true' }, h('p', { class: 'quiet' }, t('page.reading')));
  root.append(h('h1', {}, t('reports.title')), h('p', { class: 'quiet lead' }, t('reports.lead')), list);
  const show = (reports: readonly Report[], broken: number): void => {
    const kinds = new Map<string, Report[]>();
    for (const report of reports) kinds.set(report.kind, [...(kinds.get(report.kind) ?? []), report]);
    const moment = (made: Report['made']): string => when(made, (ms) => around.clock().moment(ms));
    const sections = [...kinds].map(([kind, found]) => section(kind, found, moment));
    put(list, ...sections, reports.length ? null : h('p', { class: 'card empty' }, t('reports.none')));
    if (broken) list.append(h('p', { class: 'quiet' }, t('reports.broken', { n: broken })));
    list.removeAttribute('aria-busy');
  };
  let kept: [Report[], number] = [[], 0];
  void read(cell, list, (reports, broken) => {
    kept = [reports, broken];
    show(reports, broken);
  });
  return { title: t('reports.title'), close: () => undefined, retime: () => show(...kept) };
};

/** A time, ms or as text, as it is shown. */
export function when(made: number | string | null | undefined, moment: (ms: number) => string): string {
  if (made === null || made === undefined || made === '') return '';
  const ms = typeof made === 'number' ? made : Date.parse(made);
  return Number.isFinite(ms) ? moment(ms) : String(made);
}

async function read(cell: Cell, list: HTMLElement, show: (reports: Report[], broken: number) => void): Promise<void> {
  try {
    const { reports, broken } = await cell.api.reports();
    show(reports, broken.length);
  } catch (error) {
    if (error instanceof Refused) put(list, h('p', { class: 'problem', role: 'alert' }, error.message || t('connection.lost')));
  }
}

function section(kind: string, reports: readonly Report[], moment: (made: Report['made']) => string): HTMLElement {
  const rows = reports.map((report) =>
    h(
      'tr',
      {},
      h('th', { scope: 'row' }, h('a', { href: report.href, target: '_blank', rel: 'noopener' }, report.name || report.path)),
      h('td', {}, h('span', { class: `tone ${report.tone}` }), report.finding),
      h('td', { class: 'quiet' }, report.about),
      h('td', { class: 'quiet time' }, moment(report.made)),
    ),
  );
  const names = (['reports.name', 'reports.finding', 'reports.about', 'reports.made'] as const).map((key) => h('th', { scope: 'col' }, t(key)));
  return h(
    'section',
    { class: 'card' },
    h('h2', {}, kind.replaceAll('_', ' '), h('span', { class: 'badge' }, reports.length)),
    h('div', { class: 'wide', tabindex: 0, role: 'group', 'aria-label': kind }, h('table', {}, h('thead', {}, h('tr', {}, ...names)), h('tbody', {}, ...rows))),
  );
}
