/** Texts of the page by language: `texts/en.json` has all of them, another file there may have any of them. */

import english from './texts/en.json';

export type Key = keyof typeof english;
export type Values = Readonly<Record<string, string | number>>;
type Texts = Readonly<Record<Key, string>>;
type Load = () => Promise<Partial<Texts>>;

const others = import.meta.glob<Partial<Texts>>(['./texts/*.json', '!./texts/en.json'], { import: 'default' });
let texts: Texts = english;
let chosen = 'en';

/** The text of a key, with `{name}` replaced by the value of that name. */
export function t(key: Key, values: Values = {}): string {
  return filled(texts[key], values);
}

/** The text for one, or for any other number of things; the number is its value `n`. */
export function counted(n: number, one: Key, many: Key): string {
  return t(n === 1 ? one : many, { n });
}

/** A text with `{name}` replaced by the value of that name. */
export function filled(text: string, values: Values): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** Codes of all languages. */
export function languages(files: Readonly<Record<string, Load>> = others): string[] {
  return ['en', ...Object.keys(files).map((path) => code(path))].sort();
}

/** Code of the language in use. */
export function language(): string {
  return chosen;
}

/** Use a language, as far as there are texts in it. */
export async function speak(wanted: string, files: Readonly<Record<string, Load>> = others): Promise<void> {
  const found = Object.entries(files).find(([path]) => code(path) === wanted);
  texts = found ? { ...english, ...(await found[1]()) } : english;
  chosen = found ? wanted : 'en';
}

function code(path: string): string {
  return path.replace(/^.*\//, '').replace(/\.json$/, '');
}
