/** Buttons that move through time, and what there is to say of the span that is shown. */

import { span as spanText, type Clock } from '../clock';
import { button, choice, h, mark, put, say } from '../dom';
import { severityShape } from '../icons';
import type { AlarmMark } from '../shapes';
import { t, type Key } from '../texts';
import type { Marks } from './marks';
import { SPANS, type Span, type Timeline } from './timeline';

const NAMES: Readonly<Record<number, Key>> = {
  10e3: 'span.10s',
  60e3: 'span.1min',
  600e3: 'span.10min',
  3600e3: 'span.1h',
  28800e3: 'span.8h',
  86400e3: 'span.1d',
  604800e3: 'span.7d',
};
/** Alarms of a span that are listed. */
const LISTED = 5;

export function toolbar(timeline: Timeline, now: () => number) {
  const spans = choice<number>(
    t('chart.span'),
    SPANS.map((ms) => [ms, t(NAMES[ms] as Key)] as const),
    (ms) => timeline.wide(ms, now()),
  );
  const live = button(t('chart.live'), () => timeline.follow(), { class: 'live' });
  const icon = (text: string, label: string, act: () => void): HTMLElement =>
    button(text, act, { class: 'icon', 'aria-label': label, title: label });
  const shown = h('span', { class: 'shown' });
  const readout = h('span', { class: 'readout quiet' });
  const notice = h('p', { class: 'notice', role: 'status' });
  notice.hidden = true;
  const spinner = h('span', { class: 'busy', 'aria-hidden': 'true' });
  const alarms = h('ul', { class: 'span-alarms', 'aria-label': t('chart.alarms') });
  const element = h(
    'div',
    { class: 'toolbar' },
    h(
      'div',
      { class: 'row' },
      live,
      spans.element,
      h(
        'div',
        { class: 'steps', role: 'group', 'aria-label': t('chart.move') },
        icon('‹', t('chart.back'), () => timeline.pan(-0.5, now())),
        icon('›', t('chart.forward'), () => timeline.pan(0.5, now())),
        icon('+', t('chart.closer'), () => timeline.zoom(0.5, now())),
        icon('−', t('chart.wider'), () => timeline.zoom(2, now())),
      ),
      shown,
      readout,
      spinner,
    ),
    notice,
  );
  let listed = '';
  return {
    element,
    alarms,
    busy: (busy: boolean): void => void spinner.classList.toggle('on', busy),
    note: (text: string): void => {
      say(notice, text);
      notice.hidden = !text;
    },
    /** Tell which span is shown. */
    times: ({ from, to }: Span, clock: Clock): void => {
      mark(live, 'aria-pressed', String(timeline.live));
      spans.set(Math.round(to - from));
      const width = spanText(to - from);
      say(
        shown,
        timeline.live
          ? t('chart.last', { width })
          : t('chart.past', { from: clock.moment(from), to: clock.moment(to), width, zone: clock.zone }),
      );
    },
    /** Tell what is under the pointer. */
    over: (time: number | null, marks: Marks, clock: Clock): void => {
      if (time === null) return say(readout, '');
      const interval = marks.at(time);
      const alarm = marks.close(time, timeline.width / 150);
      const moving = interval && (interval.moving.length ? t('interval.moving', { joints: interval.moving.join(' + ') }) : t('interval.rest'));
      say(readout, [clock.time(time, 1), moving, alarm?.statement].filter(Boolean).join('  ·  '));
    },
    /** List the alarms of the span. */
    list: (found: readonly AlarmMark[], clock: Clock): void => {
      const newest = [...found].sort((a, b) => b.raised - a.raised).slice(0, LISTED);
      const key = JSON.stringify([newest, clock.utc]);
      if (key === listed) return;
      listed = key;
      put(alarms, ...newest.map((alarm) => h('li', {}, severityShape(alarm.severity), h('time', {}, clock.moment(alarm.raised)), h('span', {}, alarm.statement))));
    },
  };
}
