// The plant: what was entered becomes the text of a model file as `new --plant` reads it.
'use strict';
// A limit of at least this size is none.
const NO_LIMIT = 1e15;

// Errors of an entry: {field: reason}.
class WrongPlant extends Error {
  constructor(fields) {
    super(Object.values(fields)[0]);
    this.fields = fields;
  }
}

// Runs readers by field, and collects their errors.
const readAll = readers => {
  const found = {}, fields = {};
  for (const [field, read] of Object.entries(readers)) {
    try {
      found[field] = read();
    } catch (error) {
      if (!(error instanceof Wrong)) throw error;
      fields[field] = error.message;
    }
  }
  if (Object.keys(fields).length) throw new WrongPlant(fields);
  return found;
};

// Adds names and units of signals, {x: [key, text, count], …}.
const withSignals = (model, given) => {
  const found = readAll(Object.fromEntries(Object.values(given).map(([key, text, count]) => [key, () => signals(text, count)])));
  const units = {};
  for (const [unit, [key]] of Object.entries(given)) {
    if (!found[key]) continue;
    model[key] = found[key].names;
    if (found[key].units) units[unit] = found[key].units;
  }
  if (Object.keys(units).length) model.units = units;
  return model;
};

const FORMS = {
  transfer: ({num, den, inputs, outputs}) => {
    const model = readAll({num: () => coefficients(num), den: () => coefficients(den)});
    const [n, m] = [model.den.length - 1, model.num.length - 1];
    if (n < 1) throw new WrongPlant({den: 'The denominator must have a power of s, as in “1 0.5 2”.'});
    if (m > n) throw new WrongPlant({num: `The numerator has degree ${m}. It must be at most ${n}, that of the denominator.`});
    return withSignals(model, {u: ['inputs', inputs, 1], y: ['outputs', outputs, 1]});
  },
  matrices: ({A, B, C, D, states, inputs, outputs}) => {
    const given = readAll({A: () => rowsOf(A), B: () => rowsOf(B), C: () => rowsOf(C), D: () => D.trim() ? rowsOf(D) : null});
    const n = given.A.length;
    if (given.A[0].length !== n) throw new WrongPlant({A: `A is ${sized(given.A)}. It must be square.`});
    // A single row may mean a column, and the reverse, where A leaves no doubt.
    if (given.B.length === 1 && given.B[0].length === n) given.B = transposed(given.B);
    if (given.C[0].length === 1 && given.C.length === n) given.C = transposed(given.C);
    const fields = {};
    if (given.B.length !== n) fields.B = `B is ${sized(given.B)}. It must have ${n} rows, as A.`;
    if (given.C[0].length !== n) fields.C = `C is ${sized(given.C)}. It must have ${n} columns, as A.`;
    const [m, p] = [given.B[0].length, given.C.length];
    if (given.D && (given.D.length !== p || given.D[0].length !== m)) fields.D = `D is ${sized(given.D)}. It must be ${p} × ${m}.`;
    if (Object.keys(fields).length) throw new WrongPlant(fields);
    if (!given.D) delete given.D;
    return withSignals(given, {x: ['states', states, n], u: ['inputs', inputs, m], y: ['outputs', outputs, p]});
  },
  example: ({example}, examples) => {
    const known = examples.find(({name}) => name === example);
    if (!known) throw new WrongPlant({example: 'Choose a plant.'});
    return JSON.parse(known.plant);
  },
  file: ({text}) => {
    if (!text) throw new WrongPlant({file: 'Choose a file with a model or a record.'});
    return parsed(text);
  },
};

// The object of a model file.
const parsed = text => {
  let model = null;
  try {
    model = JSON.parse(text);
  } catch (error) {
    throw new WrongPlant({file: `The file is not valid JSON: ${error.message}.`});
  }
  const isModel = typeof model === 'object' && model !== null && ['A', 'num'].some(key => model[key] !== undefined && model[key] !== null);
  if (!isModel) throw new WrongPlant({file: 'The file has no model: it must be an object with A, B and C, or with num and den.'});
  return model;
};

