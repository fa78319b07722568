/** What a view is given, and what it gives back. */

import type { Cell } from './cell';
import type { Clock } from './clock';
import type { Site } from './shapes';

export interface Surroundings {
  site: Site;
  clock(): Clock;
  /** Go to a path of the page. */
  go(path: string): void;
  /** Read anew who has logged in, and show what is to be shown then. */
  enter(): Promise<void>;
}

/** A view fills an element and says how it ends; `retime` is called when times are to be shown in another zone. */
export interface View {
  title: string;
  close(): void;
  retime?(): void;
}

export type CellView = (root: HTMLElement, cell: Cell, around: Surroundings) => View;

/** Ends, called together. */
export class Ends {
  private readonly kept: (() => void)[] = [];

  add(...ends: (() => void)[]): void {
    this.kept.push(...ends);
  }

  call(): void {
    this.kept.splice(0).forEach((end) => end());
  }
}
