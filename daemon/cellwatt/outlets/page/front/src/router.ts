/** Addresses of the page's views. */

export type Part = 'overview' | 'alarms' | 'energy' | 'mismatch' | 'reports';
export type Place =
  | { view: 'start' }
  | { view: 'plant' }
  | { view: 'login' }
  | { view: 'recordings'; name: string | null }
  | { view: 'cell'; site: string; cell: string; part: Part }
  | { view: 'unknown' };

export const PARTS: readonly Part[] = ['overview', 'alarms', 'energy', 'mismatch', 'reports'];

/** The place that a path names. */
export function parse(path: string): Place {
  const [first = '', site, cell, part = 'overview', ...rest] = path.split('/').slice(1).map(decoded);
  if (first === '' && site === undefined) return { view: 'start' };
  if ((first === 'plant' || first === 'login') && site === undefined) return { view: first };
  if (first === 'recordings' && cell === undefined) return { view: first, name: site || null };
  if (first === 'cell' && site && cell && !rest.length && (PARTS as readonly string[]).includes(part)) {
    return { view: 'cell', site, cell, part: part as Part };
  }
  return { view: 'unknown' };
}

/** Path of a part of a cell. */
export function cellPath(site: string, cell: string, part: Part = 'overview'): string {
  const root = `/cell/${encodeURIComponent(site)}/${encodeURIComponent(cell)}`;
  return part === 'overview' ? root : `${root}/${part}`;
}

/** Follows the browser's history; `onplace` is called with each place, also the first. */
export class Router {
  constructor(private readonly onplace: (place: Place) => void) {
    addEventListener('popstate', () => this.show());
    document.addEventListener('click', (event) => this.clicked(event));
  }

  /** Go to a path. */
  go(path: string, replace = false): void {
    if (replace) history.replaceState(null, '', path);
    else history.pushState(null, '', path);
    this.show();
    scrollTo(0, 0);
  }

  /** Show the place that the address bar names. */
  show(): void {
    this.onplace(parse(location.pathname));
  }

  private clicked(event: MouseEvent): void {
    const link = (event.target as Element | null)?.closest<HTMLAnchorElement>('a[href]');
    const plain = event.button === 0 && !event.metaKey && !event.ctrlKey && !event.shiftKey && !event.altKey;
    if (!link || !plain || event.defaultPrevented || link.target || link.origin !== location.origin) return;
    if (parse(link.pathname).view === 'unknown' || link.hash) return;
    event.preventDefault();
    this.go(link.pathname + link.search);
  }
}

/** Value of a name in the address bar's query. */
export function asked(name: string): string | null {
  return new URLSearchParams(location.search).get(name);
}

/** Put values into the address bar's query, or take those that are null out of it. */
export function note(values: Readonly<Record<string, string | null>>): void {
  const query = new URLSearchParams(location.search);
  for (const [name, value] of Object.entries(values)) {
    if (value === null) query.delete(name);
    else query.set(name, value);
  }
  const text = query.toString().replaceAll('%2C', ',').replaceAll('%2F', '/');
  history.replaceState(null, '', location.pathname + (text ? `?${text}` : ''));
}

function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
