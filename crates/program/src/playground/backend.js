// What answers the page: the library of this package (library.js), in two workers. What takes long doesn't hold up what follows a
// slider.
'use strict';

// The code of the library, which is compiled once.
let compiled = null;

// Options of the command line in reasons and notes, as this page calls them.
const OPTIONS = {reference: 'Reference', bandwidth: 'Bandwidth', uncertainty: 'Uncertainty', name: 'Name of the FMU'};
const option = new RegExp(`--(${Object.keys(OPTIONS).join('|')})\\b`, 'g');
const inPage = value => {
  if (typeof value === 'string') return value.replace(option, (_, name) => OPTIONS[name]);
  if (Array.isArray(value)) return value.map(inPage);
  return value && typeof value === 'object' ? Object.fromEntries(Object.entries(value).map(([key, of]) => [key, inPage(of)])) : value;
};
const readable = answer => {
  const texts = ['error', 'sentence', 'notes', 'findings'].filter(key => key in answer);
  return {...answer, ...Object.fromEntries(texts.map(key => [key, inPage(answer[key])]))};
};

class Answering {
  // The last line of the answer to a question; `tell` takes the lines as they come.
  async ask(question, tell) {
    compiled ??= unpacked(PROGRAM).then(bytes => WebAssembly.compile(bytes));
    this.worked ??= new Worked(await compiled);
    const worked = this.worked;
    let last = null;
    const lines = line => { last = line; tell(line); };
    const {libraries, ...file} = question.file ?? {};
    if (!libraries) {
      await worked.ask(question, lines);
      return readable(last);
    }
    const bytes = await Promise.all(Object.values(libraries).map(async text => new Uint8Array(await unpacked(text))));
    await worked.ask({file}, lines, bytes);
    return readable(last);
  }

  // Ends the running question; the next one gets a worker of its own.
  cancel() {
    this.worked?.worker.terminate();
    this.worked = null;
  }
}

const backend = new Answering();
backend.long = new Answering();
