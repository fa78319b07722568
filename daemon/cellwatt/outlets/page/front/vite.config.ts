import { createHash } from 'node:crypto';
import { readFileSync, readdirSync, writeFileSync } from 'node:fs';
import { join, relative, resolve, sep } from 'node:path';
import { defineConfig, type Plugin } from 'vite';

const FRONT = import.meta.dirname;
const STATIC = resolve(FRONT, '../static');

/** Paths of all source files below `front`, sorted by code point. */
function sources(folder: string): string[] {
  const found = readdirSync(folder, { withFileTypes: true }).flatMap((entry) => {
    if (entry.name === 'node_modules') return [];
    const path = join(folder, entry.name);
    return entry.isDirectory() ? sources(path) : [relative(FRONT, path).split(sep).join('/')];
  });
  return found.sort((a, b) => (a < b ? -1 : 1));
}

/** SHA-256 over path, NUL, length in decimal digits, NUL and content of each source file. */
function digest(): string {
  const hash = createHash('sha256');
  for (const path of sources(FRONT)) {
    const content = readFileSync(join(FRONT, path));
    hash.update(`${path}\0${content.length}\0`).update(content);
  }
  return hash.digest('hex');
}

/** Size and SHA-256 of each built file. */
function built(folder: string): Record<string, { bytes: number; sha256: string }> {
  const files: Record<string, { bytes: number; sha256: string }> = {};
  const walk = (at: string): void => {
    for (const entry of readdirSync(at, { withFileTypes: true })) {
      const path = join(at, entry.name);
      if (entry.isDirectory()) walk(path);
      else if (entry.name !== 'manifest.json') {
        const content = readFileSync(path);
        const name = relative(folder, path).split(sep).join('/');
        files[name] = { bytes: content.length, sha256: createHash('sha256').update(content).digest('hex') };
      }
    }
  };
  walk(folder);
  return Object.fromEntries(Object.entries(files).sort(([a], [b]) => (a < b ? -1 : 1)));
}

/** Writes what the page was built from, and the licence of what is built in. */
function record(): Plugin {
  return {
    name: 'record',
    apply: 'build',
    closeBundle() {
      const licence = readFileSync(join(FRONT, 'node_modules/uplot/LICENSE'), 'utf8');
      writeFileSync(join(STATIC, 'licences.txt'), `uPlot\n\n${licence}`);
      const manifest = { sources_sha256: digest(), files: built(STATIC) };
      writeFileSync(join(STATIC, 'manifest.json'), `${JSON.stringify(manifest, null, 1)}\n`);
    },
  };
}

export default defineConfig({
  root: FRONT,
  plugins: [record()],
  build: {
    outDir: STATIC,
    emptyOutDir: true,
    target: ['chrome100', 'firefox104', 'safari15.4'],
    modulePreload: { polyfill: false },
    assetsInlineLimit: 0,
  },
  server: { proxy: { '/api': process.env['CELL'] ?? 'http://127.0.0.1:8080' } },
});