// A matrix of a file: there a column, a row or a number may be a plain one.
const matrixOf = (given, isColumn) => {
  if (!Array.isArray(given)) return [[given]];
  if (given.every(Array.isArray)) return given;
  return isColumn ? given.map(entry => [entry]) : [given];
};
const listOf = (given, count) => given === undefined || given === null ? null : Array.isArray(given) ? given : Array(count).fill(given);
// Names of signals, which may be objects or missing.
const namesOf = (given, letter, count) => {
  const names = listOf(given, count)?.map(entry => typeof entry === 'object' ? entry?.name : entry);
  return Array.from({length: count}, (_, k) => names?.[k] || `${letter}[${k + 1}]`);
};

// Sizes, names and units of a model.
const about = model => {
  const isTransfer = model.num !== undefined && model.num !== null;
  const n = isTransfer ? null : matrixOf(model.A).length;
  const one = [[0]];
  const B = isTransfer ? one : matrixOf(model.B, n > 1), C = isTransfer ? one : matrixOf(model.C, n === 1);
  const m = B[0]?.length ?? 1, p = C.length;
  const unit = key => listOf(model.units?.[key], key === 'u' ? m : p) ?? [];
  const [low, high] = [listOf(model.u_min, m), listOf(model.u_max, m)];
  return {
    isTransfer, m, p,
    inputs: namesOf(model.inputs, 'u', m), outputs: namesOf(model.outputs, 'y', p),
    inputUnits: unit('u'), outputUnits: unit('y'),
    limits: Array.from({length: m}, (_, k) => low && high && Math.max(Math.abs(low[k]), Math.abs(high[k])) < NO_LIMIT ? [low[k], high[k]] : null),
    delay: Math.max(0, ...(listOf(model.delay, m) ?? [])),
  };
};

// The model with some of its outputs.
const following = (model, places) => {
  const {m, p} = about(model), some = list => places.map(place => list[place]);
  const chosen = {...model, C: some(matrixOf(model.C))};
  if (model.D !== undefined && model.D !== null) chosen.D = some(matrixOf(model.D, m === 1));
  if (Array.isArray(model.outputs) && model.outputs.length === p) chosen.outputs = some(model.outputs);
  if (Array.isArray(model.units?.y) && model.units.y.length === p) chosen.units = {...model.units, y: some(model.units.y)};
  return chosen;
};

// The outputs that follow references if nothing else is chosen: the first ones, as many as inputs.
const followed = (state, {m, p}) => {
  const given = state.follow.filter(place => place < p);
  return given.length ? given : Array.from({length: Math.min(m, p)}, (_, k) => k);
};

// The plant of a state of the page: {text, about, whole}, where `whole` has all outputs. Throws WrongPlant.
const plantOf = (state, examples) => {
  const form = FORMS[state.form] ?? FORMS.example;
  let model = form(state.source, examples);
  let whole = null;
  try {
    whole = about(model);
  } catch {
    throw new WrongPlant({file: 'The model has a matrix that is no list of rows of numbers.'});
  }
  const sources = {...whole};
  if (whole.p > 1 && whole.p !== whole.m || state.follow.length) model = following(model, followed(state, whole));
  const chosen = about(model);
  const limits = state.limits.slice(0, chosen.m);
  if (limits.some(limit => limit !== null && limit !== undefined)) {
    const now = chosen.limits.map((own, k) => limitOf(limits[k], own) ?? [-NO_LIMIT, NO_LIMIT]);
    const isLimited = now.some(([, high]) => high < NO_LIMIT);
    model = {...model};
    delete model.u_min;
    delete model.u_max;
    if (isLimited) Object.assign(model, {u_min: now.map(([low]) => low), u_max: now.map(([, high]) => high)});
  }
  if (state.delay !== null) model = {...model, delay: state.delay};
  return {text: JSON.stringify(model), model, about: chosen, whole: sources};
};

// The limits of a control, [low, high] or null: as chosen (a size, or 0 for none), otherwise those of the plant.
const limitOf = (chosen, own) => chosen === null || chosen === undefined ? own : chosen === 0 ? null : [-chosen, chosen];
