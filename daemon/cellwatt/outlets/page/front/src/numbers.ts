/** Numbers as people read them. */

const NONE = '–';
const PREFIXES: readonly (readonly [number, string])[] = [
  [1e6, 'M'],
  [1e3, 'k'],
];
const SCALED = new Set(['W', 'J', 'V', 'A', 'Hz', 'B']);

/** A number with about three significant digits, `–` where there is none. */
export function figure(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) return value.toExponential(digits - 1);
  const after = size === 0 ? 0 : Math.max(0, Math.min(6, digits - 1 - Math.floor(Math.log10(size))));
  const text = value.toFixed(after);
  return /^-0(\.0*)?$/.test(text) ? text.slice(1) : text;
}

/** A number and its unit, large ones with k or M. */
export function quantity(value: number | null | undefined, unit: string, digits = 3): string {
  const [number, shown] = parts(value, unit, digits);
  return number === NONE || !shown ? number : `${number} ${shown}`;
}

/** A number and its unit apart; those from `from` on get a k. */
export function parts(value: number | null | undefined, unit: string, digits = 3, from = 9999.5): [string, string] {
  if (value === null || value === undefined || !Number.isFinite(value)) return [NONE, unit];
  const size = Math.abs(value);
  const prefix = SCALED.has(unit) ? PREFIXES.find(([scale]) => size >= scale * (from / 1000)) : undefined;
  return prefix ? [figure(value / prefix[0], digits), prefix[1] + unit] : [figure(value, digits), unit];
}

/** A number as finely as it can be seen on a scale, with its unit. */
export function onScale(value: number | null | undefined, unit: string, scale?: { min?: number; max?: number }): string {
  const range = (scale?.max ?? 0) - (scale?.min ?? 0);
  if (value === null || value === undefined || !(range > 0) || range > 3000 || range < 1e-3) return quantity(value, unit);
  const text = value.toFixed(Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(range)))));
  return `${/^-0(\.0*)?$/.test(text) ? text.slice(1) : text} ${unit}`.trim();
}

/** Energy in kWh. */
export function kilowattHours(joule: number | null | undefined): string {
  return joule === null || joule === undefined ? NONE : `${figure(joule / 3.6e6)} kWh`;
}

/** A whole number with thin spaces between thousands. */
export function count(value: number): string {
  return String(Math.round(value)).replace(/\B(?=(\d{3})+$)/g, '\u202f');
}
