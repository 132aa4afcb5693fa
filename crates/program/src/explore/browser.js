// What answers the page of `explore` that has no server: the library itself, as WebAssembly (program.js), in workers, so that
// the page doesn't wait for it.
'use strict';

// A worker, from within. It is told the module and then questions, and answers each by lines.
const answering = () => {
  const page = {
    now: () => performance.now(),
    take: (place, length) => {
      const line = new TextDecoder().decode(new Uint8Array(library.memory.buffer, place, length));
      postMessage({line: JSON.parse(line)});
    },
  };
  // What packages ask for that are in the library and never called.
  const others = () => { throw new Error('not there in a browser'); };
  const imports = module => {
    const given = {page};
    for (const {module: from, name} of WebAssembly.Module.imports(module)) {
      if (from !== 'page') (given[from] ??= {})[name] = others;
    }
    return given;
  };
  let library = null;
  onmessage = async ({data: {module, question}}) => {
    try {
      library ??= (await WebAssembly.instantiate(module, imports(module))).exports;
      const text = new TextEncoder().encode(JSON.stringify(question));
      const place = library.explore_place(text.length);
      new Uint8Array(library.memory.buffer, place, text.length).set(text);
      library.explore_answer(place, text.length);
      postMessage({done: true});
    } catch (error) {
      postMessage({failed: String(error)});
    }
  };
};

// The library in a worker of its own, which has one loop.
class Worked {
  constructor(module, name) {
    const source = URL.createObjectURL(new Blob([`(${answering})()`], {type: 'text/javascript'}));
    this.worker = new Worker(source);
    this.module = module;
    this.told = this.last({loop: name});
  }

  // Asks, one question at a time; `tell` takes the lines of the answer as they come.
  ask(question, tell) {
    return new Promise((resolve, reject) => {
      this.worker.onmessage = ({data: {line, done, failed}}) => {
        if (line) tell(line); else if (done) resolve(); else reject(new Error(failed));
      };
      this.worker.onerror = event => reject(new Error(event.message));
      this.worker.postMessage({module: this.module, question});
    });
  }

  // The last line of an answer.
  async last(question) {
    let last = null;
    await this.ask(question, line => { last = line; });
    return last;
  }
}

class Browser {
  constructor() {
    this.lost = 'The program within this page has failed. Load the page again.';
    this.writes = false;
    // A worker that is ended takes the code with it that the browser has made fast.
    this.patience = 5000;
    this.workers = {};
  }

  // The worker for runs of a kind. What measures has one of its own: it is ended when a parameter is moved meanwhile.
  async worker(kind) {
    this.module ??= Browser.compiled();
    const module = await this.module;
    const worked = this.workers[kind] ??= new Worked(module, document.body.dataset.loop);
    await worked.told;
    return worked;
  }

  static async compiled() {
    const packed = Uint8Array.from(atob(PROGRAM), digit => digit.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
    return WebAssembly.compile(await new Response(stream).arrayBuffer());
  }

  async loop() {
    const told = await (await this.worker('about')).told;
    if (told.error) throw new Error(told.error);
    return told;
  }

  async run(wanted, signal, tell) {
    const kind = wanted.fine ? 'fine' : 'about', worked = await this.worker(kind);
    signal.throwIfAborted();
    const end = new Promise((_, reject) => signal.addEventListener('abort', () => {
      // At once: the next run must not take a worker that is about to end.
      this.end(kind, worked);
      reject(signal.reason);
    }));
    try {
      await Promise.race([worked.ask({run: wanted}, tell), end]);
    } catch (error) {
      this.end(kind, worked);
      throw error;
    }
  }

  end(kind, worked) {
    worked.worker.terminate();
    if (this.workers[kind] === worked) delete this.workers[kind];
  }

  async keep(what, wanted) {
    return (await this.worker('about')).last({[what]: wanted});
  }
}

const backend = new Browser();
