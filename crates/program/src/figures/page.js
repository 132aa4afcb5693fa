// Draws diagrams, and lets a reader zoom them: dragging zooms, time in all diagrams of the page at once; a double click shows
// all again; a click on a name hides its curve.
//
// `new Diagram(place, given)` draws one into an element with the class `diagram`; `diagram.show(given, ghost)` draws other
// numbers in its place, over the pale curves of `ghost` if there are any, and keeps what is zoomed and hidden. `given` is
//   title, x, y   words: at the diagram, at the axis of times, at that of values
//   decades       [low, high], the ends of a logarithmic axis of values; null where it is linear
//   peak          a peak at the start or at the end, in whose range the rest would be flat: {from, until, value, low, high} are
//                 its times, its largest value, and the range of the rest; null where there is none
//   marks         times of events: {time, text}
//   curves        name, colour, dashes (lengths of lines and gaps in pixels, none of a solid line), beneath (whether it is a
//                 reference, which lies beneath the others), x and y (arrays of one length; null where there is no value)
// The program decides all of them (src/simulation/diagram); this file decides nothing about what a curve is.
'use strict';
// Its height in pixels, on a wide and on a narrow screen.
const WIDE = 330, NARROW = 240;
const height = () => matchMedia('screen and (max-width: 50em)').matches ? NARROW : WIDE;
const LEFT = 76, RIGHT = 16, TOP = 10, BOTTOM = 42;
// A pointer that moves less than this many pixels has not dragged.
const DRAGGED = 8;
// How much longer than a peak the time is that is shown of it.
const AROUND_PEAK = 1.6;
// Pale curves within so many times the range of the others are in view.
const WITHIN = 3;

const element = (name, attributes, text) => {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  if (text !== undefined) made.textContent = text;
  return made;
};

// Round numbers in a range, about so many of them, as they are written.
const ticks = ([low, high], count) => {
  const rough = (high - low) / count, ten = 10 ** Math.floor(Math.log10(rough));
  const step = ten * [1, 2, 5, 10].find(factor => factor * ten >= rough * (1 - 1e-9));
  const first = Math.ceil(low / step - 1e-9), last = Math.floor(high / step + 1e-9);
  const largest = Math.max(Math.abs(low), Math.abs(high));
  const written = value => {
    if (value === 0) return '0';
    const places = Math.floor(Math.log10(step) + 1e-9), leading = Math.floor(Math.log10(Math.abs(value)) + 1e-9);
    if (largest >= 1e5 || largest < 1e-3) return value.toExponential(Math.min(Math.max(0, leading - places), 15));
    return value.toFixed(Math.min(Math.max(0, -places), 15));
  };
  return Array.from({length: last - first + 1}, (_, k) => (first + k) * step).map(value => [value, written(value)]);
};

// Powers of ten in a range.
const powers = ([low, high], count) => {
  const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
  if (last - first < 1) return ticks([low, high], count).filter(([value]) => value > 0);
  const step = Math.max(1, Math.ceil((last - first) / count));
  const raised = power => String(power).replace(/./g, c => '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'['-0123456789'.indexOf(c)]);
  const written = power => power === 0 ? '1' : `10${power === 1 ? '' : raised(power)}`;
  return Array.from({length: Math.floor((last - first) / step) + 1}, (_, k) => first + k * step)
    .map(power => [10 ** power, written(power)]);
};

// The place of the last of ascending numbers that is not above a value; the first where all are.
const before = (numbers, value) => {
  let [low, high] = [0, numbers.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= value) low = middle; else high = middle;
  }
  return low;
};

// The place of the number that is nearest to a value.
const nearest = (numbers, value) => {
  const k = before(numbers, value);
  return numbers[k + 1] - value < value - numbers[k] ? k + 1 : k;
};

const diagrams = [];

