/** A stream of server-sent events that comes back by itself. */

export type Connection = 'connecting' | 'live' | 'lost';
export type Handlers = Readonly<Record<string, (data: never) => void>>;

/** The part of EventSource that is used, so that tests can stand in for it. */
export interface Events {
  readonly readyState: number;
  addEventListener(type: string, take: (event: MessageEvent<string>) => void): void;
  close(): void;
}

export interface Surroundings {
  open(address: string): Events;
  later(act: () => void, ms: number): unknown;
  never(timer: unknown): void;
  /** Resolves if the server answers at all. */
  alive(): Promise<unknown>;
  /** Calls `take` now and on each change: true while the page is visible. The answer ends that. */
  visible(take: (visible: boolean) => void): () => void;
}

const CLOSED = 2;
/** ms until the first attempt after a refusal; each further one waits twice as long, up to the longest. */
const FIRST = 1000;
const LONGEST = 15_000;
/** ms without any event after which it is asked whether the server still answers. */
const SILENCE = 15_000;
/**
 * ms for which a hidden page is still followed. A browser opens six connections to a server for all its tabs together:
 * with a stream in each, the seventh tab would not even load.
 */
const HIDDEN = 5000;

/**
 * Follows an address while the page is visible. `onstate` is called on each change of the connection; `onopen` each time
 * that the stream has opened, with true if data may be missing: events from before are missing in any case.
 */
export class Stream {
  private events: Events | null = null;
  private retry: unknown = null;
  private watch: unknown = null;
  private leave: unknown = null;
  private refusals = 0;
  private state: Connection = 'connecting';
  private following = false;
  private missed = false;
  private ended = false;
  private readonly unwatch: () => void;

  constructor(
    private address: string,
    private readonly handlers: Handlers,
    private readonly onstate: (state: Connection) => void,
    private readonly onopen: (missed: boolean) => void,
    private readonly world: Surroundings,
  ) {
    this.unwatch = world.visible((visible) => this.seen(visible));
  }

  /** Follow another address from now on. */
  turn(address: string): void {
    if (address === this.address) return;
    this.address = address;
    if (this.following) this.open();
  }

  /** Follow nothing any more. */
  close(): void {
    this.ended = true;
    this.unwatch();
    this.world.never(this.leave);
    this.drop();
  }

  private seen(visible: boolean): void {
    this.world.never(this.leave);
    if (visible && !this.following) {
      this.following = true;
      this.open();
    } else if (!visible && this.following) {
      this.leave = this.world.later(() => {
        this.following = false;
        this.missed = true;
        this.drop();
      }, HIDDEN);
    }
  }

  private open(): void {
    this.drop();
    const events = (this.events = this.world.open(this.address));
    const mine = (act: () => void) => (): void => {
      if (events === this.events) act();
    };
    events.addEventListener('open', mine(() => this.opened()));
    events.addEventListener('error', mine(() => this.failed(events)));
    for (const [name, take] of Object.entries(this.handlers)) {
      events.addEventListener(name, (event) => {
        if (events !== this.events) return;
        this.heard();
        take(JSON.parse(event.data) as never);
      });
    }
  }

  private opened(): void {
    const missed = this.missed;
    this.refusals = 0;
    this.missed = false;
    this.become('live');
    this.heard();
    this.onopen(missed);
  }

  private failed(events: Events): void {
    this.lose();
    this.world.never(this.watch);
    if (events.readyState !== CLOSED) return; // the browser tries again by itself
    this.drop();
    const wait = Math.min(LONGEST, FIRST * 2 ** this.refusals++);
    this.retry = this.world.later(() => this.open(), wait);
  }

  private heard(): void {
    this.world.never(this.watch);
    this.watch = this.world.later(() => void this.check(), SILENCE);
  }

  /** A silent line may be dead without the browser knowing: ask, and open anew if there is no answer. */
  private async check(): Promise<void> {
    const before = this.events;
    try {
      await this.world.alive();
      if (before === this.events && !this.ended) this.heard();
    } catch {
      if (before !== this.events || this.ended) return;
      this.lose();
      this.open();
    }
  }

  private lose(): void {
    this.missed = true;
    this.become('lost');
  }

  private become(state: Connection): void {
    if (state === this.state || this.ended) return;
    this.state = state;
    this.onstate(state);
  }

  private drop(): void {
    this.world.never(this.retry);
    this.world.never(this.watch);
    this.events?.close();
    this.events = null;
  }
}

/** The browser's own event source and timers. */
export const browser: Surroundings = {
  open: (address) => new EventSource(address),
  later: (act, ms) => window.setTimeout(act, ms),
  never: (timer) => window.clearTimeout(timer as number),
  alive: () => fetch('/api/site', { signal: AbortSignal.timeout(5000) }),
  visible: (take) => {
    const look = (): void => take(document.visibilityState === 'visible');
    document.addEventListener('visibilitychange', look);
    look();
    return () => document.removeEventListener('visibilitychange', look);
  },
};
