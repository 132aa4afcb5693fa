// The controls of the page `explore`: one a parameter, by what it is. A control shows the value that is chosen, and tells
// of another by `onChoose`.
'use strict';
const POSITIONS = 1000;
const made = (kind, attributes = {}, ...children) => {
  const made = document.createElement(kind);
  Object.assign(made, attributes);
  made.append(...children);
  return made;
};
const written = value => typeof value !== 'number' ? String(value ?? '–') : String(Number(value.toPrecision(5)));

// What all have: a label, the way back to the value that the case has, and a place for what is wrong.
class Control {
  // `values` has `of(name)`, the value that is chosen, and `start(name)`, that of the case.
  constructor(given, id, values, onChoose) {
    Object.assign(this, given, {id, values, onChoose});
    this.label = made('label', {htmlFor: id, title: this.description}, this.name.slice(this.unit.length + 1));
    if (this.measure && this.measure !== '1') this.label.append(' ', made('small', {}, `(${this.measure})`));
    const description = this.acts ? `${this.acts}: ${this.description}` : this.description;
    this.label.append(' ', made('small', {}, description));
    this.back = made('button', {type: 'button'}, '↺');
    this.back.addEventListener('click', () => this.choose(this.values.start(this.name)));
    this.wrong = made('p', {className: 'wrong bad', hidden: true});
    this.place = made('div', {className: `slider ${given.control}`}, this.label, ...this.fields(), this.back, this.wrong);
    this.place.dataset.name = this.name;
  }

  // A value as a link has it; undefined where it is none of this parameter.
  read() {}

  choose(value) {
    this.onChoose(this, value);
    this.show();
  }

  show() {
    const value = this.values.of(this.name), start = this.values.start(this.name);
    this.showValue(value);
    this.back.title = `Back to ${start}`;
    this.back.setAttribute('aria-label', `${this.name} back to ${start}`);
    this.place.classList.toggle('moved', value !== start);
  }

  refuse(reason) {
    this.wrong.textContent = reason ?? '';
    this.wrong.hidden = !reason;
    this.place.classList.toggle('refused', Boolean(reason));
    if (reason) this.place.hidden = false;
  }
}

// A Real: a slider, and a field for what lies beside it or between its positions.
class Slider extends Control {
  fields() {
    this.wide = this.range;
    this.slide = made('input', {type: 'range', min: 0, max: POSITIONS, step: 1, id: this.id});
    this.entry = made('input', {type: 'number', step: 'any', autocomplete: 'off'});
    this.entry.setAttribute('aria-label', this.name);
    if (!this.range) this.entry.id = this.label.htmlFor = `${this.id}-entry`;
    this.slide.addEventListener('input', () => this.choose(this.at(Number(this.slide.value))));
    this.entry.addEventListener('change', () => {
      const value = this.entry.valueAsNumber;
      if (Number.isFinite(value)) this.choose(value); else this.show();
    });
    return [this.range ? this.slide : made('span', {className: 'beside'}, 'no limit'), this.entry];
  }

  read(text) {
    return text.trim() && Number.isFinite(Number(text)) ? Number(text) : undefined;
  }

  at(position) {
    const [low, high] = this.wide, part = position / POSITIONS;
    if (position <= 0) return low;
    if (position >= POSITIONS) return high;
    const value = this.logarithmic ? low * (high / low) ** part : low + part * (high - low);
    return Number(value.toPrecision(4));
  }

  position(value) {
    const [low, high] = this.wide;
    const part = this.logarithmic ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    return Math.round(Math.min(1, Math.max(0, part)) * POSITIONS);
  }

  showValue(value) {
    if (this.range) {
      // A value that was typed may lie beside the slider: then it goes so far.
      const [low, high] = this.range;
      this.wide = [Math.min(low, this.logarithmic && value <= 0 ? low : value), Math.max(high, value)];
      this.slide.value = this.position(value);
      this.slide.setAttribute('aria-valuetext', written(value));
    }
    if (this.entry.valueAsNumber !== value) this.entry.value = value;
  }
}

// An Integer: a field with steps of one.
class Whole extends Control {
  fields() {
    const [min, max] = this.limits;
    this.entry = made('input', {type: 'number', step: 1, min: min ?? '', max: max ?? '', id: this.id, autocomplete: 'off'});
    // Not `input`: a number is typed digit by digit.
    this.entry.addEventListener('change', () => {
      const value = this.read(this.entry.value);
      if (value !== undefined) this.choose(value); else this.show();
    });
    const range = min === null && max === null ? 'a whole number' : `${min ?? '…'} to ${max ?? '…'}`;
    return [made('span', {className: 'beside'}, range), this.entry];
  }

  read(text) {
    const value = Number(text);
    return text.trim() && Number.isInteger(value) && Math.abs(value) < 2 ** 31 ? value : undefined;
  }

  showValue(value) {
    if (this.entry.value !== String(value)) this.entry.value = value;
  }
}

// A Boolean: a box to tick.
class Tick extends Control {
  fields() {
    this.box = made('input', {type: 'checkbox', id: this.id});
    this.box.addEventListener('change', () => this.choose(this.box.checked));
    return [this.box];
  }

  read(text) {
    return {true: true, false: false}[text];
  }

  showValue(value) {
    this.box.checked = value;
  }
}

// An Enumeration: its items.
class Choice extends Control {
  fields() {
    this.list = made('select', {id: this.id}, ...this.items.map(item => made('option', {value: item}, item)));
    this.list.addEventListener('change', () => this.choose(this.list.value));
    return [this.list];
  }

  read(text) {
    return this.items.includes(text) ? text : undefined;
  }

  showValue(value) {
    this.list.value = value;
  }
}

const CONTROLS = {slider: Slider, whole: Whole, tick: Tick, choice: Choice};
