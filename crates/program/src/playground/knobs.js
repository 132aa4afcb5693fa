// Settings with a slider and a field: those of the design, limits, and parameters of the controller.
'use strict';
const POSITIONS = 1000;
// A logarithmic slider that includes 0 covers so many decades above it.
const DECADES = 4;

// How positions of a slider, from 0 to 1, become values.
const SCALES = {
  linear: ([low, high]) => ({at: part => low + part * (high - low), part: value => (value - low) / (high - low)}),
  logarithmic: ([low, high]) => ({at: part => low * (high / low) ** part, part: value => Math.log(value / low) / Math.log(high / low)}),
  // 0 at the left, then logarithmic.
  fromZero: ([, high]) => ({
    at: part => part <= 0 ? 0 : high * 10 ** (DECADES * (part - 1)),
    part: value => value <= 0 ? 0 : Math.max(0.001, 1 + Math.log10(value / high) / DECADES),
  }),
};

class Knob {
  // `given` has id, label, unit, description, and `shown`, the factor between a value and what is shown (100 for per cent);
  // `onChoose(value)` takes a value, or null for the default.
  constructor(given, onChoose) {
    Object.assign(this, {unit: '', description: '', shown: 1, scale: 'linear', least: -Infinity}, given);
    this.onChoose = onChoose;
    this.label = made('label', {htmlFor: `k-${this.id}`, title: this.description}, this.label);
    const small = [this.unit && this.unit !== '1' ? `(${this.unit})` : '', this.description].filter(Boolean).join(' ');
    if (small) this.label.append(' ', made('small', {}, small));
    this.slide = made('input', {type: 'range', min: 0, max: POSITIONS, step: 1, id: `k-${this.id}`});
    this.entry = made('input', {type: 'number', step: 'any', autocomplete: 'off'});
    this.back = made('button', {type: 'button'}, '↺');
    this.slide.addEventListener('input', () => this.choose(this.rounded(this.at(this.slide.valueAsNumber / POSITIONS))));
    this.entry.addEventListener('change', () => {
      const value = this.entry.valueAsNumber / this.shown;
      if (Number.isFinite(value) && value >= this.least && value <= (this.most ?? Infinity)) this.choose(value); else this.show(this.now);
    });
    this.back.addEventListener('click', () => this.onChoose(null));
    this.place = made('div', {className: 'knob'}, this.label, this.slide, this.entry, this.back);
    this.entry.setAttribute('aria-label', `${given.label}, value`);
  }

  rounded(value) {
    return value === 0 ? 0 : Number(value.toPrecision(3));
  }

  at(part) {
    const [low, high] = this.range;
    return part <= 0 ? low : part >= 1 ? high : SCALES[this.scale](this.range).at(part);
  }

  choose(value) {
    this.show({...this.now, value, isChanged: true});
    this.onChoose(value);
  }

  // Shows a value: {value, start, range, scale, isChanged}; `start` is the default, null where it isn't known.
  show(now) {
    this.now = now;
    const {value, start} = now;
    if (now.scale) this.scale = now.scale;
    // A value that was typed may be outside the slider, which then goes that far.
    const [low, high] = now.range;
    const isWithin = this.scale !== 'logarithmic' || value * low > 0;
    this.range = isWithin ? [Math.min(low, value), Math.max(high, value)] : [low, high];
    if (this.scale === 'fromZero') this.range[0] = 0;
    const part = isWithin ? SCALES[this.scale](this.range).part(value) : value < low ? 0 : 1;
    this.slide.value = Math.round(Math.min(1, Math.max(0, part)) * POSITIONS);
    const text = Number((value * this.shown).toPrecision(6));
    this.slide.setAttribute('aria-valuetext', `${text} ${this.unit}`.trim());
    if (document.activeElement !== this.entry || this.entry.valueAsNumber !== text) this.entry.value = text;
    this.place.classList.toggle('moved', Boolean(now.isChanged));
    this.back.disabled = !now.isChanged;
    const words = start === null || start === undefined ? 'Restore the default' : `Restore ${written(start * this.shown)}${this.unit ? ` ${this.unit}` : ''}`;
    this.back.title = words;
    this.back.setAttribute('aria-label', `${this.label.firstChild.textContent}: ${words}`);
  }
}

