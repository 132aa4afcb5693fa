// Numbers, matrices and signals as users type or paste them: MATLAB, Python, numpy, JSON, or rows of numbers.
'use strict';

// An entry that can't be read, with the reason in words.
class Wrong extends Error {}

// A number, or a fraction as in 1/3.
const number = text => {
  const parts = text.split('/');
  const numbers = parts.map(part => part.trim() === '' ? NaN : Number(part));
  const value = numbers.length === 2 ? numbers[0] / numbers[1] : numbers[0];
  if (parts.length > 2 || !Number.isFinite(value)) throw new Wrong(`“${text.slice(0, 30)}” is not a number.`);
  return value;
};

// The text without what programs write around numbers: names, calls, types and comments.
const bare = text => text.replaceAll('−', '-').replace(/%.*$|#.*$/gm, '').replace(/,?\s*dtype\s*=\s*[\w.'"]+/g, '')
  .replace(/\.\.\.\s*\n/g, ' ').replace(/^\s*[\w.]+\s*=(?!=)/, '').replace(/\b(?:[A-Za-z_]\w*\.)*(?:array|matrix|mat|asarray)\s*(?=\()/g, '')
  .replace(/[()'"]/g, ' ').trim().replace(/;\s*$/, '').trim();

const numbers = text => text.split(/[\s,]+/).filter(Boolean).map(number);

// The rows of a matrix.
const rowsOf = text => {
  const plain = bare(text);
  if (!plain) throw new Wrong('Enter a matrix, as in [0 1; -2 -3].');
  const [opened, closed] = ['[', ']'].map(bracket => plain.split(bracket).length);
  if (opened !== closed) throw new Wrong('A bracket is missing.');
  const inner = [...plain.matchAll(/\[([^[\]]*)\]/g)].map(([, row]) => row);
  // Brackets within brackets are rows; otherwise rows end at semicolons and line ends.
  const isNested = /\[\s*\[/.test(plain) || inner.length > 1;
  const lines = isNested ? inner : plain.replace(/[[\]]/g, '').split(/[;\n]/);
  const rows = lines.map(numbers).filter(row => row.length);
  if (!rows.length) throw new Wrong('Enter at least one number.');
  const other = rows.findIndex(row => row.length !== rows[0].length);
  if (other > 0) throw new Wrong(`Row ${other + 1} has length ${rows[other].length}, row 1 has length ${rows[0].length}. Rows must be equally long.`);
  return rows;
};

// The coefficients of a polynomial.
const coefficients = text => {
  const plain = bare(text).replace(/[[\]]/g, ' ');
  if (/[sz]\s*\^|[a-z]/i.test(plain.replace(/\de[-+]?\d/gi, ''))) throw new Wrong('Enter coefficients, the highest power first: “1 0.5 2” is s² + 0.5 s + 2.');
  const all = numbers(plain);
  const first = all.findIndex(value => value !== 0);
  if (first < 0) throw new Wrong('Enter a coefficient other than 0.');
  return all.slice(first);
};

const transposed = rows => rows[0].map((_, j) => rows.map(row => row[j]));
const sized = rows => `${rows.length} × ${rows[0].length}`;
// A matrix as text, a row a line.
const written2 = rows => rows.map(row => row.join('  ')).join('\n');

// Signals as in “speed [rad/s], current [A]”: {names, units}; null where nothing was entered.
const signals = (text, count) => {
  if (!text.trim()) return null;
  const all = text.split(',').map(part => /^\s*([^[\]]*?)\s*(?:\[([^[\]]*)\])?\s*$/.exec(part));
  const wrong = all.findIndex(found => !found || !/^[A-Za-z_]\w*$/.test(found[1]));
  if (wrong >= 0) throw new Wrong(`Signal ${wrong + 1}: a name has letters, digits and underscores, as in “speed [rad/s]”.`);
  if (all.length !== count) throw new Wrong(`Enter ${count} name${count === 1 ? '' : 's'}, or none; there ${all.length === 1 ? 'is' : 'are'} ${all.length}.`);
  const names = all.map(([, name]) => name);
  if (new Set(names).size < count) throw new Wrong('Names must differ.');
  return {names, units: all.some(([, , unit]) => unit) ? all.map(([, , unit]) => unit?.trim() || '1') : null};
};

// The reverse of `signals`.
const writtenSignals = (names, units) => (names ?? []).map((name, k) => units?.[k] ? `${name} [${units[k]}]` : name).join(', ');

// A polynomial as it is read: s² + 0.5 s + 2.
const polynomial = list => {
  const raised = power => String(power).replace(/\d/g, digit => '⁰¹²³⁴⁵⁶⁷⁸⁹'[digit]);
  const term = (value, power) => {
    const size = Math.abs(value), variable = power === 0 ? '' : power === 1 ? 's' : `s${raised(power)}`;
    return size === 1 && variable ? variable : `${Number(size.toPrecision(6))}${variable ? ` ${variable}` : ''}`;
  };
  const terms = list.map((value, k) => [value, list.length - 1 - k]).filter(([value]) => value !== 0);
  return terms.map(([value, power], k) => `${value < 0 ? (k ? ' − ' : '−') : k ? ' + ' : ''}${term(value, power)}`).join('') || '0';
};
