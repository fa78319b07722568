import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';

import { explain, Refused, site } from '../src/api';
import { Cell } from '../src/cell';
import type { Events, Surroundings } from '../src/stream';

type Take = (event: MessageEvent<string>) => void;
type Answer = { status?: number; body: unknown };

/** Answers of the server that have been asked for, in order: each is given by the test. */
let asked: { path: string; token: string | undefined; give(answer: Answer): Promise<void> }[];
let takers: Map<string, Take>;
let world: Surroundings;

const fire = (type: string, data: unknown = null): void => takers.get(type)?.({ data: JSON.stringify(data) } as MessageEvent<string>);
const settled = (): Promise<void> => new Promise((done) => setTimeout(done));
const alarm = (id: string, active = true): object => ({ id, active, severity: 'error', since: 1 });
const state = (alarms: object[], more: object = {}): Answer => ({
  body: { time: 1000, session: 1, status: {}, heard_age_s: 0, channels: [], alarms, shelved: [], intervals: [], task: null, energies: {}, predictions: [], arms: [], ...more },
});

beforeEach(() => {
  asked = [];
  takers = new Map();
  vi.stubGlobal('fetch', (path: string, init: RequestInit) => {
    const token = (init.headers as Record<string, string> | undefined)?.['X-CSRF-Token'];
    return new Promise((done, fail) => {
      init.signal?.addEventListener('abort', () => fail(new DOMException('', 'AbortError')));
      const give = ({ status = 200, body }: Answer): Promise<void> => (done(new Response(JSON.stringify(body), { status })), settled());
      asked.push({ path, token, give });
    });
  });
  world = {
    open: (): Events => ({ readyState: 0, addEventListener: (type, take) => void takers.set(type, take), close: () => undefined }),
    later: () => null,
    never: () => undefined,
    alive: () => Promise.resolve(),
    visible: (take) => (take(true), () => undefined),
  };
});

afterEach(() => vi.unstubAllGlobals());

describe('a cell', () => {
  it('loses no alarm that is raised or cleared while its state is being read', async () => {
    const cell = new Cell('s', 'c', world);
    expect(asked).toEqual([]);
    fire('open');
    fire('alarm', alarm('new'));
    fire('alarm', alarm('old', false));
    await asked[0]?.give(state([alarm('old')]));
    expect([...cell.alarms.keys()]).toEqual(['new']);
    fire('alarm', alarm('later'));
    expect([...cell.alarms.keys()]).toEqual(['new', 'later']);
  });

  it('reads anew what may have passed while the stream was turned to other channels', async () => {
    const cell = new Cell('s', 'c', world);
    const holes: string[] = [];
    cell.on('hole', (text) => holes.push(text));
    fire('open');
    await asked[0]?.give(state([]));
    cell.follow(['a'], 10);
    fire('open');
    await asked[1]?.give(state([alarm('between')]));
    expect([...cell.alarms.keys()]).toEqual(['between']);
    expect(holes).toEqual([]);
    fire('error');
    fire('open');
    await asked[2]?.give(state([]));
    expect(holes).toEqual(['']);
  });

  it('keeps to the newest of two states that it asked for', async () => {
    const cell = new Cell('s', 'c', world);
    fire('open');
    fire('open');
    await asked[0]?.give(state([alarm('first')]));
    fire('alarm', alarm('meanwhile'));
    expect(cell.state).toBeNull();
    await asked[1]?.give(state([alarm('second')]));
    expect([...cell.alarms.keys()]).toEqual(['second', 'meanwhile']);
  });

  it('has each repetition of a task once', async () => {
    const cell = new Cell('s', 'c', world);
    const energy = { task: 't', start: 5 };
    fire('open');
    fire('energy', energy);
    fire('energy', { task: 't', start: 9 });
    await asked[0]?.give(state([], { energies: { t: [energy] } }));
    expect(cell.state?.energies['t']?.map((one) => one.start)).toEqual([5, 9]);
  });

  it('takes the time of a new session, also an earlier one', async () => {
    const cell = new Cell('s', 'c', world);
    fire('open');
    await asked[0]?.give(state([]));
    fire('health', { time: 9000e6 });
    expect(cell.newest).toBe(9000);
    expect(cell.now).toBeGreaterThanOrEqual(9000);
    fire('open');
    await asked[1]?.give(state([], { session: 2, time: 2000 }));
    expect(cell.newest).toBe(2000);
  });

  it('says why it is refused', async () => {
    const refusals: number[] = [];
    new Cell('s', 'c', world).on('refused', (error) => refusals.push(error.status));
    fire('error');
    await asked[0]?.give({ status: 503, body: { error: '16 cells are open' } });
    expect(refusals).toEqual([503]);
  });
});

describe('an order', () => {
  const begin = async (token: string): Promise<void> => {
    const reading = site();
    await asked.at(-1)?.give({ body: { csrf: token } });
    await reading;
  };

  it('is given once more after a restart of the server, or a login in another tab', async () => {
    await begin('first');
    const ordered = explain('1', ['a.csv'], [], null);
    await asked.at(-1)?.give({ status: 403, body: { error: 'the request lacks its X-CSRF-Token' } });
    await asked.at(-1)?.give({ body: { csrf: 'second' } });
    expect(asked.slice(-3).map(({ path, token }) => [path, token])).toEqual([
      ['/api/recordings/1/explain', 'first'],
      ['/api/site', undefined],
      ['/api/recordings/1/explain', 'second'],
    ]);
    await asked.at(-1)?.give({ body: {} });
    expect(await ordered).toEqual({});
  });

  it('is refused where the token is not the reason', async () => {
    await begin('same');
    const ordered = explain('1', ['a.csv'], [], null).catch((error: unknown) => error);
    await asked.at(-1)?.give({ status: 403, body: { error: 'it needs may: act' } });
    await asked.at(-1)?.give({ body: { csrf: 'same' } });
    expect(await ordered).toEqual(new Refused(403, 'it needs may: act'));
  });
});
