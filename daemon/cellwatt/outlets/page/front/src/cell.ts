/** One cell as its stream tells it. */

import { CellApi, Refused } from './api';
import { Bus } from './bus';
import type { Alarm, CellState, Energy, Frames, Interval, Prediction, Shelved, Status, Task } from './shapes';
import { browser, Stream, type Connection, type Surroundings } from './stream';

export interface Topics {
  /** Everything was read anew. */
  state: CellState;
  health: Status;
  /** An alarm was raised (`new`), changed or cleared. */
  alarm: { alarm: Alarm; isNew: boolean };
  shelved: Shelved[];
  interval: Interval;
  task: Task;
  energy: Energy;
  frames: Frames;
  prediction: Prediction;
  /** Data were lost on the way: curves have to be read anew. */
  hole: string;
  connection: Connection;
  refused: Refused;
}

/** ms for which the last value of a channel stands while newer ones are missing. */
const STANDS = 2000;
const INTERVALS = 64;
const REPETITIONS = 100;
const SEVERITIES = ['info', 'warning', 'error'];

export class Cell extends Bus<Topics> {
  readonly api: CellApi;
  state: CellState | null = null;
  readonly alarms = new Map<string, Alarm>();
  connection: Connection = 'connecting';
  /** UTC ms of the newest data of this session, and the browser's time, ms, at which they came. */
  newest = 0;
  private newestAt = 0;
  /** Browser time, ms, at which the cell's health came last. */
  heard = 0;
  /** The newest value of a channel; null once it has been missing for a while. */
  readonly latest = new Map<string, number | null>();
  private readonly known = new Map<string, number>();
  readonly quality = new Map<string, number>();
  private readonly stream: Stream;
  private reading: AbortController | null = null;
  /** Events that came while the state was being read: they may be newer than it. */
  private held: (() => void)[] | null = null;
  private ended = false;

  constructor(
    readonly site: string,
    readonly name: string,
    world: Surroundings = browser,
  ) {
    super();
    this.api = new CellApi(site, name);
    const afterState = <T>(take: (event: T) => void) => (event: T): void => {
      if (this.held) this.held.push(() => take(event));
      else take(event);
    };
    const handlers = {
      frames: (frames: Frames) => this.takeFrames(frames),
      prediction: (prediction: Prediction) => this.takePrediction(prediction),
      health: afterState((status: Status) => this.takeHealth(status)),
      alarm: afterState((alarm: Alarm) => this.takeAlarm(alarm)),
      shelved: afterState((shelved: Shelved[]) => this.takeShelved(shelved)),
      interval: afterState((interval: Interval) => this.takeInterval(interval)),
      task: afterState((task: Task) => this.change((state) => (state.task = task), 'task', task)),
      energy: afterState((energy: Energy) => this.takeEnergy(energy)),
      gap: (gap: { text: string }) => this.tell('hole', gap.text),
      behind: () => this.tell('hole', ''),
    };
    const onstate = (state: Connection): void => {
      this.tell('connection', (this.connection = state));
      if (state === 'lost' && !this.state) void this.read(false); // it says why
    };
    this.stream = new Stream(this.api.stream([], 1), handlers, onstate, (missed) => void this.read(missed), world);
  }

  /** The cell's time now, UTC ms; the browser's clock may differ from it by hours. */
  get now(): number {
    return this.newest ? this.newest + performance.now() - this.newestAt : Date.now();
  }

  /** Follow these channels at a rate, Hz. */
  follow(channels: readonly string[], rate: number): void {
    this.stream.turn(this.api.stream(channels, rate));
  }

  close(): void {
    this.ended = true;
    this.reading?.abort();
    this.stream.close();
  }

  /** Active alarms, the gravest first, of these the newest first. */
  ranked(): Alarm[] {
    return [...this.alarms.values()].sort(
      (a, b) => SEVERITIES.indexOf(b.severity) - SEVERITIES.indexOf(a.severity) || b.since - a.since,
    );
  }

