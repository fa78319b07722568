/** What the server tells: times are UTC ms, values SI, null where there is none. */

export type Severity = 'info' | 'warning' | 'error';
export type State = 'green' | 'amber' | 'red' | 'gone' | null;
export type Values = readonly (number | null)[];

export interface Site {
  mode: 'cell' | 'plant' | 'recordings';
  site: string | null;
  cells: { site: string; cell: string }[];
  user: string | null;
  may_act: boolean;
  /** Recordings can be dropped. */
  may_drop: boolean;
  login_needed: boolean;
  csrf: string;
  version: string;
}

export interface PlantAlarm {
  id: string;
  severity: Severity;
  since: number;
  statement: string;
  acknowledged: boolean;
}

export interface PlantCell {
  site: string;
  cell: string;
  state: State;
  time: number | null;
  age_s: number | null;
  sources: number;
  sources_ok: number;
  received: number;
  lost: number;
  alarms: PlantAlarm[];
  shelved: number;
  power_W: number | null;
  energy_today_J: number | null;
  task: string | null;
}

export interface Source {
  state: string;
  error: string | null;
  expected: number;
  received: number;
  missed: Record<string, number>;
  dropped: Record<string, number>;
  streams: Record<string, { rate_hz: number | null; jitter_p99_ms?: number | null }>;
  clocks: Record<string, { bound_ns: number } | undefined>;
}

export interface Status {
  state?: State;
  reasons?: string[];
  warnings?: string[];
  time?: number;
  sources?: Record<string, Source>;
  frames?: { count: number; streams?: Record<string, Record<string, number>> };
  recorder?: { state: string } | null;
}

export interface Word {
  name: string;
  note: string;
  time: number;
}

export interface Alarm {
  id: string;
  kind: string;
  severity: Severity;
  active: boolean;
  since: number;
  time: number;
  statement: string;
  source: string | null;
  joint: number | null;
  alternatives: number[];
  interval: number | null;
  evidence: Record<string, unknown>;
  stage: string | null;
  acknowledged: Word | null;
  evidence_page: string | null;
}

export interface PastAlarm extends Alarm {
  cleared: number | null;
  cleared_statement?: string | null;
  people?: { t: number; what: string; name: string; note: string; until?: number | null }[];
}

export interface Shelved {
  id: string;
  kind: string;
  severity: Severity;
  statement: string;
  since: number;
  shelf: Word & { until: number; severity: Severity };
}

export interface Interval {
  source: string;
  number: number;
  start: number;
  end: number;
  moving: number[];
  closed: boolean;
}

export interface Task {
  source: string;
  name: string;
  variant: string;
  speed: number;
  start: number;
  end: number;
  repetition: number;
}

export interface Energy {
  task: string;
  variant: string;
  repetition: number;
  start: number;
  end: number;
  total: number;
  groups: Record<string, number>;
  group_uncertainty?: Record<string, number>;
  uncertainty: number;
  motion_efficiency_percent: number;
  total_per_part: number | null;
}

export interface Joint {
  name: string;
  parent: number;
  xyz: [number, number, number];
  rpy: [number, number, number];
  axis: [number, number, number];
  type: 'revolute' | 'prismatic' | 'fixed';
  channel: string | null;
  /** Of a joint that follows the one whose channel it has. */
  multiplier?: number;
  offset?: number;
}

export interface Skeleton {
  source: string;
  name: string;
  joints: Joint[];
}

export interface Channel {
  name: string;
  unit: string;
  kind: string;
  source: string;
}

export interface CellState {
  time: number | null;
  session: number | null;
  status: Status;
  heard_age_s: number | null;
  channels: Channel[];
  alarms: Alarm[];
  shelved: Shelved[];
  intervals: Interval[];
  task: Task | null;
  energies: Record<string, Energy[]>;
  predictions: { model: string; outputs: Record<string, string> }[];
  arms: Skeleton[];
  may_act: boolean;
  record: boolean;
}

export interface Frames {
  t: number[];
  v: Record<string, Values>;
  q: Record<string, number>;
}

export interface Prediction {
  model: string;
  t: number[];
  v: Record<string, Values>;
}

export interface AlarmMark {
  id: string;
  severity: Severity;
  statement: string;
  raised: number;
  cleared: number | null;
}

export interface Curves {
  t: number[];
  v: Record<string, { min: Values; max?: Values }>;
  step_ms: number;
  intervals: Interval[];
  alarms: AlarmMark[];
  from_record: boolean;
  complete: boolean;
}

export interface Report {
  path: string;
  kind: string;
  name: string;
  finding: string;
  tone: string;
  about: string;
  made: number | string | null;
  href: string;
}

export interface Mismatch {
  finding: string | null;
  tone?: string;
  made?: number | string | null;
  href?: string | null;
  before?: number | null;
  after?: number | null;
  unit?: string | null;
  channel?: string | null;
  effects?: unknown[];
}

export type DropKind = 'recording' | 'simulation' | 'robot' | 'other';

/** Files that were dropped, and what `explain` says of them. */
export interface Drop {
  name: string;
  items: { path: string; kind: DropKind }[];
  note: string;
  answer: { running: boolean; said: string; error: string; files: string[] } | null;
}
