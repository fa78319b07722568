import { describe, expect, it } from 'vitest';

import { Clock, span } from '../src/clock';
import { firstChoice, groups, measuredPower, powerGroup } from '../src/curves/lines';
import { Timeline } from '../src/curves/timeline';
import { compared, named } from '../src/evidence';
import { count, figure, kilowattHours, onScale, quantity } from '../src/numbers';
import { cellPath, parse } from '../src/router';
import type { CellState, Channel, PlantCell } from '../src/shapes';
import { groupNames } from '../src/views/energy';
import { effectText } from '../src/views/mismatch';
import { gravest, worstFirst } from '../src/views/plant';
import { stack } from '../src/views/stack';

const channel = (name: string, unit: string): Channel => ({ name, unit, kind: 'continuous', source: name.split('.')[0] as string });

describe('numbers', () => {
  it.each([
    [0, '0'],
    [-0.0001, '-1.00e-4'],
    [0.0123456, '0.0123'],
    [9.99, '9.99'],
    [123.4, '123'],
    [1234.5, '1235'],
    [null, '–'],
    [NaN, '–'],
  ])('%s reads %s', (value, text) => expect(figure(value)).toBe(text));

  it('are as fine as can be seen on a scale', () => {
    expect(onScale(6.69e-6, 'rad', { min: -2, max: 2 })).toBe('0.00 rad');
    expect(onScale(-0.001, 'rad', { min: -2, max: 2 })).toBe('0.00 rad');
    expect(onScale(214.6, 'W', { min: 0, max: 400 })).toBe('215 W');
    expect(onScale(12_345, 'W', { min: 0, max: 20_000 })).toBe('12.3 kW');
    expect(onScale(null, 'W', { min: 0, max: 400 })).toBe('–');
  });

  it('have units with k and M', () => {
    expect(quantity(12_345, 'W')).toBe('12.3 kW');
    expect(quantity(9999, 'W')).toBe('9999 W');
    expect(quantity(12_345, 'rad')).toBe('12345 rad');
    expect(kilowattHours(7.2e6)).toBe('2.00 kWh');
    expect(count(1234567)).toBe('1\u202f234\u202f567');
  });
});

describe('times', () => {
  const at = Date.UTC(2026, 10, 24, 23, 59, 58, 120);
  it('are UTC where that is asked for', () => {
    expect(new Clock(true).time(at, 1)).toBe('23:59:58.1');
    expect(new Clock(true).moment(at, at)).toBe('23:59:58');
    expect(new Clock(true).moment(at, at + 86_400_000)).toBe('2026-11-24 23:59:58');
  });
  it('name the day where an axis enters it', () => {
    expect(new Clock(true).ticks([at, at + 60_000], 60_000)).toEqual(['23:59', '11-25 00:00']);
  });
  it('have spans in the largest unit', () => {
    expect([800, 60_000, 600_000, 3_600_000, 604_800_000].map(span)).toEqual(['0.8 s', '60 s', '10 min', '60 min', '7 d']);
  });
});

describe('the timeline', () => {
  it('stays live while its width changes', () => {
    const line = new Timeline(60_000);
    line.wide(10_000, 1e9);
    expect(line.shown(1e9)).toEqual({ from: 1e9 - 10_000, to: 1e9 });
  });
  it('goes back in time, forward, and to where it was live', () => {
    const line = new Timeline(60_000);
    line.pan(-0.5, 1e9);
    expect(line.shown(2e9)).toEqual({ from: 1e9 - 90_000, to: 1e9 - 30_000 });
    line.zoom(0.5, 1e9);
    expect(line.shown(1e9)).toEqual({ from: 1e9 - 75_000, to: 1e9 - 45_000 });
    line.pan(10, 1e9);
    expect([line.live, line.width]).toEqual([true, 60_000]);
  });
  it('never shows the future', () => {
    const line = new Timeline(60_000);
    line.show({ from: 1e9 - 1000, to: 1e9 + 5000 }, 1e9);
    expect(line.past).toEqual({ from: 1e9 - 6000, to: 1e9 });
  });
});

