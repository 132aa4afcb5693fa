// The page of `explore`: each change of a parameter runs the loop anew, and its curves and metrics are drawn in place of the
// last. Diagrams are drawn by
// `Diagram` (diagrams.js), parameters moved by controls (controls.js); `backend` runs the
// loop (server.js, or browser.js where there is no server). What is chosen stands behind the # of the address.
'use strict';
const $ = id => document.getElementById(id);

let loop = null, asItIs = null, lastTook = 0;
// The case, and the values that differ from those of the case.
let chosen = {case: null, values: {}}, steps = null;
const controls = new Map(), drawn = [];

const starts = () => loop.cases.find(known => known.name === chosen.case)?.values ?? loop.cases[0].values;
const valueOf = name => chosen.values[name] ?? starts()[name];

// ---- controls

const choose = (control, value) => {
  if (value === starts()[control.name]) delete chosen.values[control.name]; else chosen.values[control.name] = value;
  moved = control;
  change();
};
let moved = null;

const showAll = () => controls.forEach(control => control.show());

const filter = () => {
  const words = $('find').value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const group of $('sliders').children) {
    let any = false;
    for (const place of group.querySelectorAll('.slider')) {
      const {name, acts, description, first} = controls.get(place.dataset.name);
      const text = `${name} ${acts ?? ''} ${description}`.toLowerCase();
      const isFound = words.length ? words.every(word => text.includes(word)) : $('all').checked || first;
      place.hidden = !(isFound || name in chosen.values && !words.length);
      any ||= !place.hidden;
    }
    group.hidden = !any;
    shown += any;
  }
  $('none').hidden = shown > 0;
};

// ---- the link

const fromLink = () => {
  const link = new URLSearchParams(location.hash.slice(1));
  const known = link.get('case');
  chosen = {case: loop.cases.some(it => it.name === known) ? known : null, values: {}};
  for (const [name, text] of link) {
    const value = controls.get(name)?.read(text);
    if (value !== undefined && value !== starts()[name]) chosen.values[name] = value;
  }
  $('case').value = chosen.case ?? '';
  steps.texts = link.getAll('event');
};

const toLink = () => {
  const link = new URLSearchParams(chosen.values);
  if (chosen.case !== null) link.set('case', chosen.case);
  steps.texts.forEach(text => link.append('event', text));
  const text = String(link);
  history.replaceState(null, '', text ? `#${text}` : `${location.pathname}${location.search}`);
};
let linking = null;

// ---- runs

// What the last run has drawn, and what the run before the last change had.
let last = null, ghost = null;
let number = 0, flying = null, isWanted = false, later = null, settling = null;
// A while after the last change, in ms, metrics are measured with the loop's own communication step.
const PAUSE = 400;

// Something was changed: the loop is run with the latest values, at most one run at a time.
const change = () => {
  isWanted = true;
  // While a slider moves, what was there before it did.
  if (document.body.dataset.settled) ghost = last;
  document.body.dataset.settled = '';
  clearTimeout(settling);
  clearTimeout(linking);
  linking = setTimeout(toLink, 250);
  requestAnimationFrame(pump);
};

const pump = () => {
  if (!isWanted) return;
  const patience = lastTook < backend.patience && !flying?.fine ? backend.patience : 0;
  const waits = flying ? patience - (performance.now() - flying.begun) : 0;
  if (waits > 0) {
    later ??= setTimeout(() => { later = null; pump(); }, waits);
    return;
  }
  isWanted = false;
  run();
};

const run = async (fine = false) => {
  flying?.stop.abort();
  const mine = flying = {number: ++number, fine, begun: performance.now(), stop: new AbortController()};
  const wanted = {number: mine.number, fine, case: chosen.case, values: chosen.values, events: steps.events};
  const isPlain = chosen.case === null && !steps.events.length && !Object.keys(chosen.values).length;
  try {
    await backend.run(wanted, mine.stop.signal, line => {
      if (flying === mine) take(line, isPlain, performance.now() - mine.begun);
    });
  } catch (error) {
    if (error.name !== 'AbortError' && flying === mine) lost();
  } finally {
    if (flying === mine) {
      flying = null;
      $('progress').hidden = true;
      if (isWanted) pump(); else settle();
    }
  }
};

