// The page "From a plant to an FMU": each change of the design asks the program in this page anew, first quickly for the nominal
// plant, then, after a pause, for everything. `backend` (backend.js) answers.
'use strict';
// The full report is asked for so long after the last change, in ms.
const PAUSE = 400;
// Changes of one setting within so long are undone together, in ms.
const TOGETHER = 900;
const MOST_UNDONE = 200;
// The address follows the design after so long, in ms.
const LINKED = 500;
const FIELDS = {num: 'Numerator', den: 'Denominator', states: 'States', inputs: 'Inputs', outputs: 'Outputs', example: 'Example', file: 'File'};
const USUAL = {uncertainty: 0.2, reference: [1]};

let design = START, examples = [], plant = null, wrong = null;
let forms = null, kinds = null, settings = null, parameters = null, files = null;
const plots = new Plots($('pictures')), report = new Report();

// What the program has answered of the present plant.
let known = {bandwidth: null, peaks: null};
// The last answer, the last one that had everything, and what pale curves are of.
let last = null, settledAnswer = null, ghost = null;
// The last design that was refused.
let refusedDesign = null;
let pausing = null, linking = null, isWanted = false, isMoving = false;

// ---- questions

const states = new Map();
const onState = name => state => {
  if (state) states.set(name, state); else states.delete(name);
  const shown = states.get('slow') ?? states.get('quick');
  $('waiting').hidden = !shown;
  if (!shown) return;
  if (shown.progress === null) $('progress').removeAttribute('value'); else $('progress').value = shown.progress;
  $('doing').textContent = shown.doing;
  $('cancel').hidden = !shown.isCancellable;
};
// What takes long has a worker of its own where the page has a second one.
const quick = new Queue(backend, onState('quick'));
const slow = backend.long ? new Queue(backend.long, onState('slow')) : quick;
const dropSlow = () => new Set([quick, slow]).forEach(queue => queue.drop('full', 'cards'));

const example = () => design.form === 'example' ? examples.find(({name}) => name === design.source.example) : undefined;

const defaults = () => ({
  bandwidth: example()?.bandwidth ?? known.bandwidth,
  uncertainty: example()?.uncertainty ?? USUAL.uncertainty,
  reference: example()?.reference ?? USUAL.reference,
  noise: 0, delay: plant?.whole.delay ?? 0, peaks: known.peaks ?? [],
});

const sizes = () => design.reference ?? defaults().reference;

// The fields of a question about a kind of controller.
const asked = (kind = design.kind) => ({
  plant: plant.text, kind, name: design.name,
  bandwidth: design.bandwidth ?? example()?.bandwidth ?? null,
  uncertainty: design.uncertainty ?? example()?.uncertainty ?? null,
  // One for each output, also where the plant had others before.
  reference: plant.about.outputs.map((_, k) => sizes()[Math.min(k, sizes().length - 1)]),
  noise: design.noise || null,
  values: design.values[kind] ?? {},
});

const pump = () => {
  if (!isWanted) return;
  isWanted = false;
  if (wrong) {
    quick.drop('quick');
    const [[field, reason]] = Object.entries(wrong);
    refused(`Correct the plant first. ${FIELDS[field] ?? field}: ${reason}`, true);
  } else answer('quick', true);
};

// Asks for the chosen kind, and shows what is answered.
const answer = async (slot, isQuick) => {
  const of = design;
  try {
    const question = {design: {...asked(), quick: isQuick}};
    const given = await (isQuick ? quick : slow).ask(slot, question, isQuick ? 'Designing the controller' : 'Simulating uncertain plants');
    // A late answer of another plant or kind shows nothing that is still wanted.
    if (of.kind !== design.kind || wrong || question.design.plant !== plant.text) return;
    if (given.error && isQuick) {
      // The full report would be refused, too.
      refusedDesign = of;
      slow.drop('full');
    }
    if (given.error) refused(given.error, !isQuick || !isMoving, of);
    else show(given, isQuick, question.design);
    if (!isQuick || given.error) settled();
  } catch (error) {
    if (!(error instanceof Dropped)) refused(error.message, true);
    else if (!isQuick && of === design && !isMoving && of !== refusedDesign) {
      $('of-quick').textContent = 'Nominal plant only: the report with uncertain plants was cancelled. Change a setting to compute it.';
      settled();
    }
  }
};

// The verdicts of the other kinds, of the nominal plant.
const others = () => {
  for (const kind of kinds.cards.keys()) {
    if (kind === design.kind) continue;
    quick.ask('cards', {design: {...asked(kind), quick: true}}, 'Designing the other kinds').then(given => {
      if (given.error) kinds.show(kind, 'refused', given.error, true); else kinds.show(kind, given.verdict, summary(given), true);
    }).catch(error => {
      if (!(error instanceof Dropped)) kinds.show(kind, 'refused', error.message, true);
    });
  }
};

