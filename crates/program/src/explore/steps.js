// Values that variables get from a time of the run on: one row each. A row takes part in runs once it is complete.
'use strict';

class Steps {
  // `variables` may change during a run: {name, measure, description, value}; `settings` are those of the run.
  constructor(place, variables, settings, onChange) {
    Object.assign(this, {place, settings, onChange, rows: [], variables: new Map(variables.map(it => [it.name, it]))});
    const names = made('datalist', {id: 'changeable'}, ...variables.map(({name, description}) => made('option', {value: name, label: description})));
    this.list = made('div');
    const add = made('button', {type: 'button', id: 'add'}, 'Add a change');
    add.addEventListener('click', () => this.add().fields[0].focus());
    place.append(names, this.list, add);
    place.hidden = !variables.length;
  }

  add({time, name, value} = {}) {
    const row = {};
    const field = (label, attributes, text) => {
      const field = made('input', {autocomplete: 'off', ...attributes, value: text ?? ''});
      field.setAttribute('aria-label', label);
      field.addEventListener('change', () => {
        if (field === row.fields[0]) this.propose(row);
        this.onChange();
      });
      return field;
    };
    row.fields = [
      field('variable that changes', {placeholder: 'component.variable', spellcheck: false}, name),
      field('time of the change in s', {type: 'number', step: 'any'}, time),
      field('new value', {}, value),
    ];
    row.fields[0].setAttribute('list', 'changeable');
    row.measure = made('small');
    const remove = made('button', {type: 'button', title: 'Remove this change'}, '×');
    remove.setAttribute('aria-label', 'Remove this change');
    remove.addEventListener('click', () => {
      this.rows = this.rows.filter(other => other !== row);
      row.place.remove();
      this.onChange();
    });
    row.wrong = made('p', {className: 'wrong bad', hidden: true});
    const [variable, at, to] = row.fields;
    row.place = made('div', {className: 'step'}, variable, remove, made('span', {}, 'from ', at, ' s on: ', to, ' ', row.measure), row.wrong);
    this.list.append(row.place);
    this.rows.push(row);
    this.show(row);
    return row;
  }

  // A time and the present value, where a variable was chosen that has none yet.
  propose(row) {
    const [variable, at, to] = row.fields, known = this.variables.get(variable.value.trim());
    if (known && !at.value) at.value = Number(((this.settings.start + this.settings.stop) / 2).toPrecision(3));
    if (known && !to.value) to.value = known.value;
    this.show(row);
  }

  show({fields: [variable], measure}) {
    const known = this.variables.get(variable.value.trim());
    variable.title = known?.description ?? '';
    measure.textContent = known?.measure && known.measure !== '1' ? known.measure : '';
  }

  get complete() {
    return this.rows.filter(({fields: [variable, at, to]}) => variable.value.trim() && Number.isFinite(at.valueAsNumber) && to.value.trim());
  }

  // As the program takes them, in the order of the rows.
  get events() {
    return this.complete.map(({fields: [variable, at, to]}) => ({time: at.valueAsNumber, name: variable.value.trim(), value: to.value.trim()}));
  }

  // As `--event` has them.
  get texts() {
    return this.events.map(({time, name, value}) => `${time}: ${name}=${value}`);
  }

  set texts(texts) {
    this.rows = [];
    this.list.replaceChildren();
    for (const text of texts) {
      const [, time, name, value] = /^([^:]*):([^=]*)=(.*)$/.exec(text) ?? [];
      if (name) this.add({time: time.trim(), name: name.trim(), value: value.trim()});
    }
    if (this.rows.length) this.place.open = true;
  }

  // Shows at the complete rows of these numbers why they are refused, and at no others.
  refuse(reason, numbers = []) {
    this.complete.forEach(({place, wrong}, k) => {
      const isWrong = numbers.includes(k);
      wrong.hidden = !isWrong;
      wrong.textContent = isWrong ? reason : '';
      place.classList.toggle('refused', isWrong);
    });
    if (numbers.length) this.place.open = true;
  }
}