// After a pause, what was measured about is measured as it should be.
const settle = () => {
  if (isFine) document.body.dataset.settled = 'yes';
  else settling = setTimeout(() => flying === null && !isWanted && run(true), PAUSE);
};
let isFine = true;

const take = (line, isPlain, took) => {
  if (line.done !== undefined) {
    $('progress').hidden = false;
    $('progress').value = line.done;
    const what = flying.fine ? 'measuring' : 'running';
    $('status').textContent = line.waits ? 'waiting for the run of another page' : `${what}: ${Math.round(100 * line.done)} %`;
  } else if (line.error) {
    wrong(line.error);
  } else if (line.refused) {
    refused(line);
  } else if (!line.superseded) {
    if (!flying.fine) lastTook = took;
    isFine = line.fine;
    if (isPlain && line.fine) asItIs = line.metrics;
    show(line, took);
  }
};

const lost = () => wrong(backend.lost);

const wrong = reason => {
  isFine = true;
  $('diagrams').classList.add('stale');
  $('status').textContent = '';
  $('shortfall').textContent = reason;
  $('shortfall').hidden = false;
};

// A unit doesn't take these values: the last curves stay, greyed.
const refused = ({refused, at, events}) => {
  controls.forEach(control => control.refuse(null));
  steps.refuse(refused, events);
  const places = at.length || events.length ? at.map(name => controls.get(name)) : [moved];
  places.filter(Boolean).forEach(control => control.refuse(refused));
  wrong(`Not run: ${refused}`);
};

const show = ({fine, diagrams: given, metrics, warnings, shortfall, events, end, points, seconds}, took) => {
  controls.forEach(control => control.refuse(null));
  steps.refuse(shortfall, events);
  $('diagrams').classList.remove('stale');
  $('shortfall').textContent = shortfall ? `This run ${shortfall}` : '';
  $('shortfall').hidden = !shortfall;
  $('status').textContent = `${points} points to t = ${end} s in ${Math.round(1000 * seconds)} ms, shown after ${Math.round(took)} ms`;
  showDiagrams(given);
  showMetrics(metrics, shortfall, fine);
  list($('warnings'), warnings, `${warnings.length} warning${warnings.length === 1 ? '' : 's'}`);
  document.body.dataset.run = String(number);
};

const showDiagrams = given => {
  last = given;
  $('ghost').classList.toggle('shown', ghost !== null);
  given.forEach((numbers, k) => {
    if (drawn[k]) {
      drawn[k].show(numbers, ghost?.[k]);
      return;
    }
    const place = made('div', {className: 'diagram'});
    $('diagrams').append(made('h2', {}, numbers.title), place);
    drawn[k] = new Diagram(place, numbers);
    diagrams.push(drawn[k]);
    drawn[k].draw();
  });
};

const showMetrics = (metrics, shortfall, fine) => {
  const about = value => value === null || fine ? written(value) : `≈ ${Number(value.toPrecision(3))}`;
  const row = ({label, value, limit, holds}) => {
    const within = holds === null ? '–' : !fine ? '…' : holds ? 'yes' : 'no';
    return made('tr', {}, made('td', {}, label), made('td', {className: 'number'}, written(asItIs?.find(it => it.label === label)?.value)),
      made('td', {className: 'number'}, about(value)), made('td', {className: 'number'}, limit === null ? '' : String(limit)),
      made('td', {className: holds === false && fine ? 'bad' : ''}, within));
  };
  $('metrics').hidden = metrics.length === 0;
  $('metrics').querySelectorAll('th')[2].textContent = shortfall ? 'until then' : 'now';
  $('metrics').querySelector('tbody').replaceChildren(...metrics.map(row));
};

const list = (place, texts, title) => {
  place.hidden = texts.length === 0;
  if (title) place.querySelector('summary').textContent = title;
  place.querySelector('ul').replaceChildren(...texts.map(text => made('li', {}, text)));
};

// ---- what is kept

