/** Bars of several parts: what is above zero upwards, what is below downwards. Pure. */

export interface Piece {
  from: number;
  to: number;
}

/** Pieces of each bar in the order of its parts, and the range of all. */
export function stack(bars: readonly (readonly number[])[]): { bars: Piece[][]; low: number; high: number } {
  let low = 0;
  let high = 0;
  const pieces = bars.map((parts) => {
    let [up, down] = [0, 0];
    return parts.map((value) => {
      const from = value >= 0 ? up : down;
      const to = from + value;
      if (value >= 0) up = to;
      else down = to;
      low = Math.min(low, down);
      high = Math.max(high, up);
      return { from, to };
    });
  });
  return { bars: pieces, low, high };
}
