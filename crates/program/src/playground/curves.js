// The pictures of a design: diagrams (diagrams.js) whose horizontal axis may be logarithmic, with the worst plants as a pale
// band, and with poles as marks.
'use strict';
// Colours of signals, in their order; references and limits are black.
const COLOURS = ['#0072B2', '#D55E00', '#009E73', '#B4568F', '#3F9FD0', '#A67C00'];
const BOUND = '#000000';
const TALL = 230, SHORT = 190;
// A step of the keyboard, as a part of what is shown.
const KEY_STEP = 0.01;

const raisedTo = power => `10${power === 1 ? '' : String(power).replace(/./g, c => '⁻⁰¹²³⁴⁵⁶⁷⁸⁹'['-0123456789'.indexOf(c)])}`;

// A picture as the program gives it, for `Plot`. Names of signals are those of the plant.
const plotted = (picture, {outputs, output_units: units}) => {
  const own = name => {
    const place = /^output(?: (\d+))?$/.exec(name);
    return place ? outputs[Number(place[1] ?? 1) - 1] ?? name : name;
  };
  const names = [];
  const colourOf = name => {
    if (!names.includes(name)) names.push(name);
    return COLOURS[names.indexOf(name) % COLOURS.length];
  };
  const across = value => picture.logarithmic ? Math.log10(value) : value;
  const curve = ({name, of, points}) => {
    const isBound = of === 'bound';
    return {
      name: isBound && levels.has(name) ? levelled(name) : own(name), colour: isBound ? BOUND : of.endsWith('marks') ? COLOURS[0] : colourOf(own(name)), dashes: isBound ? [6, 4] : [], beneath: false, of,
      x: points.map(([x]) => across(x)), y: points.map(([, y]) => y),
    };
  };
  // A limit or a reference has its values in its name, as it may be out of view.
  const levels = grouped(picture.curves.filter(({of, name}) => of === 'bound' && !/^[-\d]/.test(name)));
  const levelled = name => `${name}: ${levels.get(name).map(({points}) => written(points[0][1])).join(', ')}`;
  // What is nominal decides on colours.
  const all = [...picture.curves].sort((a, b) => (a.of !== 'nominal') - (b.of !== 'nominal')).map(curve);
  const isPale = ({of}) => of === 'worst' || of === 'worst_marks';
  const isMarks = all.some(({of}) => of.endsWith('marks'));
  const unit = units.length && new Set(units).size === 1 && units[0] && units[0] !== '1' ? ` (${units[0]})` : '';
  const y = picture.y === 'outputs' ? `${outputs.length === 1 ? outputs[0] : 'outputs'}${unit}` : picture.y;
  return {
    title: picture.title, x: picture.x.replace(/ in (\S+)$/, ' ($1)'), y: y.replace(/ in (\S+)$/, ' ($1)'), decades: null, peak: null, marks: [],
    isLogarithmic: picture.logarithmic, isMarks, curves: all.filter(one => !isPale(one)), worst: all.filter(isPale),
  };
};

// Several plots zoom together if they have the same axis.
// The least range of a phase that is shown, in degrees.
const LEAST_PHASE = 30;

class Plot extends Diagram {
  constructor(place, given, group) {
    super(place, given);
    this.group = group;
    this.plot.tabIndex = 0;
    this.plot.addEventListener('keydown', event => this.move(event));
    this.plot.addEventListener('blur', () => this.leave());
  }

  get height() {
    return matchMedia('screen and (max-width: 50em)').matches ? SHORT : TALL;
  }

  // `Diagram` sets its own, for a page that has less to show.
  set height(_) {}

  show(given, ghost, width) {
    this.ghosts = ghost?.curves ?? [];
    this.take(given);
    this.draw(width);
  }

