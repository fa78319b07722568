/** The frame around all views: who and where, ways to the views, switches, and what is said to everybody. */

import type { Cell } from './cell';
import { Clock } from './clock';
import { button, h, mark, put, say } from './dom';
import { condition } from './condition';
import { stateName, stateShape, stateWord } from './icons';
import { repaint } from './palette';
import { keep, prefs, type Theme } from './prefs';
import { cellPath, PARTS, type Part, type Place } from './router';
import type { Site } from './shapes';
import { counted, language, languages, speak, t, type Key } from './texts';

const PART_NAMES: Readonly<Record<Part, Key>> = {
  overview: 'nav.overview',
  alarms: 'nav.alarms',
  energy: 'nav.energy',
  mismatch: 'nav.mismatch',
  reports: 'nav.reports',
};
const THEMES: readonly Theme[] = ['auto', 'dark', 'light'];
const THEME_NAMES: Readonly<Record<Theme, Key>> = { auto: 'theme.auto', dark: 'theme.dark', light: 'theme.light' };

export interface Wishes {
  retime(): void;
  translate(): void;
  logOut(): void;
}

export class Shell {
  readonly main = h('main', { id: 'main', tabindex: -1 });
  private readonly nav = h('nav', { 'aria-label': t('nav.label') });
  private readonly crumbs = h('div', { class: 'crumbs' });
  private readonly time = h('span', { class: 'time' });
  private readonly tools = h('div', { class: 'tools' });
  private readonly banner = h('p', { class: 'banner', role: 'status' });
  private readonly polite = h('p', { class: 'hidden', 'aria-live': 'polite' });
  private readonly urgent = h('p', { class: 'hidden', 'aria-live': 'assertive' });
  private badge: HTMLElement | null = null;

  constructor(
    root: HTMLElement,
    private readonly wishes: Wishes,
  ) {
    this.banner.hidden = true;
    const skip = h('a', { class: 'skip', href: '#main' }, t('nav.skip'));
    put(root, skip, h('header', { class: 'top' }, this.crumbs, this.nav, this.tools), this.banner, this.main, this.polite, this.urgent);
    setInterval(() => this.tick(), 500);
    applyTheme();
  }

  /** Show where the page is. */
  show(site: Site | null, place: Place, cell: Cell | null): void {
    const home = h('a', { class: 'brand', href: '/' }, 'cellwatt');
    const plant = site?.mode === 'plant' && cell ? h('a', { class: 'up', href: '/plant' }, t('nav.plant')) : null;
    put(this.crumbs, home, plant, cell ? h('span', { class: 'where' }, h('span', { class: 'state-mark' }), h('b', {}, cell.name), h('span', { class: 'quiet' }, cell.site)) : null);
    this.badge = h('span', { class: 'badge' });
    const links = cell && place.view === 'cell' ? PARTS.map((part) => this.link(cell, part, place.part)) : [];
    if (site?.may_drop) links.push(h('a', { href: '/recordings', 'aria-current': place.view === 'recordings' ? 'page' : null }, t('drop.nav')));
    put(this.nav, ...links);
    this.nav.hidden = !links.length;
    this.toolbar(site);
    this.tick();
  }

  /** Tell the state of the cell and the number of its alarms. */
  state(cell: Cell): void {
    const shape = this.crumbs.querySelector('.state-mark');
    const state = condition(cell.state?.status.state, cell.alarms.values());
    if (shape && shape.getAttribute('data-state') !== stateName(state)) {
      mark(shape, 'data-state', stateName(state));
      put(shape, stateShape(state), h('span', { class: 'hidden' }, stateWord(state)));
    }
    const open = cell.alarms.size;
    if (!this.badge) return;
    this.badge.hidden = !open;
    put(this.badge, open, h('span', { class: 'hidden' }, ` ${counted(open, 'nav.open_alarm', 'nav.open_alarms')}`));
    mark(this.badge, 'class', `badge ${cell.ranked()[0]?.severity ?? ''}`);
  }

  /** Say whether the connection holds, and what the server gave as the reason if it does not. */
  connection(live: boolean, reason = ''): void {
    say(this.banner, live ? '' : reason || t('connection.retrying'));
    this.banner.hidden = live;
    document.body.classList.toggle('lost', !live);
  }

  /** Say something to those who do not see the page: at once if it is urgent. */
  announce(text: string, urgent: boolean): void {
    say(urgent ? this.urgent : this.polite, text);
  }

  private link(cell: Cell, part: Part, here: Part): HTMLElement {
    const current = part === here ? 'page' : null;
    return h('a', { href: cellPath(cell.site, cell.name, part), 'aria-current': current }, t(PART_NAMES[part]), part === 'alarms' ? this.badge : null);
  }

  private toolbar(site: Site | null): void {
    const zone = button(t('time.utc'), () => this.rezone(), { 'aria-pressed': String(prefs.utc), title: t('time.switch') });
    const theme = select(t('theme.label'), THEMES.map((one) => [one, t(THEME_NAMES[one])]), prefs.theme, (chosen) => {
      keep({ theme: chosen as Theme });
      applyTheme();
    });
    const known = languages();
    const names = new Intl.DisplayNames(known, { type: 'language' });
    const tongue = select(t('language.label'), known.map((code) => [code, names.of(code) ?? code]), language(), (chosen) => {
      keep({ language: chosen });
      void speak(chosen).then(() => this.wishes.translate());
    });
    const out = site?.user ? button(t('nav.log_out', { user: site.user }), () => this.wishes.logOut()) : null;
    put(this.tools, this.time, zone, theme, known.length > 1 ? tongue : null, out);
  }

  private rezone(): void {
    keep({ utc: !prefs.utc });
    mark(this.tools.querySelector('[aria-pressed]') as Element, 'aria-pressed', String(prefs.utc));
    this.tick();
    this.wishes.retime();
  }

  private tick(): void {
    const clock = new Clock(prefs.utc);
    say(this.time, `${clock.time(Date.now())} ${clock.zone}`);
  }
}

function select(label: string, options: readonly (readonly [string, string])[], chosen: string, onchoose: (value: string) => void): HTMLElement {
  const found = h('select', { 'aria-label': label, title: label, onchange: () => onchoose(found.value) });
  found.append(...options.map(([value, text]) => h('option', { value, selected: value === chosen }, text)));
  return found;
}

function applyTheme(): void {
  mark(document.documentElement, 'data-theme', prefs.theme === 'auto' ? null : prefs.theme);
  repaint();
}
