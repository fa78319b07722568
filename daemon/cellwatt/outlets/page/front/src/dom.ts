/** Elements, made and changed without any HTML text. */

type Value = string | number | boolean | null | undefined | ((event: never) => void);
export type Attributes = Readonly<Record<string, Value>>;
export type Child = Node | string | number | null | undefined | false;

const SVG = 'http://www.w3.org/2000/svg';

/** An HTML element; attributes that begin with `on` are listeners, true ones are empty, false ones are left out. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  return filledIn(document.createElement(tag), attributes, children);
}

/** An SVG element. */
export function svg(tag: string, attributes: Attributes = {}, ...children: Child[]): SVGElement {
  return filledIn(document.createElementNS(SVG, tag) as SVGElement, attributes, children);
}

function filledIn<E extends Element>(element: E, attributes: Attributes, children: Child[]): E {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === 'function') element.addEventListener(name.slice(2), value as EventListener);
    else if (value === true) element.setAttribute(name, '');
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  element.append(...present(children));
  return element;
}

/** Replace what is in an element. */
export function put(element: Element, ...children: Child[]): void {
  element.replaceChildren(...present(children));
}

/** Set the text of a node, if it is another. */
export function say(node: Node, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}

/** Set an attribute if it is another; null takes it away. */
export function mark(element: Element, name: string, value: string | null): void {
  if (element.getAttribute(name) === value) return;
  if (value === null) element.removeAttribute(name);
  else element.setAttribute(name, value);
}

/** Put elements into an order, moving only those that are elsewhere. */
export function reorder(list: Element, wanted: readonly Element[]): void {
  const kept = new Set(wanted);
  for (const element of [...list.children]) if (!kept.has(element)) element.remove();
  let next = list.firstElementChild;
  for (const element of wanted) {
    if (element === next) next = next.nextElementSibling;
    else list.insertBefore(element, next);
  }
}

/** A button with a text. */
export function button(text: string, onclick: () => void, more: Attributes = {}): HTMLButtonElement {
  return h('button', { type: 'button', onclick, ...more }, text);
}

/** A row of buttons of which one is pressed. */
export function choice<T>(
  label: string,
  options: readonly (readonly [T, string, string?])[],
  onchoose: (value: T) => void,
): { element: HTMLElement; set(value: T | null): void } {
  const buttons = options.map(([value, text, title]) =>
    button(text, () => onchoose(value), { 'aria-pressed': 'false', title, 'aria-label': title }),
  );
  const set = (value: T | null): void =>
    buttons.forEach((b, i) => mark(b, 'aria-pressed', String(options[i]?.[0] === value)));
  return { element: h('div', { class: 'choice', role: 'group', 'aria-label': label }, ...buttons), set };
}

function present(children: Child[]): (Node | string)[] {
  const found: (Node | string)[] = [];
  for (const child of children) {
    if (child !== null && child !== undefined && child !== false) found.push(typeof child === 'number' ? String(child) : child);
  }
  return found;
}
