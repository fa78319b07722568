/** Recordings that were dropped: their curves, and what `explain` finds with the simulation that is chosen for them. */

import { drawn, drop, dropped, drops, explain, Refused, sample, send } from '../api';
import { filesIn, type Files } from '../dropping';
import { button, choice, h, put, say } from '../dom';
import type { Drop, DropKind } from '../shapes';
import { t, type Key } from '../texts';
import type { Surroundings, View } from '../view';

const KINDS: Readonly<Record<DropKind, Key>> = {
  recording: 'drop.recording',
  simulation: 'drop.simulation',
  robot: 'drop.robot',
  other: 'drop.other',
};
/** Files of a drop. */
const MOST = 200;
/** ms between two looks at what `explain` does. */
const AGAIN = 1000;

/** Path of a drop's page. */
export const dropPath = (name: string): string => `/recordings/${name}`;

/** The page of a drop, or, without its name, the one that asks for one. `files` have just been dropped. */
export function recordingsView(root: HTMLElement, around: Surroundings, name: string | null, files: Files | null): View {
  const view = name === null ? new Asking(root, around) : new Opened(root, around, name);
  if (files?.size) void view.take(files);
  return { title: t('drop.title'), close: () => view.close() };
}

/** Asks for files. */
class Asking {
  protected readonly problem = h('p', { class: 'problem', role: 'alert' });
  protected readonly busy = h('p', { class: 'quiet', role: 'status' });
  protected open = true;

  constructor(
    protected readonly root: HTMLElement,
    protected readonly around: Surroundings,
  ) {
    this.show();
  }

  /** Send files, and show them. */
  async take(files: Files): Promise<void> {
    if (files.size > MOST) return say(this.problem, t('drop.too_many', { n: files.size, most: MOST }));
    await this.tried(async () => {
      const name = await drop(sizes(files), this.into(files));
      let sent = 0;
      for (const [path, file] of files) {
        say(this.busy, t('drop.sending', { path, n: ++sent, all: files.size }));
        await send(name, path, file);
      }
      this.around.go(dropPath(name));
    });
  }

  close(): void {
    this.open = false;
  }

  /** Name of the drop to which files are added; none begins another. */
  protected into(_files: Files): string | null {
    return null;
  }

  protected show(): void {
    const earlier = h('ul', { class: 'quiet' });
    put(
      this.root,
      h('h1', {}, t('drop.title')),
      h('p', { class: 'quiet lead' }, t('drop.what')),
      h(
        'div',
        { class: 'card dropzone' },
        h('p', { class: 'empty' }, t('drop.here')),
        h('div', { class: 'offers' }, chooser(t('drop.choose'), (files) => void this.take(files)), button(t('drop.sample'), () => void this.sample(), { class: 'primary' })),
        h('p', { class: 'quiet' }, t('drop.sample_is')),
        this.busy,
        this.problem,
      ),
      earlier,
    );
    void this.tried(async () => {
      const { drops: names } = await drops();
      put(earlier, ...names.map((name) => h('li', {}, h('a', { href: dropPath(name) }, t('drop.earlier', { name })))));
    });
  }

  private async sample(): Promise<void> {
    say(this.busy, t('drop.sample_made'));
    await this.tried(async () => this.around.go(dropPath((await sample()).name)));
  }

  /** Do something; say what refuses it. */
  protected async tried(work: () => Promise<unknown>): Promise<void> {
    say(this.problem, '');
    try {
      await work();
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      say(this.problem, error.message || t('connection.lost'));
    } finally {
      say(this.busy, '');
    }
  }
}

/** Shows the files of a drop. */
class Opened extends Asking {
  private readonly curves = h('div', { class: 'drawn' });
  private readonly answer = h('div', {});
  private readonly kinds = new Map<string, DropKind>();
  private started = h('button', { type: 'button', class: 'primary' });

  constructor(
    root: HTMLElement,
    around: Surroundings,
    private readonly name: string,
  ) {
    super(root, around);
    void this.tried(async () => this.fill(await dropped(name)));
  }

  protected override into(files: Files): string | null {
    const names = [...files.keys()].map((path) => path.split('/').at(-1) ?? path);
    return names.some((name) => /\.(csv|tsv|parquet|mcap|db3)$/i.test(name)) ? null : this.name;
  }

  protected override show(): void {
    put(this.root, h('h1', {}, t('drop.title')), this.busy, this.problem);
    say(this.busy, t('page.reading'));
  }

