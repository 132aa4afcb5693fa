// The forms in which a plant is entered, and records that become plants.
'use strict';
// The largest file that is read, in bytes.
const LARGEST_FILE = 64e6;
// Entries that are typed are taken after so long a pause, in ms.
const TYPED = 350;
const TEXTS = ['num', 'den', 'A', 'B', 'C', 'D', 'states', 'inputs', 'outputs'];

class Forms {
  // `onChange(patch)` takes what changes in the design; `ask(slot, question, doing)` asks the program.
  constructor(examples, onChange, ask) {
    Object.assign(this, {examples, onChange, ask, design: null, plant: null, fields: {}});
    for (const radio of document.querySelectorAll('[name=form]')) radio.addEventListener('change', () => this.choose(radio.value));
    for (const {name, title} of examples) $('example').append(made('option', {value: name}, title));
    // What is being typed is no part of the design yet.
    this.typed = new Set();
    let pause = null;
    const take = () => {
      clearTimeout(pause);
      const source = Object.fromEntries([...this.typed].map(id => [id, $(id).value]));
      this.typed.clear();
      if (Object.entries(source).some(([id, text]) => this.design.source[id] !== text)) this.enter(source);
    };
    for (const id of TEXTS) {
      $(id).addEventListener('input', () => {
        this.typed.add(id);
        clearTimeout(pause);
        pause = setTimeout(take, TYPED);
        this.fit();
      });
      $(id).addEventListener('change', take);
    }
    $('dead').addEventListener('change', () => this.delay($('dead').value.trim()));
    $('example').addEventListener('change', () => this.enter({example: $('example').value}));
    $('file').addEventListener('change', () => this.read($('file').files[0]));
    addEventListener('dragover', event => event.preventDefault());
    addEventListener('drop', event => {
      event.preventDefault();
      const [file] = event.dataTransfer.files;
      if (!file) return;
      this.choose('file');
      this.read(file);
    });
  }

  // Another plant: what was changed for the last one no longer fits.
  enter(source, form = this.design.form) {
    this.onChange({form, source: {...this.design.source, ...source}, ...this.fresh(form === this.design.form && form !== 'example' && form !== 'file')});
  }

  fresh(isSame) {
    return isSame ? {} : {bandwidth: null, uncertainty: null, reference: null, noise: null, limits: [], delay: null, values: {}, follow: []};
  }

  choose(form) {
    if (form === this.design.form) return;
    const source = {};
    // Empty matrices begin with the plant that was there.
    if (form === 'matrices' && !this.design.source.A.trim()) Object.assign(source, this.asMatrices());
    this.enter(source, form);
  }

  // The dead time, which is a setting too.
  delay(text) {
    const value = text === '' ? null : Number(text), isWrong = value !== null && !(value >= 0 && Number.isFinite(value));
    tellWrong('dead', isWrong ? 'Enter a dead time of at least 0 s.' : null);
    if (!isWrong && value !== this.design.delay) this.onChange({delay: value});
  }

  asMatrices() {
    const model = this.plant?.model;
    if (!model || this.plant.about.isTransfer) return {A: '0 1\n-2 -3', B: '0\n1', C: '1 0'};
    const {A, B, C, D, states, inputs, outputs, units} = model;
    const n = matrixOf(A).length, text = (given, isColumn) => given ? written2(matrixOf(given, isColumn)) : '';
    const names = (given, unit) => Array.isArray(given) && given.every(name => typeof name === 'string') ? writtenSignals(given, unit) : '';
    return {A: text(A), B: text(B, n > 1), C: text(C), D: text(D),
      states: names(states, units?.x), inputs: names(inputs, units?.u), outputs: names(outputs, units?.y)};
  }

  // Shows a design; `plant` is null where `wrong` has reasons by field.
  show(design, plant, wrong) {
    const {form, source} = this.design = design;
    this.plant = plant ?? this.plant;
    for (const radio of document.querySelectorAll('[name=form]')) radio.checked = radio.value === form;
    for (const place of document.querySelectorAll('[data-form]')) place.hidden = place.dataset.form !== form;
    for (const id of TEXTS) if (!this.typed.has(id) && $(id).value !== source[id]) $(id).value = source[id];
    if (document.activeElement !== $('dead')) $('dead').value = design.delay ?? '';
    $('names').hidden = form === 'example' || form === 'file';
    document.querySelector('[data-only=matrices]').hidden = form !== 'matrices';
    $('example').value = source.example;
    $('example-about').textContent = this.examples.find(({name}) => name === source.example)?.about ?? '';
    $('file-name').textContent = source.file ? `Model: ${source.file}` : '';
    for (const id of [...TEXTS, 'file']) tellWrong(id, wrong?.[id]);
    if (wrong && ['states', 'inputs', 'outputs'].some(id => wrong[id])) $('names').open = true;
    this.fraction(wrong);
    this.outputs(design, plant);
    this.fit();
  }