  // As that of `Diagram`, but an unchanged legend stays, and with it the focus.
  take(given) {
    const before = this.all, names = this.curves?.map(({name, colour}) => name + colour).join();
    Object.assign(this, given);
    let [low, high] = [Infinity, -Infinity];
    for (const {x} of [...this.curves, ...this.worst]) {
      for (const value of x) [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
    if (low > high) [low, high] = [0, 1];
    // Poles show the imaginary axis, and have room around them.
    if (this.isMarks) [low, high] = [low, Math.max(high, 0)].map((end, k) => end + (k - 0.5) * 0.1 * (Math.max(high, 0) - low || 1));
    if (low === high) high = low + 1;
    this.all = [low, high];
    if (!this.times || this.times === before) this.times = this.all;
    if (this.curves.map(({name, colour}) => name + colour).join() === names) return;
    this.legend.hidden = this.isMarks;
    const isFirst = ({name}, k) => this.curves.findIndex(other => other.name === name) === k;
    this.legend.replaceChildren(...this.curves.map((curve, k) => isFirst(curve, k) && this.entry(curve, k)).filter(Boolean));
  }

  // One entry for all curves of a name, such as both limits of a control.
  entry(curve, k) {
    const entry = super.entry(curve, k);
    entry.type = 'button';
    entry.setAttribute('aria-pressed', String(!this.hidden.has(k)));
    entry.addEventListener('click', () => {
      const isHidden = this.hidden.has(k);
      this.curves.forEach(({name}, other) => name === curve.name && (isHidden ? this.hidden.add(other) : this.hidden.delete(other)));
      entry.setAttribute('aria-pressed', String(!isHidden));
      this.draw();
    });
    return entry;
  }

  // The worst plants of the signals that are seen.
  get bands() {
    const hidden = new Set(this.curves.filter((_, k) => this.hidden.has(k)).map(({name}) => name));
    return this.worst.filter(({name}) => !hidden.has(name));
  }

  range() {
    if (this.values) return this.values;
    let [low, high] = this.ends(this.visible.filter(({of}) => of !== 'bound').concat(this.bands));
    // Limits and pale curves that are far away would flatten the rest.
    const bounds = this.visible.filter(({of}) => of === 'bound').map(bound => [bound]);
    for (const curves of [...bounds, this.pale]) {
      const [least, most] = this.ends(curves), both = [Math.min(low, least), Math.max(high, most)];
      if (!(high > low) || both[1] - both[0] <= WITHIN * (high - low)) [low, high] = both;
    }
    if (low > high) return [-1, 1];
    if (this.isMarks) low = Math.min(low, 0);
    // Less of a phase would show roundings.
    if (this.y === 'deg') [low, high] = [Math.min(low, (low + high) / 2 - LEAST_PHASE / 2), Math.max(high, (low + high) / 2 + LEAST_PHASE / 2)];
    const apart = high > low ? 0.06 * (high - low) : 0.1 * Math.max(Math.abs(low), 1e-12);
    return [low - apart, high + apart];
  }

  // Poles aren't in the order of their real parts.
  ends(curves) {
    if (!this.isMarks) return super.ends(curves);
    const seen = curves.flatMap(({x, y}) => y.filter((_, k) => x[k] >= this.times[0] && x[k] <= this.times[1]));
    return [Math.min(...seen), Math.max(...seen)];
  }

  draw(width) {
    super.draw(width);
    const inside = this.mark.parentNode;
    // Behind everything else: where several worst plants have one time axis, the area between them.
    for (const curves of grouped(this.bands).values()) {
      if (this.isMarks) inside.prepend(...curves.map(curve => this.line(curve, 'worst')));
      else inside.prepend(this.band(curves));
    }
    if (this.isMarks) {
      const {across, up, right, bottom} = this.scale;
      inside.prepend(element('path', {class: 'mark', d: `M${across(0)},${TOP}V${bottom}M${LEFT},${up(0)}H${right}`}));
    }
  }

  // The area that the worst plants and the nominal one cover.
  band(curves) {
    const [first] = curves, nominal = this.curves.find(({name, of}) => name === first.name && of === 'nominal');
    const all = [...curves, ...(nominal ? [nominal] : [])].filter(({x}) => x.length === first.x.length);
    const {across, up} = this.scale;
    const point = (k, choose) => `${across(first.x[k]).toFixed(2)},${up(choose(...all.map(({y}) => y[k]))).toFixed(2)}`;
    const places = first.x.map((_, k) => k);
    const upper = places.map(k => point(k, Math.max)), lower = places.map(k => point(k, Math.min)).reverse();
    const area = element('path', {class: 'band', d: `M${upper.concat(lower).join('L')}Z`, stroke: first.colour});
    area.style.color = first.colour;
    return area;
  }

  line(curve, kind) {
    if (!this.isMarks || curve.of === 'bound') return super.line(curve, kind);
    const {across, up} = this.scale, size = kind === undefined ? 5 : 3.5;
    const cross = (x, y) => `M${x - size},${y - size}l${2 * size},${2 * size}m0,${-2 * size}l${-2 * size},${2 * size}`;
    const d = curve.x.map((x, k) => cross(across(x), up(curve.y[k]))).join('');
    return element('path', {class: `pole ${kind ?? ''}`, d, stroke: curve.colour});
  }

  axes(drawn) {
    if (!this.isLogarithmic) {
      super.axes(drawn);
      return;
    }
    // `Diagram` draws the rest; times are powers of ten here.
    const {times, scale} = this, [low, high] = times;
    const each = Math.max(1, Math.ceil((high - low) / Math.max(2, (scale.right - LEFT) / 60)));
    const first = Math.ceil(low - 1e-9), powers = Array.from({length: Math.max(0, Math.floor(high + 1e-9) - first + 1)}, (_, k) => first + k);
    const shown = powers.filter((_, k) => k % each === 0).map(power => [power, power === 0 ? '1' : raisedTo(power)]);
    // Few powers of ten are in view: round numbers instead.
    const marked = shown.length > 1 ? shown : ticks([10 ** low, 10 ** high], 4).filter(([value]) => value > 0).map(([value, text]) => [Math.log10(value), text]);
    for (const [at, text] of marked) {
      drawn.append(element('path', {class: 'grid', d: `M${scale.across(at)},${TOP}V${scale.bottom}`}));
      drawn.append(element('text', {x: scale.across(at), y: scale.bottom + 16, 'text-anchor': 'middle'}, text));
    }
    for (const [value, text] of ticks(this.range(), 5)) {
      drawn.append(element('path', {class: 'grid', d: `M${LEFT},${scale.up(value)}H${scale.right}`}));
      drawn.append(element('text', {x: LEFT - 6, y: scale.up(value) + 4, 'text-anchor': 'end'}, text));
    }
    drawn.append(element('text', {x: (LEFT + scale.right) / 2, y: this.height - 6, 'text-anchor': 'middle'}, this.x));
    drawn.append(element('text', {transform: `translate(13 ${(TOP + scale.bottom) / 2}) rotate(-90)`, 'text-anchor': 'middle'}, this.y));
  }

  zoom(start, end) {
    const {wide, tall, left, top, width, height} = this.dragged(start, end), {time, value} = this.scale;
    if (tall) this.values = [value(top + height), value(top)];
    if (wide) this.group.zoom(this, [time(left), time(left + width)]);
    else if (tall) this.draw();
    else this.outline(start, start);
  }

  listen(drawn) {
    super.listen(drawn);
    drawn.addEventListener('dblclick', () => {
      this.values = null;
      this.group.zoom(this, null);
    });
  }

  // The values that are nearest to the pointer.
  tell(across, down) {
    this.at = across;
    if (this.isMarks) {
      this.tellMark(across, down);
      return;
    }
    const {scale} = this, wanted = scale.time(across), short = value => Number(value.toPrecision(4));
    const lead = this.visible.find(({of}) => of !== 'bound') ?? this.visible[0];
    if (!lead) return;
    const at = lead.x[nearest(lead.x, wanted)], [, quantity, unit] = /^(.*?)(?: \((.*)\))?$/.exec(this.x);
    let marks = '';
    const isFirst = ({name}, k) => this.visible.findIndex(other => other.name === name) === k;
    const lines = this.visible.filter(isFirst).map(({name, colour, of, x, y}) => {
      const value = y[nearest(x, at)], line = made('div', {}, of === 'bound' ? name : `${name}: ${short(value)}`);
      line.style.setProperty('--colour', colour);
      if (of !== 'bound') marks += `M${scale.across(at)},${scale.up(value)}m-3,0a3,3 0 1 0 6,0a3,3 0 1 0 -6,0`;
      return line;
    });
    this.told.replaceChildren(`${quantity} = ${short(this.isLogarithmic ? 10 ** at : at)} ${unit ?? ''}`, ...lines);
    const x = scale.across(at);
    this.moveReadout(x);
    this.mark.setAttribute('d', `M${x},${TOP}V${scale.bottom}${marks}`);
  }

  // Shows the readout at the side of a point that has room.
  moveReadout(x) {
    this.told.hidden = false;
    // Its width where nothing narrows it.
    this.told.style.left = '0';
    const room = this.plot.clientWidth - this.told.offsetWidth;
    this.told.style.left = `${x + 12 < room ? x + 12 : Math.max(0, x - 12 - this.told.offsetWidth)}px`;
  }

  tellMark(across, down) {
    const {scale} = this;
    const all = [...this.visible, ...this.bands].flatMap(({name, x, y, colour}) => x.map((real, k) => ({name, colour, real, imaginary: y[k]})));
    const far = ({real, imaginary}) => Math.hypot(scale.across(real) - across, down ? scale.up(imaginary) - down : 0);
    const [pole] = all.sort((a, b) => far(a) - far(b));
    if (!pole) return;
    const size = Math.hypot(pole.real, pole.imaginary), short = value => Number(value.toPrecision(4));
    const line = made('div', {}, pole.imaginary ? `${short(pole.real)} ± ${short(pole.imaginary)}j` : String(short(pole.real)));
    line.style.setProperty('--colour', pole.colour);
    const damping = size > 0 ? `, damping ratio ${short(-pole.real / size)}` : '';
    this.told.replaceChildren(`${pole.name}${damping}`, line);
    const x = scale.across(pole.real), y = scale.up(pole.imaginary);
    this.moveReadout(x);
    this.mark.setAttribute('d', `M${x},${y}m-8,0a8,8 0 1 0 16,0a8,8 0 1 0 -16,0`);
  }

  // Left and right move the readout; + and - zoom; Escape ends both.
  move(event) {
    const {right} = this.scale, wide = right - LEFT, at = Math.min(right, Math.max(LEFT, this.at ?? (LEFT + right) / 2));
    const {key} = event;
    if (key === 'ArrowLeft' || key === 'ArrowRight') {
      this.tell(at + (key === 'ArrowLeft' ? -1 : 1) * (event.shiftKey ? 10 : 1) * KEY_STEP * wide, 0);
    } else if (key === '+' || key === '-') {
      const [from, to] = this.times, centre = this.scale.time(at), half = (to - from) * (key === '+' ? 0.25 : 1);
      const [first, last] = this.all;
      this.group.zoom(this, key === '-' && half * 2 >= last - first ? null : [Math.max(first, centre - half), Math.min(last, centre + half)]);
    } else if (key === 'Escape') {
      this.values = null;
      this.leave();
      this.group.zoom(this, null);
    } else return;
    event.preventDefault();
  }

  leave() {
    this.told.hidden = true;
    this.mark?.removeAttribute('d');
  }
}

const grouped = curves => {
  const groups = new Map();
  for (const curve of curves) groups.set(curve.name, [...(groups.get(curve.name) ?? []), curve]);
  return groups;
};

// All plots of a design.
class Plots {
  constructor(place) {
    Object.assign(this, {place, all: new Map()});
    addEventListener('resize', () => this.draw());
    addEventListener('beforeprint', () => this.draw(680));
    addEventListener('afterprint', () => this.draw());
  }

  // Shows pictures over the pale ones of `ghost`, with captions by title.
  show(pictures, signals, ghost, captions) {
    const old = new Map((ghost ?? []).map(picture => [picture.title, picture]));
    const known = new Set(pictures.map(({title}) => title));
    for (const [title, {figure}] of this.all) {
      if (known.has(title)) continue;
      figure.remove();
      this.all.delete(title);
    }
    // All widths before anything is drawn: then the browser lays the page out once.
    const widths = new Map([...this.all].map(([title, {plot}]) => [title, plot.plot.clientWidth]));
    for (const picture of pictures) {
      const given = plotted(picture, signals), before = old.has(picture.title) && plotted(old.get(picture.title), signals);
      // Only what is nominal: bands and limits of both would hide each other.
      const pale = before && {curves: given.curves.map(({name, of}) =>
        before.curves.find(other => other.name === name && other.of === of && of !== 'bound') ?? NOTHING)};
      if (!this.all.has(picture.title)) this.add(picture.title, given);
      const {plot, caption} = this.all.get(picture.title);
      plot.show(given, pale, widths.get(picture.title));
      const text = captions(picture);
      if (caption.textContent !== text) caption.textContent = text;
      caption.hidden = !text;
    }
    const figures = pictures.map(({title}) => this.all.get(title).figure);
    if (figures.some((figure, k) => this.place.children[k] !== figure)) this.place.replaceChildren(...figures);
  }

  add(title, given) {
    const place = made('div', {className: 'diagram'}), caption = made('p', {className: 'quiet caption', hidden: true});
    const figure = made('figure', {}, made('figcaption', {}, title), place, caption);
    this.place.append(figure);
    this.all.set(title, {figure, caption, plot: new Plot(place, given, this)});
  }

  // Shows a part of the axis in a plot and in those with the same axis; null shows all.
  zoom(from, times) {
    for (const {plot} of this.all.values()) {
      if (plot !== from && (plot.x !== from.x || from.isMarks)) continue;
      plot.times = times ?? plot.all;
      plot.draw();
    }
  }

  draw(width) {
    for (const {plot} of this.all.values()) plot.draw(width);
  }
}
const NOTHING = {name: '', colour: BOUND, dashes: [], beneath: false, of: 'nominal', x: [], y: []};
