// Questions to the program in this page, one at a time. Only the newest question of each slot waits; slots that come first are
// asked first. What takes longer than a moment shows its progress and can be cancelled.
'use strict';
// Order of the slots. `quick` follows a slider; what is below it is ended when a slider moves.
const SLOTS = ['about', 'quick', 'columns', 'identify', 'file', 'cards', 'full'];
// Progress is shown after so long, in ms.
const NOTICED = 300;

// A question that wasn't answered because it was cancelled or replaced by a newer one.
class Dropped extends Error {}

class Queue {
  // `onState({doing, progress, since, isCancellable})` or `onState(null)` reports what is running.
  constructor(backend, onState) {
    Object.assign(this, {backend, onState, waiting: new Map(), running: null});
  }

  // The answer to a question. `doing` are words for what takes long.
  ask(slot, question, doing, isCancellable = true) {
    return new Promise((resolve, reject) => {
      const key = slot === 'cards' ? `cards ${question.design.kind}` : slot;
      this.waiting.get(key)?.reject(new Dropped('replaced'));
      this.waiting.set(key, {slot, question, doing, isCancellable, resolve, reject});
      // A slider doesn't wait for what can be computed again.
      if (slot === 'quick' && ['full', 'cards'].includes(this.running?.slot)) this.end();
      this.next();
    });
  }

  // Takes back questions that wait, and ends the running one, of some slots.
  drop(...slots) {
    for (const [key, waits] of this.waiting) {
      if (!slots.includes(waits.slot)) continue;
      this.waiting.delete(key);
      waits.reject(new Dropped('dropped'));
    }
    if (slots.includes(this.running?.slot)) this.cancel();
  }

  cancel() {
    if (this.running) this.end();
    this.next();
  }

  end() {
    const {reject} = this.running;
    this.running = null;
    this.backend.cancel();
    this.onState(null);
    reject(new Dropped('cancelled'));
  }

  async next() {
    if (this.running) return;
    const order = ([, {slot}]) => SLOTS.indexOf(slot);
    const [first] = [...this.waiting].sort((a, b) => order(a) - order(b));
    if (!first) return;
    const [key, mine] = first;
    this.waiting.delete(key);
    this.running = mine;
    const state = {doing: mine.doing, progress: null, isCancellable: mine.isCancellable};
    let isShown = false;
    const show = () => { isShown = true; this.onState(state); };
    const soon = setTimeout(() => this.running === mine && show(), NOTICED);
    try {
      const answer = await this.backend.ask(mine.question, line => {
        if (this.running !== mine || line.progress === undefined) return;
        state.progress = line.progress;
        state.doing = line.text || mine.doing;
        if (isShown) show();
      });
      // A cancelled question has been rejected already.
      if (this.running === mine) mine.resolve(answer);
    } catch (error) {
      // A worker that has failed answers nothing more.
      this.backend.cancel();
      if (this.running === mine) mine.reject(error);
    } finally {
      clearTimeout(soon);
      if (this.running === mine) {
        this.running = null;
        this.onState(null);
        this.next();
      }
    }
  }
}
