import { describe, expect, it } from 'vitest';

import { filesOf } from '../src/dropping';

const file = (path: string) => ({ isFile: true, fullPath: path, file: (done: (found: File) => void) => done(new File(['x'], path)) });

/** A folder as a browser reads it: a hundred entries at a time. */
function folder(path: string, entries: unknown[]): unknown {
  const parts = [...Array(Math.ceil(entries.length / 100)).keys()].map((i) => entries.slice(100 * i, 100 * i + 100));
  const createReader = () => ({ readEntries: (done: (found: unknown[]) => void) => done(parts.shift() ?? []) });
  return { isFile: false, fullPath: path, createReader };
}

const dropped = (...entries: unknown[]): DataTransfer =>
  ({ items: entries.map((entry) => ({ webkitGetAsEntry: () => entry, getAsFile: () => null })) }) as unknown as DataTransfer;

describe('what is dropped', () => {
  it('is all files of a folder and of those in it', async () => {
    const many = [...Array(250).keys()].map((i) => file(`/bag/mesh_${i}.stl`));
    const found = await filesOf(dropped(file('/run.csv'), folder('/bag', [...many, folder('/bag/deep', [file('/bag/deep/a.db3')])])));
    expect(found.size).toBe(252);
    expect([...found.keys()]).toContain('bag/deep/a.db3');
  });

  it('may be a file that is nowhere on the disk', async () => {
    const items = [{ webkitGetAsEntry: () => null, getAsFile: () => new File(['t'], 'made.csv') }];
    expect([...(await filesOf({ items } as unknown as DataTransfer)).keys()]).toEqual(['made.csv']);
  });
});