const pause = () => {
  isMoving = false;
  if (wrong) return;
  others();
  if (refusedDesign !== design) answer('full', false);
};

const settled = () => {
  document.body.dataset.settled = 'yes';
};

// ---- answers

const show = (given, isQuick, question) => {
  if (question.bandwidth === null) known.bandwidth = given.bandwidth;
  known.peaks ??= peaks(given);
  last = given;
  if (!isQuick) settledAnswer = given;
  $('results').classList.remove('stale');
  $('refused').hidden = true;
  showBadge($('verdict'), given.verdict);
  $('words').textContent = summary(given);
  if (!isQuick) $('live').textContent = `${VERDICTS[given.verdict]}: ${summary(given)}`;
  const isSame = ghost && JSON.stringify(ghost.signals.outputs) === JSON.stringify(given.signals.outputs);
  plots.show(given.pictures, given.signals, isSame ? ghost.pictures : null, captionOf(given));
  $('key').hidden = given.pictures.length === 0;
  $('ghost').hidden = !isSame;
  $('of-quick').textContent = 'Nominal plant only. The report with uncertain plants follows when you pause.';
  // While a slider moves, the full report stays.
  if (!isQuick || !isMoving || !report.text) report.show(given, isQuick);
  $('report').classList.toggle('stale', isQuick);
  kinds.show(given.kind, given.verdict, summary(given), isQuick);
  $('files').hidden = false;
  $('to-files').disabled = false;
  $('description').textContent = given.description;
  $('command').textContent = given.command;
  files.show(true);
  showSettings();
};

// The largest control of each channel, with some room: where a limit begins that the plant doesn't have.
const peaks = ({pictures, signals}) => signals.controls.map(control => {
  const curves = pictures.flatMap(({curves}) => curves).filter(({name, of}) => name === control && of === 'nominal');
  // The first picture with this signal shows it over time.
  const most = Math.max(0, ...(curves[0]?.points ?? []).map(([, value]) => Math.abs(value)));
  return most > 0 ? Number((1.2 * most).toPrecision(2)) : 1;
});

// There is no such design: the reason, over the last curves.
const refused = (reason, isFinal, of) => {
  $('results').classList.add('stale');
  $('report').classList.add('stale');
  $('refused').textContent = reason;
  $('refused').hidden = false;
  $('verdict').hidden = true;
  $('words').textContent = '';
  if (isFinal) $('live').textContent = '';
  // A reason that begins with a matrix belongs to its field.
  const field = /^(?:degree of )?(A|B|C|D|num|den)\b/.exec(reason)?.[1];
  if (of && field && ['transfer', 'matrices'].includes(design.form) && !wrong) tellWrong(field, reason);
  if (!wrong) kinds.show(design.kind, 'refused', reason, true);
  files.show(false);
  if (wrong) settled();
};

// ---- changes

let undone = [], redone = [], lastTag = null, lastTime = 0;

// Changes the design; changes with one tag soon after each other are undone together.
const change = (patch, tag = null) => {
  const now = performance.now();
  if (tag === null || tag !== lastTag || now - lastTime > TOGETHER) {
    undone = [...undone.slice(1 - MOST_UNDONE), design];
    redone = [];
  }
  [lastTag, lastTime] = [tag, now];
  become({...design, ...patch});
};

const step = (from, to) => {
  if (!from.length) return;
  to.push(design);
  lastTag = null;
  become(from.pop());
};
const undo = () => step(undone, redone);
const redo = () => step(redone, undone);

const become = next => {
  const isOther = next.form !== design.form || JSON.stringify(next.source) !== JSON.stringify(design.source) || next.follow.join() !== design.follow.join();
  const isOtherForm = next.form !== design.form;
  const isOtherKind = next.kind !== design.kind;
  design = next;
  try {
    [plant, wrong] = [plantOf(design, examples), null];
  } catch (error) {
    if (!(error instanceof WrongPlant)) throw error;
    wrong = error.fields;
  }
  if (isOther) {
    known = {bandwidth: null, peaks: null};
    kinds.forget();
  }
  // Where the default isn't known yet, a slider must not run away from itself.
  known.bandwidth ??= design.bandwidth;
  if (document.body.dataset.settled) ghost = settledAnswer;
  // Curves of another plant are no comparison.
  if (isOther && (next.form === 'example' || next.form === 'file' || isOtherForm)) ghost = settledAnswer = null;
  document.body.dataset.settled = '';
  isMoving = true;
  kinds.age();
  if (isOtherKind) $('parameters').classList.add('stale');
  forms.show(design, wrong ? null : plant, wrong);
  kinds.choose(design.kind);
  $('undo').disabled = !undone.length;
  $('redo').disabled = !redone.length;
  if ($('name').value !== design.name) $('name').value = design.name;
  showSettings();
  dropSlow();
  isWanted = true;
  requestAnimationFrame(pump);
  clearTimeout(pausing);
  pausing = setTimeout(pause, PAUSE);
  clearTimeout(linking);
  linking = setTimeout(toLink, LINKED);
};

