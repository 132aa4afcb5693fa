// Downloads. Libraries of the FMU's platforms are scripts next to the page, which are loaded when a file needs them.
'use strict';
const LIBRARIES = {};

const FILES = [
  {what: 'fmu', title: 'FMU', about: 'the controller for FMI 2.0 and 3.0 tools', needsLibraries: true},
  {what: 'loop', title: 'Loop (SSP)', about: 'plant, controller and reference as FMUs, connected', needsLibraries: true},
  {what: 'toml', title: 'Description (TOML)', about: 'for the program adaptive-fmu'},
  {what: 'c', title: 'C source (zip)', about: 'the control law in C99 for a target'},
  {what: 'report', title: 'Report (HTML)', about: 'the design report with its pictures'},
  {what: 'plant', title: 'Plant (JSON)', about: 'for the command below'},
];

const megabytes = bytes => bytes >= 1e5 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.ceil(bytes / 1e3)} kB`;

class Files {
  // `asked()` is the question's design, `plant()` the text of the model; `queue` answers.
  constructor(queue, asked, plant) {
    Object.assign(this, {queue, asked, plant, boxes: []});
    this.platforms();
    for (const {what, title, about, needsLibraries} of FILES) {
      const button = made('button', {type: 'button', title: about}, title);
      button.dataset.what = what;
      button.addEventListener('click', () => this.give(what, title, needsLibraries));
      $('downloads').append(button);
    }
    $('copy').addEventListener('click', async () => {
      $('copy').textContent = await copied($('command').textContent) ? 'Copied' : 'Select the text to copy it';
      setTimeout(() => { $('copy').textContent = 'Copy'; }, 2000);
    });
  }

  platforms() {
    const all = typeof PLATFORMS === 'undefined' ? [] : PLATFORMS;
    for (const {folder, title, file, bytes} of all) {
      const box = made('input', {type: 'checkbox', checked: true, value: folder});
      this.boxes.push({box, folder, file});
      box.addEventListener('change', () => this.show());
      $('platforms').append(made('label', {className: 'tick'}, box, ` ${title} `, made('small', {}, `(${megabytes(bytes)})`)));
    }
    if (!all.length) $('platforms').append(made('p', {className: 'bad'}, 'The file platforms.js is missing, so FMUs can’t be written here.'));
  }

  get chosen() {
    return this.boxes.filter(({box}) => box.checked);
  }

  // Files exist only of a design that was computed.
  show(isReady = this.isReady) {
    this.isReady = isReady;
    for (const button of $('downloads').children) {
      const {needsLibraries} = FILES.find(({what}) => what === button.dataset.what);
      button.disabled = !(button.dataset.what === 'plant' ? this.plant() : isReady) || needsLibraries && !this.chosen.length;
    }
  }

  async give(what, title, needsLibraries) {
    $('failed').hidden = true;
    $('downloaded').textContent = '';
    try {
      if (what === 'plant') {
        download('plant.json', 'application/json', this.plant());
        return;
      }
      const design = this.asked(), libraries = needsLibraries ? await this.libraries() : {};
      const given = await this.queue.ask('file', {file: {what, ...design, libraries}}, `Writing: ${title}`);
      if (given.error) throw new Error(given.error);
      download(given.name, given.type, Uint8Array.from(atob(given.base64), letter => letter.charCodeAt(0)));
      $('downloaded').textContent = `${given.name} was downloaded.`;
    } catch (error) {
      if (error instanceof Dropped) {
        $('downloaded').textContent = 'Cancelled.';
        return;
      }
      $('failed').textContent = error.message;
      $('failed').hidden = false;
    }
  }

  async libraries() {
    const chosen = this.chosen;
    $('downloaded').textContent = 'Loading the libraries of the platforms …';
    await Promise.all(chosen.map(({file}) => script(file)));
    $('downloaded').textContent = '';
    return Object.fromEntries(chosen.map(({folder}) => [folder, LIBRARIES[folder]]));
  }
}
