// The page of `explore` that has no server is answered by the library (library.js).
'use strict';

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
    const worked = this.workers[kind] ??= new Worked(module);
    worked.told ??= worked.last({loop: document.body.dataset.loop});
    await worked.told;
    return worked;
  }

  static async compiled() {
    return WebAssembly.compile(await unpacked(PROGRAM));
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