// A limit of a control, ±, which may be absent.
class Limit extends Knob {
  constructor(given, onChoose) {
    super({scale: 'logarithmic', least: 1e-12, ...given}, onChoose);
    this.box = made('input', {type: 'checkbox'});
    this.box.setAttribute('aria-label', `${given.label}, present`);
    this.box.addEventListener('change', () => this.onChoose(this.box.checked ? this.now.size : 0));
    const head = made('div', {className: 'head'}, this.box, ' ');
    this.place.prepend(head);
    head.append(this.label);
    this.place.classList.add('limit');
  }

  // `limits` are [low, high], or null if the control has none.
  show(now) {
    const {limits} = now;
    this.box.checked = limits !== null && limits !== undefined;
    super.show({...now, value: this.box.checked ? Math.max(...limits.map(Math.abs)) : now.size});
    this.slide.disabled = this.entry.disabled = !this.box.checked;
    const isSymmetric = !limits || limits[0] === -limits[1];
    if (!isSymmetric) this.entry.title = `From ${written(limits[0])} to ${written(limits[1])}`; else this.entry.removeAttribute('title');
    this.label.querySelector('small')?.remove();
    const range = !limits ? 'no limit' : isSymmetric ? `±${this.unit ? ` ${this.unit}` : ''}` : `${written(limits[0])} … ${written(limits[1])} ${this.unit}`;
    this.label.append(made('small', {}, `(${range.trim()})`));
  }

  choose(value) {
    this.show({...this.now, limits: [-value, value], isChanged: true});
    this.onChoose(value);
  }
}

// The settings of a design, in their order; `program` has what the last answer knew.
class Settings {
  constructor(place, onChange) {
    Object.assign(this, {place, onChange, knobs: new Map(), channels: ''});
  }

  build(about) {
    const channels = JSON.stringify([about.inputs, about.outputs, about.inputUnits, about.outputUnits, about.isRecorded]);
    if (channels === this.channels) return;
    this.channels = channels;
    this.knobs.clear();
    this.place.replaceChildren();
    const add = (knob, id) => {
      this.knobs.set(id, knob);
      this.place.append(knob.place);
    };
    const knob = (id, given, key = id) => add(new Knob({id, ...given}, value => this.onChange(key, value)), id);
    knob('bandwidth', {label: 'Bandwidth', unit: 'rad/s', scale: 'logarithmic', least: 1e-12, description: 'requested speed of the loop'});
    const recorded = about.isRecorded ? '; until you change it, that of the record' : '';
    knob('uncertainty', {label: 'Uncertainty', unit: '%', shown: 100, least: 0, most: 1, description: `of each entry of A and B${recorded}`});
    about.outputs.forEach((name, k) => {
      const label = about.outputs.length > 1 ? `Reference of ${name}` : 'Reference';
      const given = {id: `reference-${k}`, label, unit: about.outputUnits[k] ?? '', scale: 'logarithmic', least: 1e-12, description: 'size of its step'};
      add(new Knob(given, value => this.onChange('reference', value, k)), `reference-${k}`);
    });
    about.inputs.forEach((name, k) => {
      const given = {id: `limit-${k}`, label: `Limit of ${name}`, unit: about.inputUnits[k] ?? ''};
      add(new Limit(given, value => this.onChange('limits', value, k)), `limit-${k}`);
    });
    knob('noise', {label: 'Noise', unit: about.outputUnits.length === 1 ? about.outputUnits[0] : '', scale: 'fromZero', least: 0,
      description: 'standard deviation of the measurements; 0: no noise'});
    knob('delay', {label: 'Dead time', unit: 's', least: 0, description: 'of the controls'});
  }

