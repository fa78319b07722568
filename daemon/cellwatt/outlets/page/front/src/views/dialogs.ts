/** Dialogs of people about alarms: acknowledge, shelve, take off the shelf. */

import { Refused } from '../api';
import type { Cell } from '../cell';
import { button, h, say } from '../dom';
import { keep, prefs } from '../prefs';
import { t, type Key } from '../texts';

type What = 'acknowledge' | 'shelve' | 'unshelve';

const TITLES: Readonly<Record<What, Key>> = {
  acknowledge: 'dialog.acknowledge',
  shelve: 'dialog.shelve',
  unshelve: 'dialog.unshelve',
};
const EXPLAINED: Readonly<Record<What, Key>> = {
  acknowledge: 'dialog.acknowledge_means',
  shelve: 'dialog.shelve_means',
  unshelve: 'dialog.unshelve_means',
};
const MINUTES: readonly (readonly [number, Key])[] = [
  [15, 'shelf.15min'],
  [60, 'shelf.1h'],
  [480, 'shelf.8h'],
  [1440, 'shelf.1d'],
];

/** Ask a person for name and note, and tell the cell; `user` is the name of the login, if there is one. */
export function ask(what: What, cell: Cell, alarm: { id: string; statement: string }, user: string | null): void {
  const name = h('input', { id: 'dialog-name', required: true, maxlength: 100, autocomplete: 'name', readonly: user !== null });
  name.value = user ?? prefs.name;
  const note = h('textarea', { id: 'dialog-note', rows: 3, maxlength: 1000 });
  const error = h('p', { class: 'problem', role: 'alert' });
  const submit = h('button', { type: 'submit', class: 'primary' }, t(TITLES[what]));
  const send = async (event: SubmitEvent): Promise<void> => {
    event.preventDefault();
    submit.disabled = true;
    say(error, '');
    try {
      await order(what, cell, alarm.id, name.value.trim(), note.value.trim(), minutes(dialog));
      if (user === null) keep({ name: name.value.trim() });
      dialog.close();
    } catch (problem) {
      if (!(problem instanceof Refused)) throw problem;
      say(error, problem.message || t('connection.lost'));
    } finally {
      submit.disabled = false;
    }
  };
  const dialog = h(
    'dialog',
    { 'aria-labelledby': 'dialog-title', onclose: () => dialog.remove() },
    h(
      'form',
      { onsubmit: (event: SubmitEvent) => void send(event) },
      h('h2', { id: 'dialog-title' }, t(TITLES[what])),
      h('p', { class: 'statement' }, alarm.statement),
      h('p', { class: 'quiet' }, t(EXPLAINED[what])),
      what === 'shelve' ? durations() : null,
      h('label', { for: 'dialog-name' }, t('dialog.name')),
      name,
      what === 'unshelve' ? null : h('label', { for: 'dialog-note' }, t('dialog.note')),
      what === 'unshelve' ? null : note,
      error,
      h('div', { class: 'actions' }, button(t('dialog.cancel'), () => dialog.close()), submit),
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
  (name.value ? (what === 'unshelve' ? submit : note) : name).focus();
}

function durations(): HTMLElement {
  const options = MINUTES.map(([minutes, key], i) =>
    h('label', {}, h('input', { type: 'radio', name: 'minutes', value: minutes, checked: i === 1 }), h('span', {}, t(key))),
  );
  return h('fieldset', { class: 'durations' }, h('legend', {}, t('dialog.how_long')), ...options);
}

function minutes(dialog: HTMLElement): number {
  return Number(dialog.querySelector<HTMLInputElement>('input[name=minutes]:checked')?.value ?? 60);
}

function order(what: What, cell: Cell, id: string, name: string, note: string, minutes: number): Promise<unknown> {
  if (what === 'acknowledge') return cell.api.acknowledge(id, name, note);
  if (what === 'shelve') return cell.api.shelve(id, minutes, name, note);
  return cell.api.unshelve(id, name);
}
