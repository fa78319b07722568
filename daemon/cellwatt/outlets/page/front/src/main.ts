/** The page: who asks, where it is, and the view that belongs there. */

import 'uplot/dist/uPlot.min.css';
import './styles/page.css';

import { logOut, Refused, site as readSite } from './api';
import { Cell } from './cell';
import { Clock } from './clock';
import { h, put } from './dom';
import { takeDrops, type Files } from './dropping';
import { severityWord } from './icons';
import { followSystem } from './palette';
import { prefs } from './prefs';
import { cellPath, parse, Router, type Part, type Place } from './router';
import { Shell } from './shell';
import type { Site } from './shapes';
import { language, speak, t } from './texts';
import type { CellView, Surroundings, View } from './view';
import { alarmsView } from './views/alarms';
import { energyView } from './views/energy';
import { loginView } from './views/login';
import { mismatchView } from './views/mismatch';
import { overviewView } from './views/overview';
import { plantView } from './views/plant';
import { recordingsView } from './views/recordings';
import { reportsView } from './views/reports';

const VIEWS: Readonly<Record<Part, CellView>> = {
  overview: overviewView,
  alarms: alarmsView,
  energy: energyView,
  mismatch: mismatchView,
  reports: reportsView,
};
/** ms until the first answer is asked for again. */
const AGAIN = 3000;

class Page {
  private site: Site | null = null;
  private cell: Cell | null = null;
  private view: View | null = null;
  private before = '/';
  private dropped: Files | null = null;
  private asking: ReturnType<typeof setTimeout> | undefined;
  private shell: Shell;
  private readonly router = new Router((place) => this.show(place));

  constructor(private readonly root: HTMLElement) {
    this.shell = this.frame();
    takeDrops(() => Boolean(this.site?.may_drop), (files) => {
      this.dropped = files;
      if (parse(location.pathname).view === 'recordings') this.router.show();
      else this.router.go('/recordings');
    });
  }

  /** Ask who we are, until there is an answer, and show the place of the address bar. */
  async start(): Promise<void> {
    try {
      this.site = await readSite();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      this.shell.connection(false);
      setTimeout(() => void this.start(), AGAIN);
      return;
    }
    this.shell.connection(true);
    this.router.show();
  }

  private frame(): Shell {
    document.documentElement.lang = language();
    const translate = (): void => {
      this.shell = this.frame();
      this.router.show();
    };
    return new Shell(this.root, { retime: () => this.view?.retime?.(), translate, logOut: () => void this.leave() });
  }

  private show(place: Place): void {
    const site = this.site;
    if (!site) return;
    if (site.login_needed && place.view !== 'login') {
      this.before = location.pathname + location.search;
      return this.router.go('/login', true);
    }
    if (place.view === 'start') {
      const only = site.mode === 'cell' ? site.cells[0] : undefined;
      return this.router.go(only ? cellPath(only.site, only.cell) : site.mode === 'plant' ? '/plant' : '/recordings', true);
    }
    const moved = this.view !== null;
    this.view?.close();
    this.view = null;
    put(this.shell.main);
    if (moved) this.shell.main.focus({ preventScroll: true });
    this.follow(place);
    this.shell.show(site, place, this.cell);
    if (this.cell) this.shell.state(this.cell);
    this.view = this.made(place);
    document.title = this.view ? `${this.view.title} – cellwatt` : 'cellwatt';
  }

  private made(place: Place): View | null {
    const around: Surroundings = {
      site: this.site as Site,
      clock: () => new Clock(prefs.utc),
      go: (path) => this.router.go(path),
      enter: () => this.enter(),
    };
    const main = this.shell.main;
    if (place.view === 'cell' && this.cell) {
      if (place.part !== 'overview') this.cell.follow([], 1);
      return VIEWS[place.part](main, this.cell, around);
    }
    if (place.view === 'plant') return plantView(main, around, (live) => this.connected(live));
    if (place.view === 'recordings') {
      const files = this.dropped;
      this.dropped = null;
      return recordingsView(main, around, place.name, files);
    }
    if (place.view === 'login') return loginView(main, around);
    put(main, h('h1', {}, t('page.unknown')), h('p', {}, h('a', { href: '/' }, t('page.home'))));
    return null;
  }

  /** Follow the cell of a place, and no other. */
  private follow(place: Place): void {
    const wanted = place.view === 'cell' ? place : null;
    if (wanted && this.cell?.site === wanted.site && this.cell.name === wanted.cell) return;
    this.cell?.close();
    this.cell = null;
    this.connected(true);
    if (!wanted) return;
    const cell = (this.cell = new Cell(wanted.site, wanted.cell));
    const shown = (): void => this.shell.state(cell);
    cell.on('state', shown);
    cell.on('health', shown);
    cell.on('alarm', ({ alarm, isNew }) => {
      shown();
      if (isNew) this.shell.announce(t('alarm.new', { severity: severityWord(alarm.severity), statement: alarm.statement }), alarm.severity === 'error');
    });
    cell.on('connection', (state) => this.connected(state !== 'lost'));
    cell.on('refused', (error) => {
      if (error.status === 401) void this.enter();
      else if (error.status === 404) this.lack(cell, error.message);
      else if (error.message) this.shell.connection(false, error.message);
    });
  }

  /** Say that there is no such cell. */
  private lack(cell: Cell, why: string): void {
    this.view?.close();
    this.view = null;
    cell.close();
    this.shell.connection(true);
    put(this.shell.main, h('h1', {}, t('page.no_cell')), h('p', {}, why), h('p', {}, h('a', { href: '/' }, t('page.home'))));
  }

  private connected(live: boolean): void {
    this.shell.connection(live);
    clearTimeout(this.asking);
    if (!live) void this.still();
  }

  /** A stream that ended may mean that the login did: ask, until the stream is back. */
  private async still(): Promise<void> {
    this.asking = setTimeout(() => void this.still(), AGAIN);
    const found = await readSite().catch(() => null);
    if (found?.login_needed && !this.site?.login_needed) await this.enter();
    else if (found) this.site = found;
  }

  private async enter(): Promise<void> {
    this.site = await readSite();
    const here = parse(location.pathname).view === 'login';
    if (!this.site.login_needed && here) this.router.go(this.before, true);
    else this.router.show();
  }

  private async leave(): Promise<void> {
    await logOut().catch(() => undefined);
    this.cell?.close();
    this.cell = null;
    await this.enter();
  }
}

followSystem();
const wanted = prefs.language || navigator.language.slice(0, 2);
void speak(wanted).then(() => new Page(document.getElementById('page') as HTMLElement).start());
