// The design in the # of the address: compact JSON, compressed where the browser can, in base64url. And what a design is.
'use strict';
// The most that a link may hold when it is unpacked, in bytes.
const LARGEST_LINK = 4e6;

// The name of an FMU.
const NAME = /^[A-Za-z]\w{0,59}$/;

// Entries of the forms.
const SOURCE = {num: '2', den: '1 0.5 1', A: '', B: '', C: '', D: '', states: '', inputs: '', outputs: '', example: '', file: '', text: ''};
// The entries that each form uses.
const USED = {
  transfer: ['num', 'den', 'inputs', 'outputs'], matrices: ['A', 'B', 'C', 'D', 'states', 'inputs', 'outputs'],
  example: ['example'], file: ['file', 'text'],
};

// A design as the page starts. A setting of null has its default; `limits` has a size, 0 (no limit) or null (that of the
// plant) for each control; `values` has changed parameters by kind.
const START = {
  form: 'example', source: SOURCE, follow: [], kind: 'pid', name: 'Controller',
  bandwidth: null, uncertainty: null, reference: null, noise: null, limits: [], delay: null, values: {},
};

const isNumber = value => typeof value === 'number' && Number.isFinite(value);
const isAtLeast0 = value => isNumber(value) && value >= 0;
const isPlain = value => typeof value === 'object' && value !== null && !Array.isArray(value);
// What a link may have, each with its test.
const TESTS = {
  form: value => Object.hasOwn(USED, value),
  source: value => isPlain(value) && Object.entries(value).every(([key, text]) => Object.hasOwn(SOURCE, key) && typeof text === 'string'),
  follow: value => Array.isArray(value) && value.every(place => Number.isInteger(place) && place >= 0),
  kind: value => typeof value === 'string' && /^[\w-]{1,40}$/.test(value),
  name: value => typeof value === 'string' && NAME.test(value),
  bandwidth: value => isNumber(value) && value > 0,
  uncertainty: isAtLeast0,
  reference: value => Array.isArray(value) && value.length > 0 && value.every(size => isNumber(size) && size > 0),
  noise: isAtLeast0,
  limits: value => Array.isArray(value) && value.every(limit => limit === null || isAtLeast0(limit)),
  delay: isAtLeast0,
  values: value => isPlain(value) && Object.values(value).every(values => isPlain(values) && Object.values(values).every(isNumber)),
};

// Only what differs from the start.
const compact = design => {
  const source = Object.fromEntries(USED[design.form].filter(key => design.source[key] !== SOURCE[key]).map(key => [key, design.source[key]]));
  const values = design.values[design.kind] ? {[design.kind]: design.values[design.kind]} : {};
  const differs = key => JSON.stringify(design[key]) !== JSON.stringify(START[key]);
  const others = Object.keys(START).filter(key => key !== 'source' && key !== 'values' && differs(key));
  return {...Object.fromEntries(others.map(key => [key, design[key]])), source, values};
};

const expanded = given => {
  if (!isPlain(given)) throw new Error('not a design');
  const known = Object.entries(given).filter(([key]) => Object.hasOwn(TESTS, key));
  if (!known.every(([key, value]) => TESTS[key](value))) throw new Error('not a design');
  const design = {...START, ...Object.fromEntries(known)};
  return {...design, source: {...SOURCE, ...design.source}};
};

const base64 = bytes => {
  let text = '';
  for (const byte of bytes) text += String.fromCharCode(byte);
  return btoa(text).replaceAll('+', '-').replaceAll('/', '_').replace(/=+$/, '');
};
const bytesOf = text => Uint8Array.from(atob(text.replaceAll('-', '+').replaceAll('_', '/')), letter => letter.charCodeAt(0));

// All bytes that come through a stream; refuses more than a link may hold.
const through = async (bytes, stream) => {
  const reader = new Blob([bytes]).stream().pipeThrough(stream).getReader(), parts = [];
  let size = 0;
  for (let next = await reader.read(); !next.done; next = await reader.read()) {
    size += next.value.length;
    if (size > LARGEST_LINK) {
      reader.cancel();
      throw new Error('too long');
    }
    parts.push(next.value);
  }
  return new Uint8Array(await new Blob(parts).arrayBuffer());
};

// The part of the address after #: z for compressed, j for plain.
const toHash = async design => {
  const bytes = new TextEncoder().encode(JSON.stringify(compact(design)));
  if (typeof CompressionStream === 'undefined') return `#j${base64(bytes)}`;
  return `#z${base64(await through(bytes, new CompressionStream('deflate-raw')))}`;
};

// The design of an address; null where there is none. Throws where it is damaged.
const fromHash = async hash => {
  const [, kind, text] = /^#([zj])([\w-]+)$/.exec(hash) ?? [];
  if (!kind) return null;
  let bytes = bytesOf(text);
  if (kind === 'z') bytes = await through(bytes, new DecompressionStream('deflate-raw'));
  return expanded(JSON.parse(new TextDecoder('utf-8', {fatal: true}).decode(bytes)));
};
