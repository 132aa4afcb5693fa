// What answers the page of `explore` that comes from a server on the user's machine.
'use strict';

class Server {
  constructor() {
    this.token = new URLSearchParams(location.search).get('token');
    this.page = Array.from(crypto.getRandomValues(new Uint32Array(3)), part => part.toString(16)).join('');
    this.lost = 'The program doesn\'t answer: it may have ended. Run `adaptive-fmu explore` again.';
    // It writes files.
    this.writes = true;
    // A run that takes longer than this, in ms, is ended when another is wanted; a shorter one is waited for.
    this.patience = 1000;
  }

  asked(path, body, signal) {
    const headers = {'X-Token': this.token, ...(body && {'Content-Type': 'application/json'})};
    return fetch(path, {method: body ? 'POST' : 'GET', headers, body: body && JSON.stringify(body), signal});
  }

  // What the page shows before the first run.
  async loop() {
    const answer = await this.asked('loop');
    if (!answer.ok) throw new Error((await answer.json()).error);
    return answer.json();
  }

  // Runs the loop with the values that are wanted; `tell` takes the lines of the answer as they come.
  async run(wanted, signal, tell) {
    const answer = await this.asked('run', {page: this.page, ...wanted}, signal);
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = '';
    for (;;) {
      const {value, done} = await reader.read();
      const whole = (rest + (value ?? '')).split('\n');
      rest = done ? '' : whole.pop();
      whole.filter(Boolean).forEach(line => tell(JSON.parse(line)));
      if (done) return;
    }
  }

  // `set`, `save` or `export`. What is there of that name (`isThere`) is replaced where `wanted.replace` says so.
  async keep(what, wanted) {
    return (await this.asked(what, wanted)).json();
  }
}

const backend = new Server();
