// Asks this package's library for browsers without a browser: node ask.mjs LIBRARY.wasm. Each line of the input is {question,
// libraries: [file, …]}; each line of the output an answer with its progress before it: [line, …].
import {readFileSync} from 'node:fs';
import {createInterface} from 'node:readline';

const lines = [];
const page = {
  now: () => performance.now(),
  take: (place, length) => lines.push(JSON.parse(new TextDecoder().decode(new Uint8Array(library.memory.buffer, place, length)))),
};
const module = new WebAssembly.Module(readFileSync(process.argv[2]));
const imports = {page};
for (const {module: from, name} of WebAssembly.Module.imports(module)) {
  if (from !== 'page') (imports[from] ??= {})[name] = () => { throw new Error(`${name} isn't there`); };
}
const library = new WebAssembly.Instance(module, imports).exports;

const placed = (bytes, take) => {
  const place = library.page_place(bytes.length);
  new Uint8Array(library.memory.buffer, place, bytes.length).set(bytes);
  take(place, bytes.length);
};
for await (const text of createInterface({input: process.stdin})) {
  const {question, libraries = []} = JSON.parse(text);
  for (const file of libraries) placed(readFileSync(file), library.page_library);
  const begun = performance.now();
  placed(new TextEncoder().encode(JSON.stringify(question)), library.page_answer);
  process.stdout.write(`${JSON.stringify([...lines.splice(0), {milliseconds: performance.now() - begun}])}\n`);
}
