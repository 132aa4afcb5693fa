// Draws the diagrams of a page from the numbers beside them. Dragging zooms, time in all diagrams at once; a double click
// shows all again; a click on a name hides its curve.
'use strict';
const HEIGHT = 330, LEFT = 76, RIGHT = 16, TOP = 10, BOTTOM = 42;
// A pointer that moves less than this many pixels has not dragged.
const DRAGGED = 8;

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

// The place of the last of ascending numbers that is not above a value; the first where all are.
const before = (numbers, value) => {
  let [low, high] = [0, numbers.length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= value) low = middle; else high = middle;
  }
  return low;
};

const diagrams = [];

class Diagram {
  constructor(place) {
    Object.assign(this, JSON.parse(place.querySelector('script').textContent), {place, hidden: new Set(), values: null});
    const ends = this.curves.flatMap(({x}) => [x[0], x[x.length - 1]]).filter(Number.isFinite);
    this.all = ends.length ? [Math.min(...ends), Math.max(...ends)] : [0, 1];
    if (this.all[0] === this.all[1]) this.all[1] += 1;
    this.times = this.all;
    this.told = document.createElement('div');
    this.told.className = 'told';
    this.legend = document.createElement('p');
    this.legend.className = 'legend';
    this.curves.forEach((curve, k) => this.legend.append(this.entry(curve, k)));
    place.append(this.told, this.legend);
  }

  entry({name, colour}, k) {
    const entry = document.createElement('button');
    entry.append(name);
    entry.style.setProperty('--colour', colour);
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

  // The values of what is seen, a little apart.
  range() {
    if (this.values) return this.values;
    let [low, high] = [Infinity, -Infinity];
    for (const {x, y} of this.visible) {
      for (let k = before(x, this.times[0]); k < x.length && (k === 0 || x[k - 1] < this.times[1]); k++) {
        if (y[k] !== null) [low, high] = [Math.min(low, y[k]), Math.max(high, y[k])];
      }
    }
    if (low > high) return [-1, 1];
    const apart = high > low ? 0.06 * (high - low) : 0.1 * Math.max(Math.abs(low), 1);
    return [low - apart, high + apart];
  }

  draw(width = this.place.clientWidth || 680) {
    const [from, to] = this.times, [low, high] = this.range();
    const [right, bottom] = [Math.max(width - RIGHT, LEFT + 50), HEIGHT - BOTTOM];
    this.scale = {
      across: time => LEFT + (time - from) / (to - from) * (right - LEFT),
      up: value => bottom - (value - low) / (high - low) * (bottom - TOP),
      time: pixel => from + Math.min(1, Math.max(0, (pixel - LEFT) / (right - LEFT))) * (to - from),
      value: pixel => low + Math.min(1, Math.max(0, (bottom - pixel) / (bottom - TOP))) * (high - low),
      right, bottom,
    };
    const drawn = element('svg', {width, height: HEIGHT, role: 'img', 'aria-label': this.title});
    this.axes(drawn);
    // What lies outside is cut off by an inner picture.
    const inside = element('svg', {x: LEFT, y: TOP, width: right - LEFT, height: bottom - TOP,
      viewBox: `${LEFT} ${TOP} ${right - LEFT} ${bottom - TOP}`});
    for (const curve of this.visible) inside.append(this.line(curve));
    this.mark = element('path', {class: 'mark'});
    this.zoomed = element('rect', {class: 'zoomed', width: 0, height: 0});
    inside.append(this.mark, this.zoomed);
    drawn.append(inside);
    this.listen(drawn);
    this.drawn?.remove();
    this.place.prepend(drawn);
    this.drawn = drawn;
    this.told.hidden = true;
  }

  axes(drawn) {
    const {across, up, right, bottom} = this.scale;
    for (const [time, text] of ticks(this.times, Math.max(2, (right - LEFT) / 90))) {
      drawn.append(element('path', {class: 'grid', d: `M${across(time)},${TOP}V${bottom}`}));
      drawn.append(element('text', {x: across(time), y: bottom + 16, 'text-anchor': 'middle'}, text));
    }
    for (const [value, text] of ticks(this.range(), 6)) {
      drawn.append(element('path', {class: 'grid', d: `M${LEFT},${up(value)}H${right}`}));
      drawn.append(element('text', {x: LEFT - 6, y: up(value) + 4, 'text-anchor': 'end'}, text));
    }
    drawn.append(element('text', {x: (LEFT + right) / 2, y: HEIGHT - 6, 'text-anchor': 'middle'}, this.x));
    const turned = `translate(13 ${(TOP + bottom) / 2}) rotate(-90)`;
    drawn.append(element('text', {transform: turned, 'text-anchor': 'middle'}, this.y));
  }

  line({x, y, colour, dashed}) {
    const {across, up} = this.scale;
    const end = before(x, this.times[1]) + 2;
    let path = '', gap = true;
    for (let k = Math.max(0, before(x, this.times[0])); k < Math.min(end, x.length); k++) {
      if (y[k] !== null) path += `${gap ? 'M' : 'L'}${across(x[k]).toFixed(2)},${up(y[k]).toFixed(2)}`;
      gap = y[k] === null;
    }
    return element('path', {class: 'curve', d: path, stroke: colour, 'stroke-dasharray': dashed ? '7 5' : 'none'});
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

  // The values of all curves at the time under the pointer.
  tell(across) {
    const time = this.scale.time(across), lines = [];
    for (const {name, x, y, colour} of this.visible) {
      let k = before(x, time);
      if (k + 1 < x.length && x[k + 1] - time < time - x[k]) k++;
      const line = document.createElement('div');
      line.style.setProperty('--colour', colour);
      line.append(`${name}: ${y[k] === null ? '–' : Number(y[k].toPrecision(6))}`);
      lines.push(line);
    }
    this.told.replaceChildren(`t = ${Number(time.toPrecision(6))} s`, ...lines);
    this.told.hidden = false;
    const x = this.scale.across(time), room = this.place.clientWidth - this.told.offsetWidth;
    this.told.style.left = `${x + 12 < room ? x + 12 : Math.max(0, x - 12 - this.told.offsetWidth)}px`;
    this.mark.setAttribute('d', `M${x},${TOP}V${this.scale.bottom}`);
  }
}

const showTimes = times => diagrams.forEach(diagram => {
  diagram.times = times ?? diagram.all;
  diagram.draw();
});

document.querySelectorAll('.diagram').forEach(place => diagrams.push(new Diagram(place)));
const drawAll = width => diagrams.forEach(diagram => diagram.draw(width));
drawAll();
addEventListener('resize', () => drawAll());
// On paper they are as wide as the paper.
addEventListener('beforeprint', () => drawAll(680));
addEventListener('afterprint', () => drawAll());
