/** Questions to the server. */

import type { CellState, Curves, Drop, Mismatch, PastAlarm, PlantCell, Report, Site } from './shapes';

/** The server's answer that something cannot be done, or that it gave none (status 0). */
export class Refused extends Error {
  constructor(
    readonly status: number,
    message: string,
  ) {
    super(message);
  }
}

export type Span = Readonly<{ from: number; to: number }>;

let csrf = '';

/** Who asks, and what there is to see; also brings what later orders need. */
export async function site(): Promise<Site> {
  const found = await get<Site>('/api/site');
  csrf = found.csrf;
  return found;
}

export const plant = (): Promise<{ cells: PlantCell[] }> => get('/api/plant');
export const logIn = (name: string, password: string): Promise<unknown> => post('/api/login', { name, password });
export const logOut = (): Promise<unknown> => post('/api/logout', {});

/** Recordings that are dropped on the page. */
const DROPS = '/api/recordings';
export const drops = (): Promise<{ drops: string[] }> => get(DROPS);
export const dropped = (name: string): Promise<Drop> => get(`${DROPS}/${name}`);
export const sample = (): Promise<{ name: string }> => post(`${DROPS}/sample`, {}) as Promise<{ name: string }>;

/** Announce files of some bytes, for a drop that is there or another; returns its name. */
export async function drop(files: Readonly<Record<string, number>>, into: string | null): Promise<string> {
  return ((await post(DROPS, { files, into })) as { name: string }).name;
}

export function send(name: string, path: string, body: Blob): Promise<unknown> {
  return order(`${DROPS}/${name}/files/${encoded(path)}`, 'PUT', {}, body);
}

/** Address of the page with a recording's curves, once it is made. */
export async function drawn(name: string, path: string): Promise<string> {
  const address = `${DROPS}/${name}/curves/${encoded(path)}`;
  await post(address, {});
  return address;
}

export function explain(name: string, recordings: readonly string[], simulations: readonly string[], robot: string | null): Promise<unknown> {
  return post(`${DROPS}/${name}/explain`, { recordings, simulations, robot });
}

function encoded(path: string): string {
  return path.split('/').map(encodeURIComponent).join('/');
}

/** Questions about one cell. */
export class CellApi {
  readonly root: string;

  constructor(site: string, cell: string) {
    this.root = `/api/cells/${encodeURIComponent(site)}/${encodeURIComponent(cell)}`;
  }

  state(signal?: AbortSignal): Promise<CellState> {
    return get(`${this.root}/state`, signal);
  }

  /** Address of the stream of frames. */
  stream(channels: readonly string[], rate: number): string {
    return `${this.root}/stream?${new URLSearchParams({ channels: channels.join(','), rate: String(rate) })}`;
  }

  curves(channels: readonly string[], span: Span, points: number, signal?: AbortSignal): Promise<Curves> {
    const asked = { channels: channels.join(','), from: String(span.from), to: String(span.to), points: String(points) };
    return get(`${this.root}/curves?${new URLSearchParams(asked)}`, signal);
  }

  alarms(span: Span, limit: number, signal?: AbortSignal): Promise<{ alarms: PastAlarm[]; complete: boolean }> {
    const asked = { from: String(span.from), to: String(span.to), limit: String(limit) };
    return get(`${this.root}/alarms?${new URLSearchParams(asked)}`, signal);
  }

  reports(): Promise<{ reports: Report[]; broken: unknown[] }> {
    return get(`${this.root}/reports`);
  }

  mismatch(): Promise<Mismatch> {
    return get(`${this.root}/mismatch`);
  }

  acknowledge(id: string, name: string, note: string): Promise<unknown> {
    return post(`${this.root}/acknowledge`, { id, name, note });
  }

  shelve(id: string, minutes: number, name: string, note: string): Promise<unknown> {
    return post(`${this.root}/shelve`, { id, minutes, name, note });
  }

  unshelve(id: string, name: string): Promise<unknown> {
    return post(`${this.root}/unshelve`, { id, name });
  }
}

function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  return ask<T>(path, signal ? { signal } : {});
}

function post(path: string, body: unknown): Promise<unknown> {
  return order(path, 'POST', { 'Content-Type': 'application/json' }, JSON.stringify(body));
}

/** Order something; once more if a restart of the server, or another tab, has made the token of this page invalid. */
async function order(path: string, method: string, headers: Record<string, string>, body: BodyInit): Promise<unknown> {
  const tried = csrf;
  const send = (): Promise<unknown> => ask(path, { method, headers: { ...headers, 'X-CSRF-Token': csrf }, body });
  try {
    return await send();
  } catch (error) {
    if (!(error instanceof Refused) || error.status !== 403) throw error;
    await site();
    if (csrf === tried) throw error;
    return send();
  }
}

async function ask<T>(path: string, init: RequestInit): Promise<T> {
  let response: Response;
  try {
    response = await fetch(path, { credentials: 'same-origin', ...init });
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error;
    throw new Refused(0, '');
  }
  const body: unknown = await response.json().catch(() => null);
  if (!response.ok) {
    const problem = (body as { error?: unknown } | null)?.error;
    throw new Refused(response.status, typeof problem === 'string' ? problem : `${response.status} ${response.statusText}`);
  }
  return body as T;
}
