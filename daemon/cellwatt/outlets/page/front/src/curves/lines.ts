/** Which channels are drawn in which chart. Pure. */

import type { CellState, Channel } from '../shapes';
import type { Line } from './chart';

/** Channels that may be shown at once, beside the power. */
export const MOST = 8;
const MEASURED = ['supply.power', 'bus.power'];
const SHOWN_FIRST = 6;

export interface Group {
  title: string;
  unit: string;
  lines: Line[];
}

/** Channels that measure what an arm draws, supplies first; where there are none, the first power there is. */
export function measuredPower(channels: readonly Channel[]): string[] {
  const watts = channels.filter((c) => c.unit === 'W').map((c) => c.name);
  const known = MEASURED.flatMap((name) => watts.filter((channel) => short(channel) === name));
  return known.length ? known : watts.slice(0, 1);
}

/** Outputs of models that are powers, as channels. */
export function predictedPower(state: CellState): string[] {
  return state.predictions.flatMap(({ model, outputs }) =>
    Object.entries(outputs)
      .filter(([, unit]) => unit === 'W')
      .map(([output]) => `prediction/${model}/${output}`),
  );
}

/** The first chart: measured power beside predicted. */
export function powerGroup(state: CellState, title: string, measured: string, predicted: string): Group | null {
  const names = measuredPower(state.channels);
  const models = predictedPower(state);
  if (!names.length && !models.length) return null;
  const lines = [
    ...names.map((name, i) => line(name, names.length > 1 ? `${measured} ${source(name)}` : measured, i)),
    ...models.map((name, i) => ({ ...line(name, label(name, models, predicted), names.length + i), dashed: true })),
  ];
  return { title, unit: 'W', lines };
}

/** The other charts: chosen channels, those of the same kind and unit together. */
export function groups(channels: readonly Channel[], chosen: readonly string[]): Group[] {
  const found = new Map<string, { unit: string; names: string[] }>();
  for (const channel of channels.filter((c) => chosen.includes(c.name))) {
    const key = `${last(channel.name)}\n${channel.unit}`;
    const group = found.get(key) ?? { unit: channel.unit, names: [] };
    found.set(key, group);
    group.names.push(channel.name);
  }
  return [...found.values()].map(({ unit, names }) => {
    const alone = names.length === 1;
    const title = alone ? (names[0] as string) : last(names[0] as string);
    const oneSource = new Set(names.map(source)).size === 1;
    const lines = names.map((name, i) => line(name, alone ? last(name) : within(name, oneSource), i));
    return { title: capital(title.replaceAll('_', ' ')), unit, lines };
  });
}

/** Channels that are shown where nobody has chosen any: positions of joints, else the first. */
export function firstChoice(channels: readonly Channel[]): string[] {
  const continuous = channels.filter((c) => c.kind === 'continuous');
  const joints = continuous.filter((c) => /joint_\d+\.position$/.test(c.name));
  return (joints.length ? joints : continuous).slice(0, SHOWN_FIRST).map((c) => c.name);
}

function line(name: string, label: string, place: number): Line {
  return { name, label, colour: `series-${place % MOST}` };
}

function label(name: string, all: readonly string[], predicted: string): string {
  if (all.length === 1) return predicted;
  const [, model, ...output] = name.split('/');
  return output.join('/') === 'power' ? `${predicted} ${model}` : `${output.join('/')} ${model}`;
}

function within(name: string, oneSource: boolean): string {
  const parts = (oneSource ? short(name) : name).split('.');
  return (parts.length > 1 ? parts.slice(0, -1) : parts).join(' ').replaceAll('_', ' ');
}

const capital = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);
const short = (name: string): string => name.slice(name.indexOf('.') + 1);
const source = (name: string): string => name.slice(0, name.indexOf('.'));
const last = (name: string): string => name.slice(name.lastIndexOf('.') + 1);
