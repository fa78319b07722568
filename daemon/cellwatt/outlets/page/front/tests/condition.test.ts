import { describe, expect, it } from 'vitest';
import { condition, type Weighed } from '../src/condition';

const alarm = (severity: Weighed['severity'], acknowledged: unknown = null): Weighed => ({ severity, acknowledged });

describe('condition', () => {
  it('is that of the daemon while no alarm is up', () => {
    for (const state of ['green', 'amber', 'red', 'gone', null] as const) expect(condition(state, [])).toBe(state);
  });
  it('is a fault while nobody knows of an error', () => {
    expect(condition('green', [alarm('warning'), alarm('error')])).toBe('red');
    expect(condition('green', [alarm('error', { name: 'Ines' })])).toBe('amber');
  });
  it('asks for attention at warnings, not at advice', () => {
    expect(condition('green', [alarm('warning', true)])).toBe('amber');
    expect(condition('green', [alarm('info')])).toBe('green');
  });
  it('says nothing of a cell that does not answer', () => {
    expect(condition(null, [alarm('error')])).toBe(null);
    expect(condition('gone', [alarm('error')])).toBe('gone');
  });
});
