/** How a cell is, for a person: the daemon's own health, and what its alarms say of the robot. */

import type { Severity, State } from './shapes';

/** Alarms as far as they count here; `acknowledged` is falsy where nobody knows of it. */
export interface Weighed {
  severity: Severity;
  acknowledged: unknown;
}

/** The worse of both: an error that nobody has acknowledged is a fault, any other error or warning asks for attention. */
export function condition(state: State | undefined, alarms: Iterable<Weighed>): State | undefined {
  if (state !== 'green' && state !== 'amber') return state;
  let found: State = state;
  for (const alarm of alarms) {
    if (alarm.severity === 'error' && !alarm.acknowledged) return 'red';
    if (alarm.severity !== 'info') found = 'amber';
  }
  return found;
}