  private fill(drop: Drop): void {
    const kindOf = ({ path, kind }: Drop['items'][number]): DropKind => this.kinds.get(path) ?? kind;
    drop.items.forEach((item) => this.kinds.set(item.path, kindOf(item)));
    const drawable = drop.items.filter((item) => kindOf(item) === 'recording' || (kindOf(item) === 'simulation' && !simulator(item.path)));
    const pick = choice(t('drop.curves'), drawable.map(({ path }) => [path, path] as const), (path) => void this.draw(path, pick.set));
    this.started = button(t('drop.explain'), () => void this.begin(), { class: 'primary' });
    const rows = drop.items.map((item) => h('tr', {}, h('th', { scope: 'row' }, item.path), h('td', {}, this.select(item.path, kindOf(item), drawable.length ? null : drop))));
    const lacking = drop.items.some((item) => kindOf(item) === 'simulation') ? null : h('p', {}, t('drop.simulation_needed'));
    put(
      this.root,
      h('h1', {}, t('drop.title')),
      h('p', { class: 'quiet lead' }, h('a', { href: '/recordings' }, t('drop.others'))),
      this.busy,
      this.problem,
      h('section', { class: 'card' }, h('div', { class: 'head' }, h('h2', {}, t('drop.curves')), drawable.length > 1 ? pick.element : null), this.curves),
      h(
        'section',
        { class: 'card' },
        h('h2', {}, t('drop.explain_with')),
        h('p', { class: 'quiet' }, t('drop.explain_is')),
        h('table', { class: 'dropped' }, h('tbody', {}, ...rows)),
        lacking,
        h('div', { class: 'offers' }, this.started, chooser(t('drop.add'), (files) => void this.take(files))),
        this.answer,
      ),
    );
    this.tell(drop);
    if (drawable[0]) void this.draw(drawable[0].path, pick.set);
    else put(this.curves, h('p', { class: 'quiet' }, t('drop.none')));
  }

  /** What a file is; `drop` is shown again after a choice. */
  private select(path: string, kind: DropKind, drop: Drop | null): HTMLElement {
    const choose = (): void => {
      this.kinds.set(path, found.value as DropKind);
      if (drop) this.fill(drop);
    };
    const found = h('select', { 'aria-label': path, onchange: choose });
    found.append(...Object.entries(KINDS).map(([value, key]) => h('option', { value, selected: value === kind }, t(key))));
    return found;
  }

  private async draw(path: string, set: (path: string) => void): Promise<void> {
    set(path);
    put(this.curves, h('p', { class: 'quiet', role: 'status' }, t('drop.drawing', { path })));
    try {
      put(this.curves, h('iframe', { src: await drawn(this.name, path), title: t('drop.curves_of', { path }) }));
    } catch (error) {
      if (error instanceof Refused) put(this.curves, h('p', { class: 'problem', role: 'alert' }, error.message || t('connection.lost')));
    }
  }

  private async begin(): Promise<void> {
    const of = (kind: DropKind): string[] => [...this.kinds].filter(([, one]) => one === kind).map(([path]) => path);
    await this.tried(async () => {
      await explain(this.name, of('recording'), of('simulation'), of('robot')[0] ?? null);
      this.tell(await dropped(this.name));
    });
  }

  /** Show what `explain` says, until it has ended. */
  private tell(drop: Drop): void {
    const found = drop.answer;
    this.started.disabled = Boolean(found?.running);
    if (!found) return put(this.answer);
    if (found.running) {
      put(this.answer, h('p', { role: 'status', class: 'quiet' }, t('drop.explaining', { said: found.said })));
      setTimeout(() => void this.again(), AGAIN);
      return;
    }
    const address = (file: string): string => `/api/recordings/${this.name}/result/${encodeURIComponent(file)}`;
    const report = found.files.includes('report.html') ? 'report.html' : null;
    const links = found.files.filter((file) => file !== report).map((file) => h('a', { href: address(file), download: file }, file));
    put(
      this.answer,
      h('p', { class: 'problem', role: 'alert' }, found.error),
      report && h('a', { class: 'button', href: address(report), target: '_blank', rel: 'noopener' }, t('drop.report')),
      found.said && h('pre', { tabindex: 0 }, found.said),
      drop.note && h('p', {}, h('b', {}, t('drop.concealed')), ` ${drop.note}`),
      links.length > 0 && h('p', { class: 'files' }, t('drop.files'), ...links.flatMap((link) => [' ', link])),
    );
  }

  private async again(): Promise<void> {
    if (this.open) await this.tried(async () => this.tell(await dropped(this.name)));
  }
}

/** True of a file that a simulator runs, not a table of what it said. */
function simulator(path: string): boolean {
  return /\.(xml|mjcf|urdf)$/i.test(path);
}

function sizes(files: Files): Record<string, number> {
  return Object.fromEntries([...files].map(([path, file]) => [path, file.size]));
}

/** A button that opens the dialog of files. */
function chooser(text: string, onfiles: (files: Files) => void): HTMLElement {
  const input = h('input', { type: 'file', multiple: true, hidden: true, 'aria-label': text, onchange: () => onfiles(filesIn(input.files)) });
  return h('span', {}, input, button(text, () => input.click()));
}
