import { beforeEach, describe, expect, it } from 'vitest';

import { Stream, type Connection, type Events, type Surroundings } from '../src/stream';

class Source implements Events {
  readyState = 0;
  closed = false;
  private readonly takers = new Map<string, ((event: MessageEvent<string>) => void)[]>();

  constructor(readonly address: string) {}

  addEventListener(type: string, take: (event: MessageEvent<string>) => void): void {
    this.takers.set(type, [...(this.takers.get(type) ?? []), take]);
  }

  close(): void {
    this.closed = true;
  }

  fire(type: string, data: unknown = null): void {
    for (const take of this.takers.get(type) ?? []) take({ data: JSON.stringify(data) } as MessageEvent<string>);
  }
}

let sources: Source[];
let timers: Map<number, { act: () => void; ms: number }>;
let states: Connection[];
let opened: boolean[];
let show: (visible: boolean) => void;
let watched: boolean;
let frames: unknown[];
let alive: () => Promise<unknown>;
let world: Surroundings;

const newest = (): Source => sources.at(-1) as Source;
const elapse = (ms: number): void => {
  for (const [key, timer] of [...timers]) if (timer.ms === ms && timers.delete(key)) timer.act();
};
const follow = (): Stream =>
  new Stream('/stream', { frames: (batch: unknown) => void frames.push(batch) }, (state) => void states.push(state), (missed) => void opened.push(missed), world);

beforeEach(() => {
  sources = [];
  timers = new Map();
  states = [];
  frames = [];
  opened = [];
  watched = false;
  let last = 0;
  alive = () => Promise.resolve();
  world = {
    open: (address) => {
      sources.push(new Source(address));
      return newest();
    },
    later: (act, ms) => {
      timers.set(++last, { act, ms });
      return last;
    },
    never: (timer) => void timers.delete(timer as number),
    alive: () => alive(),
    visible: (take) => {
      [show, watched] = [take, true];
      take(true);
      return () => void (watched = false);
    },
  };
});

describe('a stream', () => {
  it('passes on what comes', () => {
    follow();
    newest().fire('open');
    newest().fire('frames', { t: [1] });
    expect(frames).toEqual([{ t: [1] }]);
    expect(states).toEqual(['live']);
    expect(opened).toEqual([false]);
  });

  it('tells that it was lost, and reads anew when the browser has it back', () => {
    follow();
    newest().fire('open');
    newest().fire('error');
    expect(states).toEqual(['live', 'lost']);
    expect(sources).toHaveLength(1);
    newest().fire('open');
    expect(states).toEqual(['live', 'lost', 'live']);
    expect(opened).toEqual([false, true]);
  });

  it('tries again by itself where the browser gave up, each time after twice as long', () => {
    follow();
    for (const wait of [1000, 2000, 4000, 8000, 15_000, 15_000]) {
      newest().readyState = 2;
      newest().fire('error');
      expect([...timers.values()].map((timer) => timer.ms)).toEqual([wait]);
      elapse(wait);
    }
    expect(sources).toHaveLength(7);
    newest().fire('open');
    expect(opened).toEqual([true]);
    newest().readyState = 2;
    newest().fire('error');
    expect([...timers.values()].map((timer) => timer.ms)).toEqual([1000]);
  });

  it('opens anew when a silent line turns out to be dead', async () => {
    follow();
    newest().fire('open');
    alive = () => Promise.reject(new Error('no answer'));
    elapse(15_000);
    await Promise.resolve().then(() => undefined);
    expect(states).toEqual(['live', 'lost']);
    expect(sources).toHaveLength(2);
    expect(sources[0]?.closed).toBe(true);
  });

  it('lets a silent line be while the server answers', async () => {
    follow();
    newest().fire('open');
    elapse(15_000);
    await Promise.resolve().then(() => undefined);
    expect(states).toEqual(['live']);
    expect(sources).toHaveLength(1);
    expect(timers.size).toBe(1);
  });

  it('hears nothing more of an address that it has left', () => {
    const stream = follow();
    const first = newest();
    first.fire('open');
    stream.turn('/stream?channels=a');
    first.fire('frames', { t: [1] });
    first.fire('error');
    expect(first.closed).toBe(true);
    expect(newest().address).toBe('/stream?channels=a');
    expect(frames).toEqual([]);
    expect(states).toEqual(['live']);
    newest().fire('open');
    expect(opened).toEqual([false, false]);
  });

  it('leaves its connection to other tabs while nobody sees the page', () => {
    const stream = follow();
    newest().fire('open');
    show(false);
    show(true);
    elapse(5000);
    expect(newest().closed).toBe(false);
    show(false);
    elapse(5000);
    expect([newest().closed, timers.size]).toEqual([true, 0]);
    stream.turn('/stream?channels=a');
    expect(sources).toHaveLength(1);
    show(true);
    newest().fire('open');
    expect([sources.length, newest().address, opened]).toEqual([2, '/stream?channels=a', [false, true]]);
    expect(states).toEqual(['live']);
  });

  it('leaves nothing behind when it is closed', () => {
    const stream = follow();
    newest().fire('open');
    stream.close();
    newest().fire('error');
    expect([newest().closed, watched]).toEqual([true, false]);
    expect(timers.size).toBe(0);
    expect(states).toEqual(['live']);
  });
});
