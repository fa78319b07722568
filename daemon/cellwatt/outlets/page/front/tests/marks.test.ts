import { describe, expect, it } from 'vitest';

import { Marks } from '../src/curves/marks';

const alarm = { id: 'joint_3', severity: 'error' as const, statement: 'Joint 3 needs more.' };

describe('alarms of the curves', () => {
  it('stand once, though the record knows when it was published and the cell since when', () => {
    const marks = new Marks();
    marks.alarms = [{ ...alarm, raised: 1500, cleared: null }];
    marks.alarm({ ...alarm, raised: 1000, cleared: null });
    marks.alarm({ ...alarm, statement: 'Resolved.', raised: 1000, cleared: 3000 });
    expect(marks.alarms).toEqual([{ ...alarm, raised: 1500, cleared: 3000 }]);
  });

  it('stand again when they come again', () => {
    const marks = new Marks();
    marks.alarm({ ...alarm, raised: 1000, cleared: 3000 });
    marks.alarm({ ...alarm, raised: 4000, cleared: null });
    expect(marks.alarms.map((alarm) => alarm.raised)).toEqual([1000, 4000]);
  });
});
