/** Shapes and words of states, so that colour never stands alone. */

import { h, svg } from './dom';
import type { Severity, State } from './shapes';
import { t, type Key } from './texts';

const OCTAGON = 'M8 2h8l6 6v8l-6 6H8l-6-6V8z';
const TRIANGLE = 'M12 2.5 22.5 21.5h-21z';
const STROKES: Readonly<Record<string, string>> = {
  check: 'm7 12.5 3.5 3.5L17 8.5',
  cross: 'm8.5 8.5 7 7m0-7-7 7',
  bang: 'M12 9v5.5m0 3.2v.3',
  info: 'M12 11v6m0-10.2v.2',
  question: 'M9.2 9.3a2.9 2.9 0 1 1 4.2 2.6c-1 .5-1.4 1-1.4 2.1m0 3v.2',
  dash: 'M7 12h10',
};

const WORDS: Readonly<Record<string, Key>> = {
  green: 'state.green',
  amber: 'state.amber',
  red: 'state.red',
  gone: 'state.gone',
  unknown: 'state.unknown',
};
const SEVERITIES: Readonly<Record<Severity, Key>> = {
  info: 'severity.info',
  warning: 'severity.warning',
  error: 'severity.error',
};

/** Name of a state in classes: that of the server, `unknown` where it has none. */
export function stateName(state: State | undefined): string {
  return state && state in WORDS ? state : 'unknown';
}

export function stateWord(state: State | undefined): string {
  return t(WORDS[stateName(state)] as Key);
}

/** Circle, triangle or octagon; a ring where nothing is known, a square where the cell has gone. */
export function stateShape(state: State | undefined): SVGElement {
  const name = stateName(state);
  const drawn: Record<string, [SVGElement, string]> = {
    green: [circle(), 'check'],
    amber: [svg('path', { d: TRIANGLE, class: 'body' }), 'bang'],
    red: [svg('path', { d: OCTAGON, class: 'body' }), 'cross'],
    gone: [svg('rect', { x: 3, y: 3, width: 18, height: 18, rx: 2, class: 'body' }), 'dash'],
    unknown: [circle(), 'question'],
  };
  const [body, stroke] = drawn[name] as [SVGElement, string];
  return shape(`state-shape ${name}`, body, stroke);
}

export function severityWord(severity: Severity): string {
  return t(SEVERITIES[severity]);
}

/** Circle, triangle or octagon of a severity. */
export function severityShape(severity: Severity): SVGElement {
  const name = severity === 'error' ? 'red' : severity === 'warning' ? 'amber' : 'info';
  const body = name === 'info' ? circle() : svg('path', { d: name === 'red' ? OCTAGON : TRIANGLE, class: 'body' });
  return shape(`state-shape ${name}`, body, name === 'info' ? 'info' : 'bang');
}

/** Shape and word of a severity. */
export function severityTag(severity: Severity): HTMLElement {
  return h('span', { class: `tag ${severity}` }, severityShape(severity), severityWord(severity));
}

function circle(): SVGElement {
  return svg('circle', { cx: 12, cy: 12, r: 10, class: 'body' });
}

function shape(name: string, body: SVGElement, stroke: string): SVGElement {
  return svg('svg', { viewBox: '0 0 24 24', class: name, 'aria-hidden': 'true' }, body, svg('path', { d: STROKES[stroke], class: 'stroke' }));
}