const keep = async (what, told, wanted = {case: chosen.case, values: {...chosen.values}, name: $('name').value}) => {
  $('kept').textContent = '…';
  try {
    const given = await backend.keep(what, wanted);
    const wrong = [made('span', {className: 'bad'}, given.error ?? '')];
    if (given.isThere) {
      const replace = made('button', {type: 'button'}, 'Replace');
      replace.addEventListener('click', () => keep(what, told, {...wanted, replace: true}));
      wrong.push('. ', replace);
    }
    $('kept').replaceChildren(...(given.error ? wrong : told(given)));
  } catch {
    $('kept').textContent = '';
    lost();
  }
};

const downloaded = ({set}) => {
  const link = made('a', {href: URL.createObjectURL(new Blob([set], {type: 'application/xml'})), download: `${$('name').value}.ssv`});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  return ['The parameter set was downloaded.'];
};

const saved = ({file}) => {
  const events = steps.texts.map(text => ` --event '${text}'`).join('');
  return [`Saved: ${file}. With it: run ${loop.name} --case ${file}${events}`];
};

const exported = ({folder, fmus, left_out: left}) => {
  const files = made('ul', {}, ...fmus.map(file => made('li', {}, file)));
  const kept = left.length ? [`Not exported, because their FMUs are not from this package: ${left.join(', ')}. A parameter set stores their values.`] : [];
  return [`${fmus.length} FMUs that start with these values are in ${folder}:`, files, ...kept];
};

const listen = () => {
  $('save').hidden = $('export').hidden = !backend.writes;
  $('find').addEventListener('input', filter);
  $('all').addEventListener('change', filter);
  $('case').addEventListener('change', () => {
    chosen = {case: $('case').value || null, values: {}};
    showAll();
    filter();
    change();
  });
  $('reset').addEventListener('click', () => {
    chosen.values = {};
    steps.texts = [];
    showAll();
    filter();
    change();
  });
  $('blocks').addEventListener('click', event => {
    const unit = event.target.closest('.block')?.dataset.unit;
    if (!unit) return;
    $('find').value = $('find').value === `${unit}.` ? '' : `${unit}.`;
    filter();
  });
  $('keep').addEventListener('submit', event => event.preventDefault());
  $('save').addEventListener('click', () => keep('save', saved));
  $('download').addEventListener('click', () => keep('set', downloaded));
  $('export').addEventListener('click', () => keep('export', exported));
  $('link').addEventListener('click', async () => {
    toLink();
    try {
      await navigator.clipboard.writeText(location.href);
      $('kept').textContent = 'The address with these values was copied.';
    } catch {
      $('kept').textContent = `The address with these values: ${location.href}`;
    }
  });
  addEventListener('hashchange', () => {
    fromLink();
    showAll();
    filter();
    change();
  });
};

const begin = async () => {
  loop = await backend.loop();
  const {start, stop, step, fine_step: fine} = loop.settings;
  $('description').textContent = loop.description;
  const then = step > fine ? `; when you pause, metrics use one point every ${fine} s` : '';
  $('form').textContent = `${loop.whole ? 'Simulated as a single FMU' : 'Run as separate FMUs'} from ${start} to ${stop} s, one point every ${step} s${then}.`;
  $('blocks').innerHTML = loop.blocks;
  steps = new Steps($('steps'), loop.changeable, loop.settings, change);
  for (const {name} of loop.cases) $('case').append(made('option', {value: name ?? ''}, name ?? 'as it is'));
  const groups = new Map();
  const values = {of: valueOf, start: name => starts()[name]};
  for (const given of loop.parameters) {
    const control = new CONTROLS[given.control](given, `p-${controls.size}`, values, choose);
    controls.set(control.name, control);
    if (!groups.has(control.unit)) groups.set(control.unit, made('section', {}, made('h2', {}, control.unit)));
    groups.get(control.unit).append(control.place);
  }
  $('sliders').append(...[...groups.values()].sort((a, b) => firsts(b) - firsts(a)));
  list($('notes'), loop.notes);
  listen();
  fromLink();
  showAll();
  filter();
  change();
};
const firsts = group => [...group.querySelectorAll('.slider')].filter(place => controls.get(place.dataset.name).first).length;

begin().catch(error => wrong(error.message));