class Diagram {
  constructor(place, given) {
    Object.assign(this, {place, hidden: new Set(), values: null, times: null, ghosts: []});
    const made = (kind, name, parent) => {
      const made = document.createElement(kind);
      made.className = name;
      parent.append(made);
      return made;
    };
    this.plot = made('div', 'plot', place);
    this.told = made('div', 'readout', this.plot);
    this.note = made('button', 'peak', this.plot);
    this.note.addEventListener('click', () => {
      this.values = null;
      this.whole = true;
      const {from, until} = this.peak, length = AROUND_PEAK * (until - from);
      showTimes(this.first ? [from, from + length] : [until - length, until]);
    });
    this.legend = made('div', 'legend', place);
    this.take(given);
  }

  // Draws other numbers.
  show(given, ghost) {
    this.ghosts = ghost?.curves ?? [];
    this.take(given);
    this.draw();
  }

  take(given) {
    const before = this.all;
    Object.assign(this, given);
    const ends = this.curves.flatMap(({x}) => [x[0], x[x.length - 1]]).filter(Number.isFinite);
    this.all = ends.length ? [Math.min(...ends), Math.max(...ends)] : [0, 1];
    if (this.all[0] === this.all[1]) this.all[1] += 1;
    if (!this.times || this.times === before) this.times = this.all;
    this.first = this.peak?.from < (this.all[0] + this.all[1]) / 2;
    const goes = this.first ? 'At the start it goes' : 'At the end it goes';
    this.note.textContent = this.peak ? `${goes} to ${Number(this.peak.value.toPrecision(3))}: show that` : '';
    this.legend.replaceChildren(...this.curves.map((curve, k) => this.entry(curve, k)));
  }

  entry({name, colour, dashes, beneath}, k) {
    const entry = document.createElement('button'), sample = element('svg', {width: 34, height: 10});
    sample.append(element('path', {d: 'M0,5H34', stroke: colour, 'stroke-width': beneath ? 3.2 : 1.5,
      'stroke-opacity': beneath ? 0.55 : 1, 'stroke-dasharray': dashes.join(' ') || 'none'}));
    entry.append(sample, name);
    entry.classList.toggle('hidden', this.hidden.has(k));
    entry.addEventListener('click', () => {
      this.hidden.delete(k) || this.hidden.add(k);
      entry.classList.toggle('hidden', this.hidden.has(k));
      this.draw();
    });
    return entry;
  }

  get visible() {
    return this.curves.filter((_, k) => !this.hidden.has(k));
  }

  get pale() {
    return this.ghosts.filter((_, k) => !this.hidden.has(k));
  }

  // Whether a peak is left out: as long as nobody has zoomed.
  get cut() {
    return Boolean(this.peak) && this.times === this.all && !this.values && !this.whole;
  }

  // The values of what is seen, a little apart.
  range() {
    if (this.values) return this.values;
    if (this.cut) return [this.peak.low, this.peak.high];
    if (this.decades && this.times === this.all) return this.decades;
    let [low, high] = this.ends(this.visible);
    const [least, most] = this.ends(this.pale);
    if (most - least <= WITHIN * (high - low)) [low, high] = [Math.min(low, least), Math.max(high, most)];
    if (this.decades) return high > 0 ? [Math.max(low, this.decades[0], 1e-9 * high) / 1.2, high * 1.2] : this.decades;
    if (low > high) return [-1, 1];
    const apart = high > low ? 0.06 * (high - low) : 0.1 * Math.max(Math.abs(low), 1);
    return [low - apart, high + apart];
  }

  // The smallest and the largest of what is seen of some curves.
  ends(curves) {
    let [low, high] = [Infinity, -Infinity];
    for (const {x, y} of curves) {
      for (let k = before(x, this.times[0]); k < x.length && (k === 0 || x[k - 1] < this.times[1]); k++) {
        if (y[k] !== null) [low, high] = [Math.min(low, y[k]), Math.max(high, y[k])];
      }
    }
    return [low, high];
  }