  // Shows a design; `defaults` has what is used where the design has null.
  show(design, about, defaults) {
    this.build(about);
    const around = value => [value / 10, value * 10];
    const knob = (id, now) => this.knobs.get(id).show(now);
    const {bandwidth, uncertainty, reference, noise, delay} = defaults;
    const value = design.bandwidth ?? bandwidth ?? 1;
    knob('bandwidth', {value, start: bandwidth, range: around(bandwidth ?? value), isChanged: design.bandwidth !== null});
    knob('uncertainty', {value: design.uncertainty ?? uncertainty, start: uncertainty, range: [0, 0.5], isChanged: design.uncertainty !== null});
    const size = k => list => list[Math.min(k, list.length - 1)];
    about.outputs.forEach((_, k) => {
      const start = size(k)(reference), value = design.reference ? size(k)(design.reference) : start;
      knob(`reference-${k}`, {value, start, range: around(start), isChanged: value !== start});
    });
    about.inputs.forEach((_, k) => {
      const own = about.limits[k], limits = limitOf(design.limits[k], own), usual = own ? Math.max(...own.map(Math.abs)) : defaults.peaks[k] ?? 1;
      const isChanged = (design.limits[k] ?? null) !== null;
      knob(`limit-${k}`, {limits, start: own ? usual : null, size: usual, range: around(usual), isChanged});
    });
    const most = size(0)(design.reference ?? reference);
    knob('noise', {value: design.noise ?? noise, start: noise, range: [0, most], isChanged: design.noise !== null});
    const latest = 1 / (bandwidth ?? value);
    knob('delay', {value: design.delay ?? delay, start: delay, range: [0, Math.max(latest, 2 * delay)], isChanged: design.delay !== null});
  }
}

// The parameters of the controller, in groups.
class Parameters {
  constructor(place, onChange) {
    Object.assign(this, {place, onChange, knobs: new Map(), names: '', groups: new Map()});
  }

  build(parameters) {
    const names = JSON.stringify(parameters.map(({name, group, unit}) => [name, group, unit]));
    if (names === this.names) return;
    this.names = names;
    this.knobs.clear();
    this.groups.clear();
    this.place.replaceChildren();
    for (const [group, title] of [['poles', 'Poles'], ['gains', 'Gains'], ['other', 'Other parameters']]) {
      const own = parameters.filter(parameter => parameter.group === group);
      if (!own.length) continue;
      const knobs = own.map(({name, unit, description}) => {
        const knob = new Knob({id: `p-${name}`, label: name, unit: unit ?? '', description: description ?? ''}, value => this.onChange(name, value));
        this.knobs.set(name, knob);
        return knob.place;
      });
      const section = made('section', {}, made('h3', {}, title), ...knobs);
      this.groups.set(group, section);
      this.place.append(section);
    }
  }

  // Shows the parameters of an answer, with values that were changed since.
  show(parameters, values, isAll) {
    this.build(parameters);
    for (const {name, value: answered, default: start, min, max} of parameters) {
      const value = values[name] ?? start ?? answered, knob = this.knobs.get(name);
      Object.assign(knob, {least: min ?? -Infinity, most: max ?? Infinity});
      knob.show({value, start, isChanged: name in values, ...rangeOf(start ?? answered, min, max)});
    }
    if (this.groups.has('other')) this.groups.get('other').hidden = !isAll;
    return this.groups.has('other');
  }
}

// The range of a slider about a value, and its scale.
const rangeOf = (start, min, max) => {
  const within = value => Math.min(max ?? Infinity, Math.max(min ?? -Infinity, value));
  if (start === 0) {
    const range = [within(-1), within(1)];
    return {scale: 'linear', range: range[0] < range[1] ? range : [0, 1]};
  }
  const ends = [start / 10, start * 10].map(within), range = [Math.min(...ends), Math.max(...ends)];
  const isLogarithmic = range[0] * range[1] > 0 && range[0] < range[1];
  return {scale: isLogarithmic ? 'logarithmic' : 'linear', range: range[0] < range[1] ? range : [start - 1, start + 1]};
};
