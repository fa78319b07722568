/** What a browser remembers: theme, zone, language, the name of who acknowledges, and channels by cell. */

export type Theme = 'auto' | 'dark' | 'light';

export interface Prefs {
  theme: Theme;
  utc: boolean;
  language: string;
  name: string;
}

const KEY = 'cellwatt';
const FRESH: Prefs = { theme: 'auto', utc: false, language: '', name: '' };

/** Preferences of this browser; without storage they hold until the page is left. */
export const prefs: Prefs = { ...FRESH, ...read<Partial<Prefs>>(KEY, {}) };

/** Keep the preferences. */
export function keep(changes: Partial<Prefs>): void {
  Object.assign(prefs, changes);
  write(KEY, prefs);
}

/** Channels that were chosen for a cell, null if none ever were. */
export function keptChannels(cell: string): string[] | null {
  const found = read<unknown>(`${KEY}:${cell}`, null);
  return Array.isArray(found) ? found.filter((name): name is string => typeof name === 'string') : null;
}

/** Keep the channels of a cell. */
export function keepChannels(cell: string, channels: readonly string[]): void {
  write(`${KEY}:${cell}`, channels);
}

function read<T>(key: string, otherwise: T): T {
  try {
    return (JSON.parse(localStorage.getItem(key) ?? 'null') as T | null) ?? otherwise;
  } catch {
    return otherwise;
  }
}

function write(key: string, value: unknown): void {
  try {
    localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // A browser that stores nothing still shows everything.
  }
}
