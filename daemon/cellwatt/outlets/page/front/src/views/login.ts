/** Log in. */

import { logIn, Refused } from '../api';
import { h, say } from '../dom';
import { t } from '../texts';
import type { Surroundings, View } from '../view';

export function loginView(root: HTMLElement, around: Surroundings): View {
  const name = h('input', { id: 'login-name', name: 'username', autocomplete: 'username', required: true, maxlength: 100, autocapitalize: 'none' });
  const password = h('input', { id: 'login-password', name: 'password', type: 'password', autocomplete: 'current-password', required: true });
  const error = h('p', { class: 'problem', role: 'alert' });
  const submit = h('button', { type: 'submit', class: 'primary' }, t('login.submit'));
  const send = async (event: SubmitEvent): Promise<void> => {
    event.preventDefault();
    say(error, '');
    submit.disabled = true;
    try {
      await logIn(name.value, password.value);
      await around.enter();
    } catch (problem) {
      if (!(problem instanceof Refused)) throw problem;
      say(error, problem.message || t('connection.lost'));
      password.select();
    } finally {
      submit.disabled = false;
    }
  };
  root.append(
    h(
      'form',
      { class: 'login card', onsubmit: (event: SubmitEvent) => void send(event) },
      h('h1', {}, t('login.title')),
      h('label', { for: 'login-name' }, t('login.name')),
      name,
      h('label', { for: 'login-password' }, t('login.password')),
      password,
      error,
      submit,
    ),
  );
  name.focus();
  return { title: t('login.title'), close: () => undefined };
}