  fraction(wrong) {
    const {source: {num, den}, delay} = this.design, late = delay ? ` · exp(−${written(delay)} s)` : '';
    const isShown = this.design.form === 'transfer' && !wrong?.num && !wrong?.den;
    try {
      $('fraction').textContent = isShown ? `G(s) = (${polynomial(coefficients(num))}) / (${polynomial(coefficients(den))})${late}` : '';
    } catch {
      $('fraction').textContent = '';
    }
  }

  // Text areas are as tall as their matrices.
  fit() {
    for (const place of document.querySelectorAll('#plant textarea')) {
      place.rows = Math.min(10, Math.max(place.id === 'A' || place.id === 'B' ? 2 : 1, place.value.split('\n').length));
    }
  }

  // A plant with more outputs than inputs: which of them follow references?
  outputs(design, plant) {
    const whole = plant?.whole, isShown = Boolean(whole) && (whole.p > whole.m || design.follow.length > 0);
    $('followed').hidden = !isShown;
    if (!isShown) return;
    const chosen = followed(design, whole);
    const boxes = whole.outputs.map((name, k) => {
      const box = made('input', {type: 'checkbox', checked: chosen.includes(k)});
      box.addEventListener('change', () => {
        const next = box.checked ? [...chosen, k].sort((a, b) => a - b) : chosen.filter(place => place !== k);
        if (next.length) this.onChange({follow: next, reference: null}); else box.checked = true;
      });
      return made('label', {className: 'tick'}, box, ` ${name}`);
    });
    const text = `The controllers take as many outputs as inputs: ${whole.m}.`;
    const key = JSON.stringify([whole.outputs, chosen]);
    // The focus stays where the boxes haven't changed.
    if (this.boxes === key) return;
    this.boxes = key;
    $('followed').replaceChildren(made('fieldset', {}, made('legend', {}, 'Outputs that follow references'), ...boxes, made('p', {className: 'quiet'}, text)));
  }

  // ---- files

  async read(file) {
    if (!file) return;
    $('record').hidden = $('identified').hidden = true;
    tellWrong('file', null);
    if (file.size > LARGEST_FILE) {
      tellWrong('file', `${file.name} has ${megabytes(file.size)}. The limit is ${megabytes(LARGEST_FILE)}.`);
      return;
    }
    const text = await file.text();
    if (/^\s*\{/.test(text)) {
      this.model(file.name, text);
    } else {
      await this.record(file.name, text);
    }
    // The same file can be chosen again.
    $('file').value = '';
  }

  model(name, text) {
    try {
      parsed(text);
      this.enter({file: name, text}, 'file');
    } catch (error) {
      if (!(error instanceof WrongPlant)) throw error;
      tellWrong('file', error.message);
    }
  }

  // A record: which of its columns are inputs, and which are measured?
  async record(name, csv) {
    try {
      const answer = await this.ask('columns', {columns: {csv}}, `Reading ${name}`);
      if (answer.error) throw new Wrong(answer.error);
      this.choices(name, csv, answer);
    } catch (error) {
      if (!(error instanceof Dropped)) tellWrong('file', error.message);
    }
  }

  choices(name, csv, {columns, time}) {
    const others = columns.filter(column => column !== time);
    const rows = others.map((column, k) => {
      // Records mostly have inputs first.
      const role = made('select', {}, ...[['', 'not used'], ['input', 'input'], ['measured', 'measured']].map(([value, text]) =>
        made('option', {value, selected: value === (k ? 'measured' : 'input')}, text)));
      role.dataset.column = column;
      return made('label', {className: 'field'}, column, ' ', role);
    });
    const kind = made('select', {}, made('option', {value: 'outputs'}, 'outputs; the order is found'), made('option', {value: 'states'}, 'all states of the plant'));
    const button = made('button', {type: 'submit'}, 'Identify a model');
    const wrong = made('p', {className: 'wrong bad', hidden: true});
    wrong.setAttribute('role', 'alert');
    $('record').replaceChildren(made('p', {}, `Record ${name}: ${others.length} columns${time ? `, time in ${time}` : ''}.`), ...rows,
      made('label', {className: 'field'}, 'The measured columns are ', kind), button, wrong);
    $('record').hidden = false;
    $('record').onsubmit = event => {
      event.preventDefault();
      const of = role => rows.map(row => row.querySelector('select')).filter(({value}) => value === role).map(({dataset}) => dataset.column);
      const [inputs, measured] = [of('input'), of('measured')];
      wrong.hidden = inputs.length > 0 && measured.length > 0;
      wrong.textContent = 'Choose at least one input and one measured column.';
      if (wrong.hidden) this.identify(name, {csv, inputs, states: kind.value === 'states' ? measured : null, outputs: kind.value === 'outputs' ? measured : null}, wrong);
    };
  }

  async identify(name, wanted, wrong) {
    try {
      const answer = await this.ask('identify', {identify: wanted}, 'Identifying a model');
      if (answer.error) throw new Wrong(answer.error);
      $('identified').textContent = answer.text;
      $('identified').hidden = false;
      this.enter({file: `${name}, identified`, text: answer.plant}, 'file');
    } catch (error) {
      wrong.textContent = error instanceof Dropped ? 'The identification was cancelled.' : error.message;
      wrong.hidden = false;
    }
  }
}
