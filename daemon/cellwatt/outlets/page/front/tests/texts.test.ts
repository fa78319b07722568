import { afterEach, describe, expect, it } from 'vitest';

import english from '../src/texts/en.json';
import { counted, filled, language, languages, speak, t } from '../src/texts';

const FILES = { './texts/xx.json': () => Promise.resolve({ 'state.green': 'Wel', 'plant.alarms': '{n} larmz' }) };

afterEach(() => speak('en'));

describe('texts', () => {
  it('have values put in, and keep what is not known', () => {
    expect(filled('{n} of {most}', { n: 3 })).toBe('3 of {most}');
    expect(t('picker.title', { n: 3, most: 8 })).toBe('Channels (3 of 8)');
  });

  it('know one from many', () => {
    expect(counted(1, 'plant.alarm', 'plant.alarms')).toBe('1 alarm');
    expect(counted(2, 'plant.alarm', 'plant.alarms')).toBe('2 alarms');
  });

  it('are in another language as far as its file goes', async () => {
    expect(languages(FILES)).toEqual(['en', 'xx']);
    await speak('xx', FILES);
    expect([language(), t('state.green'), t('state.red')]).toEqual(['xx', 'Wel', english['state.red']]);
  });

  it('are English where the language is not known', async () => {
    await speak('yy', FILES);
    expect([language(), t('state.green')]).toEqual(['en', english['state.green']]);
  });

  it('are never empty, and sorted', () => {
    expect(Object.values(english).every((text) => text.trim())).toBe(true);
    expect(Object.keys(english)).toEqual(Object.keys(english).sort());
  });
});
