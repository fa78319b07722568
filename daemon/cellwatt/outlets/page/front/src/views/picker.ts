/** Choice of the channels whose curves are shown. */

import { h, put, say } from '../dom';
import type { Channel } from '../shapes';
import { t } from '../texts';

/** A list of channels that can be searched and checked, at most `most` at once. */
export class Picker {
  readonly element: HTMLDetailsElement;
  private readonly summary = h('summary', {}, '');
  private readonly list = h('div', { class: 'channel-list' });
  private readonly search: HTMLInputElement;
  private channels: readonly Channel[] = [];
  private chosen: string[] = [];

  constructor(
    private readonly most: number,
    private readonly onchange: (chosen: string[]) => void,
  ) {
    this.search = h('input', { type: 'search', id: 'channel-search', autocomplete: 'off', oninput: () => this.fill() });
    this.element = h(
      'details',
      { class: 'picker' },
      this.summary,
      h('div', { class: 'picker-body' }, h('label', { for: 'channel-search' }, t('picker.search')), this.search, this.list),
    );
    this.element.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape' || !this.element.open) return;
      this.element.open = false;
      this.summary.focus();
    });
    this.element.addEventListener('toggle', () => this.element.open && this.fill());
  }

  /** Close the list if the pointer went down elsewhere. */
  readonly elsewhere = (event: Event): void => {
    if (!this.element.contains(event.target as Node)) this.element.open = false;
  };

  /** Offer channels, of which some are chosen. */
  offer(channels: readonly Channel[], chosen: readonly string[]): void {
    this.channels = channels;
    this.chosen = chosen.filter((name) => channels.some((c) => c.name === name));
    this.count();
    if (this.element.open) this.fill();
  }

  private fill(): void {
    const words = this.search.value.trim().toLowerCase().split(/\s+/);
    const found = this.channels.filter((c) => words.every((word) => c.name.toLowerCase().includes(word)));
    const sources = [...new Set(found.map((c) => c.source))];
    const sets = sources.map((source) =>
      h('fieldset', {}, h('legend', {}, source), ...found.filter((c) => c.source === source).map((c) => this.option(c))),
    );
    put(this.list, ...sets, found.length ? null : h('p', { class: 'quiet' }, t('picker.none')));
    this.limit();
  }

  private option(channel: Channel): HTMLElement {
    const box = h('input', {
      type: 'checkbox',
      value: channel.name,
      checked: this.chosen.includes(channel.name),
      onchange: () => this.toggle(channel.name, box.checked),
    });
    const name = channel.name.startsWith(`${channel.source}.`) ? channel.name.slice(channel.source.length + 1) : channel.name;
    return h('label', {}, box, h('span', {}, name), h('span', { class: 'quiet' }, channel.unit));
  }

  private toggle(name: string, on: boolean): void {
    this.chosen = on ? [...this.chosen, name] : this.chosen.filter((other) => other !== name);
    this.count();
    this.limit();
    this.onchange(this.chosen);
  }

  private count(): void {
    say(this.summary, t('picker.title', { n: this.chosen.length, most: this.most }));
  }

  private limit(): void {
    const full = this.chosen.length >= this.most;
    for (const box of this.list.querySelectorAll('input')) box.disabled = full && !box.checked;
  }
}