const showSettings = () => {
  if (plant) settings.show(design, plantAbout(), defaults());
  if (last?.kind !== design.kind) return;
  $('parameters').classList.remove('stale');
  const isMore = parameters.show(last.parameters, design.values[design.kind] ?? {}, $('all').checked);
  $('all-label').hidden = !isMore;
};

// Limits of the plant itself, which the settings may replace.
const plantAbout = () => ({...plant.about, limits: plant.whole.limits, isRecorded: 'covariance' in plant.model});

const onSetting = (key, value, k) => {
  if (key === 'reference') {
    const start = defaults().reference, size = list => plant.about.outputs.map((_, i) => list[Math.min(i, list.length - 1)]);
    const next = size(design.reference ?? start);
    next[k] = value ?? size(start)[k];
    change({reference: JSON.stringify(next) === JSON.stringify(size(start)) ? null : next}, `reference ${k}`);
  } else if (key === 'limits') {
    const next = plant.about.inputs.map((_, i) => design.limits[i] ?? null);
    // Without a limit of its own, the plant has none either way.
    next[k] = value === 0 && !plant.whole.limits[k] ? null : value;
    change({limits: next.some(limit => limit !== null) ? next : []}, `limits ${k}`);
  } else change({[key]: value}, key);
};

const onParameter = (name, value) => {
  const own = {...design.values[design.kind]};
  if (value === null) delete own[name]; else own[name] = value;
  const values = {...design.values, [design.kind]: own};
  if (!Object.keys(own).length) delete values[design.kind];
  change({values}, `value ${name}`);
};

// ---- the link

const toLink = async () => {
  const hash = await toHash(design);
  history.replaceState(null, '', hash);
  return location.href;
};

// A link may leave the plant to the page.
const withExample = given => {
  if (given.form !== 'example' || given.source.example) return given;
  const first = examples.find(({name}) => name === 'dc_motor') ?? examples[0];
  return {...given, source: {...given.source, example: first?.name ?? ''}};
};

const fromLink = async () => {
  try {
    const given = await fromHash(location.hash);
    if (given && !kinds.cards.has(given.kind)) given.kind = START.kind;
    return given && withExample(given);
  } catch {
    $('linked').textContent = 'The link is damaged, so the page starts with an example.';
    return null;
  }
};

const listen = () => {
  $('undo').addEventListener('click', undo);
  $('redo').addEventListener('click', redo);
  $('to-files').addEventListener('click', () => {
    $('files').scrollIntoView();
    $('files-title').focus({preventScroll: true});
  });
  $('cancel').addEventListener('click', () => (states.has('slow') ? slow : quick).cancel());
  $('all').addEventListener('change', showSettings);
  $('name').addEventListener('change', () => {
    const name = $('name').value.trim();
    const isName = NAME.test(name);
    tellWrong('name', isName ? null : 'A name begins with a letter and has letters, digits and underscores.');
    if (isName && name !== design.name) change({name});
  });
  $('link').addEventListener('click', async () => {
    const address = await toLink(), isCopied = await copied(address);
    const text = isCopied ? `Link copied (${address.length} characters). It contains the whole design.` : 'Copy the address of this page: it contains the whole design.';
    $('linked').textContent = text;
  });
  addEventListener('keydown', event => {
    // Fields with text undo by themselves.
    const isText = event.target.matches('textarea, input:not([type=range], [type=radio], [type=checkbox])');
    if (!(event.ctrlKey || event.metaKey) || isText) return;
    const key = event.key.toLowerCase();
    if (key !== 'z' && key !== 'y') return;
    event.preventDefault();
    if (key === 'y' || event.shiftKey) redo(); else undo();
  });
  addEventListener('hashchange', async () => {
    const given = await fromLink();
    if (given) change(given);
  });
};

const begin = async () => {
  // The program is large: what is seen comes first.
  await new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve)));
  if (typeof PROGRAM === 'undefined') await script('program.js');
  const about = await quick.ask('about', {about: null}, 'Starting', false);
  if (about.error) throw new Error(about.error);
  examples = about.plants;
  forms = new Forms(examples, change, (slot, question, doing) => slow.ask(slot, question, doing));
  kinds = new Kinds($('kinds'), about.kinds, kind => change({kind}));
  settings = new Settings($('knobs'), onSetting);
  parameters = new Parameters($('parameters'), onParameter);
  files = new Files(slow, asked, () => plant?.text ?? '');
  listen();
  become(await fromLink() ?? withExample(START));
};

begin().catch(error => {
  $('refused').textContent = `The page can’t start: ${error.message}`;
  $('refused').hidden = false;
  $('words').textContent = '';
});
