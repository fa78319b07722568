/** One cell as its stream tells it. */

import { CellApi, Refused } from './api';
import { Bus } from './bus';
import type { Alarm, CellState, Energy, Frames, Interval, Prediction, Shelved, Status, Task } from './shapes';
import { browser, Stream, type Connection } from './stream';

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
  /** UTC ms of the newest data. */
  newest = 0;
  /** Browser time, ms, at which the cell's health came last. */
  heard = 0;
  /** The newest value of a channel; null once it has been missing for a while. */
  readonly latest = new Map<string, number | null>();
  private readonly known = new Map<string, number>();
  readonly quality = new Map<string, number>();
  private readonly stream: Stream;
  private reading: AbortController | null = null;
  private ended = false;

  constructor(
    readonly site: string,
    readonly name: string,
  ) {
    super();
    this.api = new CellApi(site, name);
    const handlers = {
      frames: (told: Frames) => this.takeFrames(told),
      prediction: (told: Prediction) => this.takePrediction(told),
      health: (told: Status) => this.takeHealth(told),
      alarm: (told: Alarm) => this.takeAlarm(told),
      shelved: (told: Shelved[]) => this.takeShelved(told),
      interval: (told: Interval) => this.takeInterval(told),
      task: (told: Task) => this.change((state) => (state.task = told), 'task', told),
      energy: (told: Energy) => this.takeEnergy(told),
      gap: (told: { text: string }) => this.tell('hole', told.text),
      behind: () => this.tell('hole', ''),
    };
    const onstate = (state: Connection): void => this.tell('connection', (this.connection = state));
    this.stream = new Stream(this.api.stream([], 1), handlers, onstate, () => void this.read(), browser);
    void this.read();
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

  private async read(): Promise<void> {
    this.reading?.abort();
    const reading = (this.reading = new AbortController());
    try {
      const state = await this.api.state(reading.signal);
      if (this.ended) return;
      this.state = state;
      this.alarms.clear();
      for (const alarm of state.alarms) this.alarms.set(alarm.id, alarm);
      this.heard = performance.now() - 1000 * (state.heard_age_s ?? 0);
      this.newest = Math.max(this.newest, state.time ?? 0);
      this.tell('state', state);
    } catch (error) {
      if (error instanceof Refused && !this.ended) this.tell('refused', error);
    }
  }

  private change<T extends keyof Topics>(act: (state: CellState) => void, topic: T, told: Topics[T]): void {
    if (!this.state) return;
    act(this.state);
    this.tell(topic, told);
  }

  private takeFrames(told: Frames): void {
    for (const [name, values] of Object.entries(told.v)) this.note(name, values);
    for (const [name, worst] of Object.entries(told.q)) this.quality.set(name, worst);
    this.newest = Math.max(this.newest, told.t.at(-1) ?? 0);
    this.tell('frames', told);
  }

  private note(name: string, values: readonly (number | null)[]): void {
    const found = values.findLast((value) => value !== null);
    const now = performance.now();
    if (found !== undefined) this.known.set(name, now);
    if (found !== undefined || now - (this.known.get(name) ?? 0) > STANDS) this.latest.set(name, found ?? null);
  }

  private takePrediction(told: Prediction): void {
    for (const [output, values] of Object.entries(told.v)) {
      this.note(`prediction/${told.model}/${output}`, values);
    }
    const known = this.state?.predictions.some((p) => p.model === told.model);
    if (this.state && !known) void this.read();
    this.tell('prediction', told);
  }

  private takeHealth(told: Status): void {
    this.heard = performance.now();
    if (told.time !== undefined) this.newest = Math.max(this.newest, told.time / 1e6);
    this.change((state) => (state.status = told), 'health', told);
    if (this.state && !this.state.channels.length && told.frames?.count) void this.read();
  }

  private takeAlarm(alarm: Alarm): void {
    const isNew = alarm.active && !this.alarms.has(alarm.id);
    if (alarm.active) this.alarms.set(alarm.id, alarm);
    else this.alarms.delete(alarm.id);
    this.tell('alarm', { alarm, isNew });
  }

  private takeShelved(told: Shelved[]): void {
    for (const { id } of told) this.alarms.delete(id);
    this.change((state) => (state.shelved = told), 'shelved', told);
  }

  private takeInterval(told: Interval): void {
    this.change(
      (state) => {
        const before = state.intervals.findIndex((i) => i.source === told.source && i.number === told.number);
        if (before >= 0) state.intervals[before] = told;
        else state.intervals.push(told);
        if (state.intervals.length > INTERVALS) state.intervals.splice(0, state.intervals.length - INTERVALS);
      },
      'interval',
      told,
    );
  }

  private takeEnergy(told: Energy): void {
    this.change(
      (state) => {
        const kept = (state.energies[told.task] ??= []);
        kept.push(told);
        if (kept.length > REPETITIONS) kept.shift();
      },
      'energy',
      told,
    );
  }
}
