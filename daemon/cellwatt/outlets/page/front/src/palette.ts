/** Colours of the style sheet, for canvases. */

let probe: HTMLElement | null = null;
const known = new Map<string, string>();
const listeners = new Set<() => void>();

/** A colour of the style sheet by its name, as it is in the theme in use. */
export function colour(name: string): string {
  let found = known.get(name);
  if (found === undefined) {
    probe ??= inDocument();
    probe.style.color = `var(--${name})`;
    found = getComputedStyle(probe).color;
    known.set(name, found);
  }
  return found;
}

/** A colour with an opacity from 0 to 1. */
export function pale(name: string, opacity: number): string {
  const numbers = colour(name).match(/[\d.]+/g) ?? ['128', '128', '128'];
  return `rgba(${numbers.slice(0, 3).join(',')},${opacity})`;
}

/** Call `act` when colours have changed; the answer ends that. */
export function onColours(act: () => void): () => void {
  listeners.add(act);
  return () => void listeners.delete(act);
}

/** Read all colours anew. */
export function repaint(): void {
  known.clear();
  for (const act of listeners) act();
}

/** Follow the theme of the system. */
export function followSystem(): void {
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', repaint);
}

function inDocument(): HTMLElement {
  const found = document.createElement('span');
  found.hidden = true;
  document.body.append(found);
  return found;
}