  // Draws it, so wide.
  draw(width = this.plot.clientWidth || 680) {
    const [from, to] = this.times, [low, high] = this.range();
    this.height = height();
    const [right, bottom] = [Math.max(width - RIGHT, LEFT + 50), this.height - BOTTOM];
    this.scale = {
      across: time => LEFT + (time - from) / (to - from) * (right - LEFT),
      up: value => bottom - this.part(value, low, high) * (bottom - TOP),
      time: pixel => from + Math.min(1, Math.max(0, (pixel - LEFT) / (right - LEFT))) * (to - from),
      value: pixel => {
        const part = Math.min(1, Math.max(0, (bottom - pixel) / (bottom - TOP)));
        return this.decades ? low * (high / low) ** part : low + part * (high - low);
      },
      right, bottom,
    };
    const drawn = element('svg', {width, height: this.height, role: 'img', 'aria-label': this.title});
    this.axes(drawn);
    // What lies outside is cut off by an inner picture.
    const inside = element('svg', {x: LEFT, y: TOP, width: right - LEFT, height: bottom - TOP,
      viewBox: `${LEFT} ${TOP} ${right - LEFT} ${bottom - TOP}`});
    for (const {time, text} of this.marks.filter(({time}) => time >= from && time <= to)) {
      const event = element('path', {class: 'event', d: `M${this.scale.across(time)},${TOP}V${bottom}`});
      event.append(element('title', {}, text));
      inside.append(event);
    }
    for (const curve of this.pale) inside.append(this.line(curve, 'ghost'));
    // References lie beneath.
    for (const beneath of [true, false]) {
      for (const curve of this.visible.filter(curve => curve.beneath === beneath)) inside.append(this.line(curve));
    }
    this.mark = element('path', {class: 'mark'});
    this.zoomed = element('rect', {class: 'zoomed', width: 0, height: 0});
    inside.append(this.mark, this.zoomed);
    drawn.append(inside);
    this.listen(drawn);
    this.drawn?.remove();
    this.plot.prepend(drawn);
    this.drawn = drawn;
    this.told.hidden = true;
    this.note.hidden = !this.cut;
  }

  // The part of the axis of values at which a value lies; what a logarithm can't take lies below it.
  part(value, low, high) {
    if (!this.decades) return (value - low) / (high - low);
    return value > 0 ? Math.max(-1, Math.log(value / low) / Math.log(high / low)) : -1;
  }

  axes(drawn) {
    const {across, up, right, bottom} = this.scale;
    for (const [time, text] of ticks(this.times, Math.max(2, (right - LEFT) / 90))) {
      drawn.append(element('path', {class: 'grid', d: `M${across(time)},${TOP}V${bottom}`}));
      drawn.append(element('text', {x: across(time), y: bottom + 16, 'text-anchor': 'middle'}, text));
    }
    for (const [value, text] of (this.decades ? powers : ticks)(this.range(), 6)) {
      drawn.append(element('path', {class: 'grid', d: `M${LEFT},${up(value)}H${right}`}));
      drawn.append(element('text', {x: LEFT - 6, y: up(value) + 4, 'text-anchor': 'end'}, text));
    }
    drawn.append(element('text', {x: (LEFT + right) / 2, y: this.height - 6, 'text-anchor': 'middle'}, this.x));
    const turned = `translate(13 ${(TOP + bottom) / 2}) rotate(-90)`;
    drawn.append(element('text', {transform: turned, 'text-anchor': 'middle'}, this.y));
  }

  line({x, y, colour, dashes, beneath}, kind = beneath ? 'curve beneath' : 'curve') {
    const {across, up} = this.scale;
    const end = before(x, this.times[1]) + 2;
    let path = '', gap = true;
    for (let k = Math.max(0, before(x, this.times[0])); k < Math.min(end, x.length); k++) {
      if (y[k] !== null) path += `${gap ? 'M' : 'L'}${across(x[k]).toFixed(2)},${up(y[k]).toFixed(2)}`;
      gap = y[k] === null;
    }
    return element('path', {class: kind, d: path, stroke: colour,
      'stroke-dasharray': dashes.join(' ') || 'none'});
  }

