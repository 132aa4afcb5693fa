// The verdict, the kinds of controllers with theirs, and the design report.
'use strict';
const VERDICTS = {ok: 'ok', warning: 'warning', not_sound: 'not sound', refused: 'refused'};
const SEVERITY = ['not_sound', 'warning', 'ok'];

const showBadge = (place, verdict) => {
  place.textContent = VERDICTS[verdict] ?? verdict;
  place.className = `badge ${verdict}`;
  place.hidden = false;
};

// The kinds of controllers, as radio buttons.
class Kinds {
  constructor(place, kinds, onChoose) {
    this.cards = new Map();
    for (const {kind, title, about} of kinds) {
      const radio = made('input', {type: 'radio', name: 'kind', value: kind});
      const badge = made('span', {className: 'badge', hidden: true}), words = made('span', {className: 'words quiet'}, about);
      radio.addEventListener('change', () => onChoose(kind));
      const card = made('label', {className: 'card'}, radio, made('span', {className: 'title'}, title), ' ', badge, words);
      this.cards.set(kind, {radio, badge, words, card, about});
      place.append(card);
    }
  }

  choose(kind) {
    for (const [own, {radio}] of this.cards) radio.checked = own === kind;
  }

  // Verdicts are of an earlier design until new ones come.
  age() {
    for (const {card} of this.cards.values()) card.classList.add('old');
  }

  forget() {
    for (const {badge, words, about} of this.cards.values()) {
      badge.hidden = true;
      words.textContent = about;
    }
  }

  // A verdict, with the reason or the summary; `isQuick` if it is of the nominal plant only.
  show(kind, verdict, text, isQuick) {
    const place = this.cards.get(kind);
    if (!place) return;
    place.card.classList.remove('old');
    showBadge(place.badge, verdict);
    const isNominal = isQuick && verdict !== 'refused';
    place.badge.classList.toggle('nominal', isNominal);
    place.badge.title = isNominal ? 'of the nominal plant only' : '';
    // As much as has room; the rest is in the results when the kind is chosen.
    place.words.textContent = text;
    place.words.title = text;
    place.card.classList.toggle('refused', verdict === 'refused');
  }
}

// The summary without the name and the verdict, which the badge shows.
const summary = ({name, sentence}) => {
  const own = sentence.startsWith(`${name}: `) ? sentence.slice(name.length + 2) : sentence;
  return own.replace(/^(?:sound|not sound|warning)(?:, with [^:]*)?: /, '');
};

// Gain, phase, delay and modulus margins, where the report has them.
const margins = findings => {
  const some = findings.filter(({name}) => /margin|sensitivity/i.test(name));
  return some.map(({name, lines, unit}) => `${name} ${lines.join(', ')}${unit && unit !== '1' ? ` ${unit}` : ''}`).join(' · ');
};

const captionOf = answer => {
  const text = margins(answer.findings), first = answer.pictures.find(({logarithmic}) => logarithmic);
  return picture => picture === first ? text : '';
};

class Report {
  constructor() {
    // Sections that the user has opened or closed.
    this.opened = new Map();
    this.text = '';
  }

  show(answer, isQuick) {
    $('report').hidden = false;
    $('of-quick').hidden = !isQuick;
    $('facts').textContent = `Bandwidth ${written(answer.bandwidth)} rad/s. Communication step ${written(answer.step)} s.`;
    const {noise, signals} = answer, text = JSON.stringify([answer.findings, answer.notes, noise]);
    if (text === this.text) return;
    this.text = text;
    const one = (name, k) => `${name} ${written(noise.controls[k])}${signals.control_units[k] ? ` ${signals.control_units[k]}` : ''}`;
    $('noise').hidden = !noise;
    $('noise').textContent = noise ? `Standard deviation of each control at rest, from the noise of the measurements: ${signals.controls.map(one).join(', ')}.` : '';
    const sections = new Map();
    for (const finding of answer.findings) sections.set(finding.section, [...(sections.get(finding.section) ?? []), finding]);
    const rank = findings => Math.min(...findings.map(({verdict}) => SEVERITY.indexOf(verdict)));
    const sorted = [...sections].sort(([, a], [, b]) => rank(a) - rank(b));
    $('sections').replaceChildren(...sorted.map(([title, findings]) => this.section(title, findings)));
    $('notes').hidden = !answer.notes.length;
    $('notes').querySelector('ul').replaceChildren(...answer.notes.map(note => made('li', {}, note)));
  }

  section(title, findings) {
    const sorted = [...findings].sort((a, b) => SEVERITY.indexOf(a.verdict) - SEVERITY.indexOf(b.verdict)), {verdict} = sorted[0];
    const badge = made('span');
    showBadge(badge, verdict);
    const place = made('details', {open: this.opened.get(title) ?? verdict !== 'ok'}, made('summary', {}, title, ' ', badge));
    place.addEventListener('toggle', () => this.opened.set(title, place.open));
    const row = ({name, lines, unit, verdict: own, note}) => {
      const value = made('td', {className: 'value'}, lines.join('\n'), unit && unit !== '1' ? ` ${unit}` : '');
      return made('tr', {className: own}, made('th', {scope: 'row'}, name), value, made('td', {}, own === 'ok' ? '' : made('b', {}, `${VERDICTS[own]}: `), note ?? ''));
    };
    place.append(made('div', {className: 'scroll'}, made('table', {}, made('tbody', {}, ...sorted.map(row)))));
    return place;
  }
}