  /** Read the state, then apply the events that came meanwhile; `missed`: curves have to be read anew, too. */
  private async read(missed: boolean): Promise<void> {
    this.reading?.abort();
    const reading = (this.reading = new AbortController());
    this.held ??= [];
    try {
      const state = await this.api.state(reading.signal);
      if (this.ended) return;
      if (this.state?.session !== state.session) this.newest = 0; // the cell's clock may have been set
      this.state = state;
      this.alarms.clear();
      for (const alarm of state.alarms) this.alarms.set(alarm.id, alarm);
      this.heard = performance.now() - 1000 * (state.heard_age_s ?? 0);
      this.reach(state.time ?? 0, this.heard);
      this.tell('state', state);
      if (missed) this.tell('hole', '');
    } catch (error) {
      if (error instanceof Refused && !this.ended) this.tell('refused', error);
    } finally {
      if (reading === this.reading) {
        const held = this.held ?? [];
        this.held = null;
        held.forEach((take) => take());
      }
    }
  }

  private reach(time: number, at = performance.now()): void {
    if (time > this.newest) [this.newest, this.newestAt] = [time, at];
  }

  private change<T extends keyof Topics>(act: (state: CellState) => void, topic: T, event: Topics[T]): void {
    if (!this.state) return;
    act(this.state);
    this.tell(topic, event);
  }

  private takeFrames(frames: Frames): void {
    for (const [name, values] of Object.entries(frames.v)) this.note(name, values);
    for (const [name, worst] of Object.entries(frames.q)) this.quality.set(name, worst);
    this.reach(frames.t.at(-1) ?? 0);
    this.tell('frames', frames);
  }

  private note(name: string, values: readonly (number | null)[]): void {
    const found = values.findLast((value) => value !== null);
    const now = performance.now();
    if (found !== undefined) this.known.set(name, now);
    if (found !== undefined || now - (this.known.get(name) ?? 0) > STANDS) this.latest.set(name, found ?? null);
  }

  private takePrediction(prediction: Prediction): void {
    for (const [output, values] of Object.entries(prediction.v)) {
      this.note(`prediction/${prediction.model}/${output}`, values);
    }
    const known = this.state?.predictions.some((p) => p.model === prediction.model);
    if (this.state && !known) void this.read(false);
    this.tell('prediction', prediction);
  }

  private takeHealth(status: Status): void {
    this.heard = performance.now();
    if (status.time !== undefined) this.reach(status.time / 1e6);
    this.change((state) => (state.status = status), 'health', status);
    if (this.state && !this.state.channels.length && status.frames?.count) void this.read(false);
  }

  private takeAlarm(alarm: Alarm): void {
    const isNew = alarm.active && !this.alarms.has(alarm.id);
    if (alarm.active) this.alarms.set(alarm.id, alarm);
    else this.alarms.delete(alarm.id);
    this.tell('alarm', { alarm, isNew });
  }

  private takeShelved(shelved: Shelved[]): void {
    for (const { id } of shelved) this.alarms.delete(id);
    this.change((state) => (state.shelved = shelved), 'shelved', shelved);
  }

  private takeInterval(interval: Interval): void {
    this.change(
      (state) => {
        const before = state.intervals.findIndex((i) => i.source === interval.source && i.number === interval.number);
        if (before >= 0) state.intervals[before] = interval;
        else state.intervals.push(interval);
        if (state.intervals.length > INTERVALS) state.intervals.splice(0, state.intervals.length - INTERVALS);
      },
      'interval',
      interval,
    );
  }

  private takeEnergy(energy: Energy): void {
    this.change(
      (state) => {
        const kept = (state.energies[energy.task] ??= []);
        if (kept.some((one) => one.start === energy.start)) return; // the state had it already
        kept.push(energy);
        if (kept.length > REPETITIONS) kept.shift();
      },
      'energy',
      energy,
    );
  }
}
