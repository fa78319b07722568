/** Least and most of each step as a column of pixels: quick to draw, whatever is in a step. */

import type uPlot from 'uplot';

import { pale } from '../palette';

/** Height, px, that a column has at least, and from which on others are seen through it. */
const THIN = 2;
const TALL = 8;
/** Of a dashed series: columns drawn, px, and left out. */
const [ON, OFF] = [7, 4];

export interface Look {
  colour: string;
  dashed: boolean;
  /** True where each step has two points, the least and the most; else it has one. */
  pairs: boolean;
}

/** Draw a series; each column reaches to the one before it, so that they make a line. */
export function drawColumns(u: uPlot, series: number, look: Look): void {
  const { ctx, bbox, scales } = u;
  const [times, values] = [u.data[0], u.data[series] as (number | null | undefined)[]];
  const stride = look.pairs ? 2 : 1;
  const [from, to] = [scales['x']?.min ?? 0, scales['x']?.max ?? 1];
  const [bottom, top] = [scales['y']?.min ?? 0, scales['y']?.max ?? 1];
  const wide = bbox.width / (to - from || 1);
  const high = bbox.height / (top - bottom || 1);
  const [thin, tall] = [THIN * devicePixelRatio, TALL * devicePixelRatio];
  const [on, all] = [ON * devicePixelRatio, (ON + OFF) * devicePixelRatio];
  const [full, clear] = [pale(look.colour, 0.95), pale(look.colour, look.dashed ? 0.4 : 0.65)];
  const step = times.length > stride ? times[stride]! - times[0]! : 0;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  let [lowBefore, highBefore] = [NaN, NaN];
  for (let i = 0; i + stride <= times.length; i += stride) {
    const [low, most] = [values[i], values[i + stride - 1]];
    if (low === undefined || most === undefined) continue;
    if (low === null || most === null) {
      lowBefore = highBefore = NaN;
      continue;
    }
    const least = highBefore < low ? highBefore : low;
    const greatest = lowBefore > most ? lowBefore : most;
    [lowBefore, highBefore] = [low, most];
    const x = Math.round(bbox.left + (times[i]! - from) * wide);
    const end = Math.round(bbox.left + (times[i]! + step - from) * wide);
    const height = (greatest - least) * high;
    if (look.dashed && height <= tall && (x - bbox.left) % all >= on) continue;
    const drawn = Math.max(thin, height);
    const y = bbox.top + bbox.height - (greatest - bottom) * high - (drawn - height) / 2;
    ctx.fillStyle = (most - low) * high > tall ? clear : full;
    ctx.fillRect(x, Math.round(y), Math.max(1, end - x), Math.round(drawn));
  }
  ctx.restore();
}