describe('charts', () => {
  const channels = [channel('meter.supply.power', 'W'), channel('arm.joint_1.position', 'rad'), channel('arm.joint_2.position', 'rad'), channel('arm.x', 'W')];
  it('begin with measured beside predicted power', () => {
    const state = { channels, predictions: [{ model: 'm', outputs: { power: 'W', current: 'A' } }] } as unknown as CellState;
    const group = powerGroup(state, 'Power', 'Measured', 'Predicted');
    expect(group?.lines.map((l) => [l.name, l.label, l.dashed ?? false])).toEqual([
      ['meter.supply.power', 'Measured', false],
      ['prediction/m/power', 'Predicted', true],
    ]);
  });
  it('take the first power where no supply is measured', () => {
    expect(measuredPower([channel('a.t', 's'), channel('a.b', 'W'), channel('a.c', 'W')])).toEqual(['a.b']);
  });
  it('have channels of a kind together', () => {
    const [group] = groups(channels, ['arm.joint_2.position', 'arm.joint_1.position']);
    expect([group?.title, group?.unit, group?.lines.map((l) => l.label)]).toEqual(['Position', 'rad', ['joint 1', 'joint 2']]);
    expect(firstChoice(channels)).toEqual(['arm.joint_1.position', 'arm.joint_2.position']);
  });
});

describe('evidence', () => {
  it('is held against its limits', () => {
    const found = compared({ power_residual_W: 38, power_limit_W: 21, residual_rad: -0.1, tolerance_rad: 0.2, residual_s: 1, score: 3 });
    expect(found.map(({ key, value, limit }) => [key, value, limit])).toEqual([
      ['power_residual_W', 38, 21],
      ['residual_rad', -0.1, 0.2],
    ]);
  });
  it('has names and units', () => {
    expect(named('position_residual_rad')).toEqual(['position residual', 'rad']);
    expect(named('task_interval')).toEqual(['task interval', '']);
  });
});

describe('addresses', () => {
  it('lead to places and back', () => {
    expect(parse('/')).toEqual({ view: 'start' });
    expect(parse('/plant')).toEqual({ view: 'plant' });
    expect(parse('/recordings/3')).toEqual({ view: 'recordings', name: '3' });
    expect(parse(cellPath('hall 1', 'a/b', 'alarms'))).toEqual({ view: 'cell', site: 'hall 1', cell: 'a/b', part: 'alarms' });
    expect(parse(cellPath('s', 'c'))).toEqual({ view: 'cell', site: 's', cell: 'c', part: 'overview' });
    expect(parse('/cell/s/c/nothing')).toEqual({ view: 'unknown' });
    expect(parse('/api/cells/s/c/reports/x')).toEqual({ view: 'unknown' });
  });
});

describe('the plant', () => {
  const cell = (name: string, state: PlantCell['state'], severities: PlantCell['alarms'][number]['severity'][] = []): PlantCell =>
    ({ cell: name, state, alarms: severities.map((severity, i) => ({ id: String(i), severity, since: i, statement: '', acknowledged: false })) }) as unknown as PlantCell;
  it('has the worst first', () => {
    const cells = [cell('c10', 'green'), cell('c2', 'green'), cell('a', null), cell('b', 'gone'), cell('d', 'amber'), cell('e', 'amber', ['error']), cell('f', 'red')];
    expect(worstFirst(cells).map((c) => c.cell)).toEqual(['e', 'f', 'd', 'b', 'a', 'c2', 'c10']);
  });
  it('tells the gravest alarm, one that nobody knows of before others', () => {
    const { alarms } = cell('x', 'red', ['info', 'error', 'warning']);
    expect(gravest(alarms)?.severity).toBe('error');
    expect(gravest([{ ...alarms[1]!, acknowledged: true, id: 'old' }, { ...alarms[1]!, id: 'new' }])?.id).toBe('new');
  });
});

describe('energy', () => {
  it('is stacked up and down from zero', () => {
    const { bars, low, high } = stack([[10, -4, 5], [1, 0, -9]]);
    expect(bars[0]).toEqual([{ from: 0, to: 10 }, { from: 0, to: -4 }, { from: 10, to: 15 }]);
    expect([low, high]).toEqual([-9, 15]);
  });
  it('names the largest consumer first and the unexplained last', () => {
    const done = [{ groups: { unexplained: 99, brakes: 0, electronics: 5, losses: 9 } }] as unknown as Parameters<typeof groupNames>[0];
    expect(groupNames(done)).toEqual(['losses', 'electronics', 'unexplained']);
  });
});

describe('effects', () => {
  it('are words, whatever they come as', () => {
    expect(effectText('as text')).toBe('as text');
    expect(effectText({ effect: 'grinding_friction', joint: 3 })).toBe('grinding friction, joint 3');
    expect(effectText({ statement: 'said' })).toBe('said');
    expect(effectText(null)).toBe('');
  });
});