  listen(drawn) {
    const place = event => {
      const box = drawn.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    let start = null;
    drawn.addEventListener('pointerdown', event => {
      if (event.button === 0) start = place(event);
      event.preventDefault();
    });
    drawn.addEventListener('pointermove', event => {
      this.tell(...place(event));
      if (start) this.outline(start, place(event));
    });
    drawn.addEventListener('pointerup', event => {
      if (start) this.zoom(start, place(event));
      start = null;
    });
    drawn.addEventListener('pointerleave', () => {
      start = null;
      this.outline([0, 0], [0, 0]);
      this.told.hidden = true;
      this.mark.removeAttribute('d');
    });
    drawn.addEventListener('dblclick', () => {
      this.values = null;
      diagrams.forEach(diagram => diagram.whole = false);
      showTimes(null);
    });
  }

  // What is dragged over: times, values or both, as the pointer went across, up or both.
  dragged([a, b], [c, d]) {
    const {right, bottom} = this.scale;
    const [wide, tall] = [Math.abs(a - c) >= DRAGGED, Math.abs(b - d) >= 3 * DRAGGED];
    const [left, top] = [wide ? Math.min(a, c) : LEFT, tall ? Math.min(b, d) : TOP];
    return {wide, tall, left, top, width: wide ? Math.abs(a - c) : right - LEFT, height: tall ? Math.abs(b - d) : bottom - TOP};
  }

  outline(start, end) {
    const {wide, tall, left, top, width, height} = this.dragged(start, end);
    const shown = wide || tall ? {x: left, y: top, width, height} : {x: 0, y: 0, width: 0, height: 0};
    Object.entries(shown).forEach(([key, value]) => this.zoomed.setAttribute(key, value));
  }

  zoom(start, end) {
    const {wide, tall, left, top, width, height} = this.dragged(start, end);
    const {time, value} = this.scale;
    if (tall) this.values = [value(top + height), value(top)];
    if (wide) showTimes([time(left), time(left + width)]);
    else if (tall) this.draw();
    else this.outline(start, start);
  }

  // The points of all curves that are nearest to the pointer, each a recorded one.
  tell(across) {
    const wanted = this.scale.time(across), lines = [], points = this.visible.map(({x}) => nearest(x, wanted));
    const times = this.visible.map(({x}, k) => x[points[k]]);
    const time = times.reduce((a, b) => Math.abs(b - wanted) < Math.abs(a - wanted) ? b : a, Infinity);
    const digits = value => value === null ? '–' : Number(value.toPrecision(6));
    let marks = '';
    this.visible.forEach(({name, y, colour}, k) => {
      const value = y[points[k]], line = document.createElement('div');
      line.style.setProperty('--colour', colour);
      line.append(`${name}: ${digits(value)}${times[k] === time ? '' : ` at ${digits(times[k])}`}`);
      lines.push(line);
      if (value !== null) marks += `M${this.scale.across(times[k])},${this.scale.up(value)}m-3,0a3,3 0 1 0 6,0a3,3 0 1 0 -6,0`;
    });
    const [, quantity, unit] = /^(.*?)(?: \((.*)\))?$/.exec(this.x);
    this.told.replaceChildren(`${quantity} = ${digits(Number.isFinite(time) ? time : wanted)} ${unit ?? ''}`, ...lines);
    this.told.hidden = false;
    // Its width where nothing narrows it.
    this.told.style.left = '0';
    const x = this.scale.across(Number.isFinite(time) ? time : wanted), room = this.plot.clientWidth - this.told.offsetWidth;
    this.told.style.left = `${x + 12 < room ? x + 12 : Math.max(0, x - 12 - this.told.offsetWidth)}px`;
    this.mark.setAttribute('d', `M${x},${TOP}V${this.scale.bottom}${marks}`);
  }
}

const showTimes = times => diagrams.forEach(diagram => {
  diagram.times = times ?? diagram.all;
  diagram.draw();
});

document.querySelectorAll('.diagram').forEach(place => {
  const given = place.querySelector('script[type="application/json"]');
  if (given) diagrams.push(new Diagram(place, JSON.parse(given.textContent)));
});
const drawAll = width => diagrams.forEach(diagram => diagram.draw(width));
drawAll();
addEventListener('resize', () => drawAll());
// On paper they are as wide as the paper.
addEventListener('beforeprint', () => drawAll(680));
addEventListener('afterprint', () => drawAll());
