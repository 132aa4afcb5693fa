// What answers pages that have no server: the library of this package, as WebAssembly (program.js), in workers, so that the page
// doesn't wait for it.
'use strict';

// A worker, from within. It receives the module and then questions, and answers each by lines.
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
  // Bytes in the memory of the library, which frees them.
  const placed = (bytes, take) => {
    const place = library.page_place(bytes.length);
    new Uint8Array(library.memory.buffer, place, bytes.length).set(bytes);
    take(place, bytes.length);
  };
  onmessage = async ({data: {module, question, libraries}}) => {
    try {
      library ??= (await WebAssembly.instantiate(module, imports(module))).exports;
      for (const bytes of libraries ?? []) placed(bytes, library.page_library);
      placed(new TextEncoder().encode(JSON.stringify(question)), library.page_answer);
      postMessage({done: true});
    } catch (error) {
      postMessage({failed: String(error)});
    }
  };
};

// The library in a worker of its own.
class Worked {
  constructor(module) {
    const source = URL.createObjectURL(new Blob([`(${answering})()`], {type: 'text/javascript'}));
    this.worker = new Worker(source);
    this.module = module;
  }

  // Asks, one question at a time; `tell` takes the lines of the answer as they come. FMUs hold the libraries that are given.
  ask(question, tell, libraries) {
    return new Promise((resolve, reject) => {
      this.worker.onmessage = ({data: {line, done, failed}}) => {
        if (line) tell(line); else if (done) resolve(); else reject(new Error(failed));
      };
      this.worker.onerror = event => reject(new Error(event.message));
      this.worker.postMessage({module: this.module, question, libraries});
    });
  }

  // The last line of an answer.
  async last(question) {
    let last = null;
    await this.ask(question, line => { last = line; });
    return last;
  }
}

// Bytes of a text that a script beside the page holds: base64 of gzip.
const unpacked = async text => {
  const packed = Uint8Array.from(atob(text), digit => digit.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).arrayBuffer();
};
